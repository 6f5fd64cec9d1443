#include "harness/calibration/calibration_run.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "tiller/config.hpp"

namespace tiller::bench {
namespace {

struct Cloud {
  Eigen::MatrixXd point;  // (d x n)
  Eigen::VectorXd weight;
  Eigen::VectorXd mean() const { return point * weight; }
};

Cloud particles_of(const CalibrationRow& row, const Posterior& posterior) {
  const int d = row.dimensions(), n = static_cast<int>(posterior.size());
  Cloud cloud{Eigen::MatrixXd(d, n), Eigen::VectorXd(n)};
  double params[TILLER_MAX_PARAMS];
  for (int i = 0; i < n; ++i) {
    posterior.particle(static_cast<std::uint32_t>(i), params, nullptr, &cloud.weight[i]);
    for (int j = 0; j < d; ++j) cloud.point(j, i) = params[row.problem.inferred[static_cast<std::size_t>(j)]];
  }
  return cloud;
}

double rank_of(const Cloud& cloud, int j, double truth) {
  double below = 0.0;
  for (int i = 0; i < cloud.point.cols(); ++i)
    below += cloud.weight[i] * (cloud.point(j, i) < truth ? 1.0 : cloud.point(j, i) == truth ? 0.5 : 0.0);
  return below;
}

double log_normal_density(const Eigen::VectorXd& off, const Eigen::MatrixXd& covariance) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  const Eigen::VectorXd z = root.matrixL().solve(off);
  return -0.5 * z.squaredNorm() - root.matrixL().toDenseMatrix().diagonal().array().log().sum();
}

/// log density at `at` of weighted points under a normal kernel, without the factor that all share.
double kernel_density(const Eigen::MatrixXd& point, const Eigen::VectorXd& weight, const Eigen::VectorXd& at,
                      const Eigen::MatrixXd& kernel) {
  const Eigen::LLT<Eigen::MatrixXd> root(kernel);
  const Eigen::MatrixXd z = root.matrixL().solve(point.colwise() - at);
  const Eigen::ArrayXd exponent =
      -0.5 * z.colwise().squaredNorm().transpose().array() + weight.array().max(1e-300).log();
  const double top = exponent.maxCoeff();
  return top + std::log((exponent - top).exp().sum()) - root.matrixL().toDenseMatrix().diagonal().array().log().sum();
}

/// Every density is convolved with the same kernel: the reference's covariance times Scott's factor for the engine's
/// number of particles.
void compare(const CalibrationRow& row, const PlantRecord& record, const Cloud& cloud, const Eigen::VectorXd& truth,
             std::uint64_t seed, CalibrationScore& score) {
  const int d = row.dimensions();
  const ReferencePosterior reference = sample_reference(row.problem, record, truth.data(), seed);
  score.effective = reference.effective;
  for (int j = 0; j < d; ++j) score.reference_rank.push_back(reference.rank(j, truth[j]));
  const Eigen::VectorXd mean = reference.mean(), engine_mean = cloud.mean();
  Eigen::MatrixXd covariance = reference.covariance();
  covariance.diagonal() *= 1.0 + 1e-9;
  for (int j = 0; j < d; ++j) {
    const double sd = std::sqrt(covariance(j, j));
    score.sd_ratio.push_back(score.sd[static_cast<std::size_t>(j)] / sd);
    score.offset.push_back((engine_mean[j] - mean[j]) / sd);
  }
  const double h = std::pow(static_cast<double>(cloud.weight.size()), -1.0 / (d + 4));
  const Eigen::MatrixXd kernel = h * h * covariance;
  const double engine = kernel_density(cloud.point, cloud.weight, truth, kernel);
  score.loss = kernel_density(reference.point, reference.weight, truth, kernel) - engine;
  const JointEstimate joint = joint_unscented(row.problem, record);
  Eigen::VectorXd off(d);
  Eigen::MatrixXd widened = joint.covariance;
  // the filter's normal law is over coordinates; its density over parameters has the logarithm's slope
  double slope = 0.0;
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(d);
  for (int j = 0; j < d; ++j) {
    const ReferencePrior& prior = row.problem.prior[static_cast<std::size_t>(j)];
    off[j] = prior.to_coordinate(truth[j]) - joint.mean[j];
    if (prior.kind != ReferencePrior::Kind::log_normal) continue;
    scale[j] = 1.0 / truth[j];
    slope += std::log(scale[j]);
  }
  widened += Eigen::MatrixXd(scale.asDiagonal() * kernel * scale.asDiagonal());
  score.joint_loss = log_normal_density(off, widened) + slope - engine;
}

}  // namespace

CalibrationScore run_calibration(const CalibrationRow& row, std::uint64_t seed, bool with_reference) {
  const PlantRecord record = record_plant(draw_run(row, seed), seed);
  tiller::Config config = calibration_config(row);
  config.seed = seed;
  CalibrationScore score;
  EngineInstance engine(config);
  score.fed = feed(engine.posterior(), config, record);
  score.noise_scale = engine.posterior().noise_scale();

  const int d = row.dimensions();
  const Cloud cloud = particles_of(row, engine.posterior());
  const Eigen::VectorXd mean = cloud.mean();
  Eigen::VectorXd truth(d);
  for (int j = 0; j < d; ++j) {
    truth[j] = record.param[row.problem.inferred[static_cast<std::size_t>(j)]];
    score.rank.push_back(rank_of(cloud, j, truth[j]));
    score.sd.push_back(std::sqrt((cloud.point.row(j).array() - mean[j]).square().matrix().dot(cloud.weight)));
  }
  if (with_reference) compare(row, record, cloud, truth, seed, score);
  return score;
}

}  // namespace tiller::bench
