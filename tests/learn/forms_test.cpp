// An ensemble and a sparse Gaussian process on data whose answer is known: what they say inside, how unsure they are
// beyond, and the process against the exact one by plain algebra.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "core/rng.hpp"
#include "networks/evaluate.hpp"
#include "networks/network_check.hpp"
#include "tools/learn/ensemble.hpp"
#include "tools/learn/gaussian_fit.hpp"

namespace tiller::tools::learn {
namespace {

constexpr double kNoise = 0.05;

double truth(double x) { return std::sin(2.0 * x); }

/// y = sin 2x on [-2, 2] with noise, in standard units that leave it as it is.
DynamicsData line_data(int samples) {
  DynamicsData d;
  Rng rng(1, 2, 3);
  d.x.resize(1, samples);
  d.y.resize(1, samples);
  d.weight = Eigen::MatrixXd::Ones(1, samples);
  for (int k = 0; k < samples; ++k) {
    d.x(0, k) = -2.0 + 4.0 * k / (samples - 1);
    d.y(0, k) = truth(d.x(0, k)) + kNoise * rng.normal();
    d.block.push_back(k / 10);
  }
  d.in = d.out = nets::Standardiser{Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1)};
  return d;
}

struct Moments {
  double mean = 0, sd = 0;
};

TEST(Ensemble, AgreesWhereDataAreAndNotBeyond) {
  EnsembleOptions options;
  options.steps = 2000;
  const DynamicsData data = line_data(300);
  const std::vector<Member> members = train_ensemble(data, options);
  ASSERT_EQ(members.size(), 5u);
  const auto at = [&](double x) {
    Moments m;
    for (const Member& member : members) m.mean += member.mlp.evaluate(Eigen::MatrixXd::Constant(1, 1, x))(0) / 5.0;
    for (const Member& member : members)
      m.sd += std::pow(member.mlp.evaluate(Eigen::MatrixXd::Constant(1, 1, x))(0) - m.mean, 2) / 5.0;
    m.sd = std::sqrt(m.sd);
    return m;
  };
  double squares = 0.0, inside = 0.0, beyond = 0.0;
  for (int k = 0; k <= 20; ++k) {
    const double x = -1.8 + 0.18 * k;
    squares += std::pow(at(x).mean - truth(x), 2) / 21.0;
    inside += at(x).sd / 21.0;
    beyond += at(x < 0.0 ? x - 3.0 : x + 3.0).sd / 21.0;
  }
  EXPECT_LT(std::sqrt(squares), kNoise) << "the noise is averaged over three hundred samples";
  EXPECT_GT(beyond, 3.0 * inside);
}

TEST(Ensemble, IsTheSameToTheLastBit) {
  EnsembleOptions options;
  options.steps = 200;
  options.members = 2;
  const DynamicsData data = line_data(100);
  const std::vector<Member> a = train_ensemble(data, options), b = train_ensemble(data, options);
  for (std::size_t m = 0; m < a.size(); ++m) EXPECT_EQ(a[m].mlp.weights, b[m].mlp.weights);
  EXPECT_NE(a[0].mlp.weights, a[1].mlp.weights);
}

struct Exact {
  double mean, variance;
};

/// The process without inducing points: textbook algebra on all samples.
Exact exact_process(const DynamicsData& data, double length, double signal, double noise, double x) {
  const Eigen::Index n = data.x.cols();
  const auto k = [&](double a, double b) { return signal * signal * std::exp(-0.5 * std::pow((a - b) / length, 2)); };
  Eigen::MatrixXd covariance(n, n);
  Eigen::VectorXd cross(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    cross(i) = k(x, data.x(0, i));
    for (Eigen::Index j = 0; j < n; ++j)
      covariance(i, j) = k(data.x(0, i), data.x(0, j)) + (i == j ? noise * noise : 0);
  }
  const Eigen::LLT<Eigen::MatrixXd> llt(covariance);
  return {cross.dot(llt.solve(data.y.row(0).transpose())), k(x, x) - cross.dot(llt.solve(cross))};
}

TEST(GaussianFit, DrawsHaveTheExactPosteriorsMoments) {
  const DynamicsData data = line_data(200);
  GaussianOptions options;
  options.inducing = 30;
  options.waves = 256;
  options.members = TILLER_MAX_NETWORK_MEMBERS;
  options.hyper_samples = 200;
  constexpr int kSeeds = 12;  // members of several seeds together: the lengths depend on no seed, all samples are taken
  std::vector<std::vector<double>> drawn(5);
  const double at[5] = {-1.5, 0.0, 0.7, 3.0, 6.0};
  GaussianFit fit;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    options.seed = seed;
    fit = fit_gaussian(data, options);
    tiller_network_t n = {sizeof n,
                          TILLER_CONFIG_VERSION,
                          tiller_network_gaussian,
                          1,
                          1,
                          TILLER_MAX_NETWORK_MEMBERS,
                          {30, 256},
                          fit.weights.data(),
                          static_cast<std::uint32_t>(fit.weights.size()),
                          0};
    ASSERT_EQ(network_defect(n), nullptr);
    for (std::uint32_t m = 1; m < n.members; ++m)  // the first is the mean
      for (std::size_t k = 0; k < 5; ++k) {
        double out;
        evaluate_member(n, m, &at[k], &out);
        drawn[k].push_back(out);
      }
    double mean;
    evaluate_member(n, 0, &at[1], &mean);
    EXPECT_NEAR(mean, exact_process(data, fit.length(0), fit.signal(0), fit.noise(0), at[1]).mean, 0.02);
  }
  EXPECT_NEAR(fit.noise(0), kNoise, 0.02);
  for (std::size_t k = 0; k < 5; ++k) {
    const Exact exact = exact_process(data, fit.length(0), fit.signal(0), fit.noise(0), at[k]);
    double mean = 0.0, squares = 0.0;
    for (const double y : drawn[k]) mean += y / static_cast<double>(drawn[k].size());
    for (const double y : drawn[k]) squares += (y - mean) * (y - mean) / static_cast<double>(drawn[k].size());
    const double sd = std::sqrt(exact.variance);
    // 180 draws: five standard errors of a mean and of a deviation; the waves' kernel is one of 256 features
    EXPECT_NEAR(mean, exact.mean, 5.0 * sd / std::sqrt(180.0) + 0.01) << at[k];
    EXPECT_NEAR(std::sqrt(squares), sd, 5.0 * sd / std::sqrt(360.0) + 0.01) << at[k];
  }
}

TEST(GaussianFit, ALengthOfAnInputThatTellsNothingGrows) {
  DynamicsData data = line_data(150);
  data.x.conservativeResize(2, 150);
  Rng rng(5, 6, 7);
  for (int k = 0; k < 150; ++k) data.x(1, k) = rng.normal();
  data.in = nets::Standardiser{Eigen::VectorXd::Zero(2), Eigen::VectorXd::Ones(2)};
  GaussianOptions options;
  options.hyper_samples = 150;
  const GaussianFit fit = fit_gaussian(data, options);
  EXPECT_GT(fit.length(1), 3.0 * fit.length(0));
}

}  // namespace
}  // namespace tiller::tools::learn
