#include "tools/imitate/smoother.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "rollout/measurement.hpp"

namespace tiller::tools::imitate {
namespace {

double sensor_sd(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == state) return config.measurement_sd[k];
  return NAN;
}

/// Mean and covariance of a state, before and after a measurement.
struct Estimate {
  Vector mean;
  Matrix covariance;
};

class Filter {
 public:
  Filter(const Scene& scene, const Grid& grid, double process_scale)
      : scene_(scene), grid_(grid), process_scale_(process_scale), nx_(scene.nx()), maps_(nx_), sd_(nx_) {
    for (std::uint32_t i = 0; i < nx_; ++i) {
      maps_[i] = measurement_map(scene.config, i, scene.params.data(), 1);
      sd_[i] = sensor_sd(scene.config, i);
    }
  }

  Estimate first() const {
    Estimate b{Vector(nx_), Matrix::Zero(nx_, nx_)};
    for (std::uint32_t i = 0; i < nx_; ++i) {
      b.mean(i) = scene_.config.initial_state[i];
      b.covariance(i, i) = std::pow(scene_.config.initial_state_sd[i], 2);
      if (std::isfinite(at(i, 0))) {
        b.mean(i) = read(i, 0);
        b.covariance(i, i) = std::pow(30 * known_sd(i), 2);  // the first measurement then says it
      }
    }
    for (std::uint32_t j = 0; j < scene_.config.model->joint_count; ++j) begin_speed(scene_.config.model->joints[j], b);
    return b;
  }

  void correct(std::size_t point, Estimate& b) {
    for (std::uint32_t i = 0; i < nx_; ++i) {
      if (!std::isfinite(at(i, point))) continue;
      const double noise = std::pow(known_sd(i), 2), variance = b.covariance(i, i) + noise;
      const double miss = state_difference(*scene_.config.model, i, read(i, point), b.mean(i));
      if (point > 0) sum_ += miss * miss / variance, log_ += std::log(variance), ++count_;
      const Vector gain = b.covariance.col(i) / variance;
      b.mean += gain * miss;
      b.covariance -= gain * b.covariance.row(i).eval();
      b.covariance = 0.5 * (b.covariance + b.covariance.transpose()).eval();
    }
  }

  /// `a` is set to the step's derivative.
  Estimate predict(const Estimate& b, const Vector& input, Matrix& a) const {
    Matrix rows;
    Estimate next;
    next.mean = scene_.step(b.mean, input, &rows);
    a = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(rows.data(), nx_, nx_);
    next.covariance = a * b.covariance * a.transpose();
    for (std::uint32_t i = 0; i < nx_; ++i)
      next.covariance(i, i) += std::pow(process_scale_ * scene_.config.process_sd[i], 2) * grid_.period_s + 1e-16;
    return next;
  }
  double log_likelihood() const { return -0.5 * (sum_ + log_); }
  double misfit() const { return count_ > 0 ? std::sqrt(sum_ / static_cast<double>(count_)) : 0; }

 private:
  double at(std::uint32_t i, std::size_t point) const { return grid_.state[i].empty() ? NAN : grid_.state[i][point]; }
  double read(std::uint32_t i, std::size_t point) const { return (at(i, point) - maps_[i].offset) / maps_[i].gain; }
  /// A state that is logged without being a sensor of the robot's is taken nearly as it is.
  double known_sd(std::uint32_t i) const {
    return (std::isfinite(sd_[i]) && sd_[i] > 0 ? sd_[i] : 1e-6) / maps_[i].gain;
  }

  /// The speed of a joint whose position alone is measured: the mean over five periods, known as badly as that.
  void begin_speed(const tiller_joint_t& joint, Estimate& b) const {
    const std::size_t ahead = std::min<std::size_t>(5, grid_.points() - 1);
    if (joint.position == TILLER_NO_POSITION || std::isfinite(at(joint.velocity, 0))) return;
    const double from = at(joint.position, 0), to = at(joint.position, ahead);
    if (!std::isfinite(from) || !std::isfinite(to)) return;
    const double span_s = static_cast<double>(ahead) * grid_.period_s;
    b.mean(joint.velocity) = state_difference(*scene_.config.model, joint.position, to, from) / span_s;
    const double doubt = std::fabs(b.mean(joint.velocity)) + 10 * known_sd(joint.position) / span_s;
    b.covariance(joint.velocity, joint.velocity) += doubt * doubt;
  }

  const Scene& scene_;
  const Grid& grid_;
  double process_scale_;
  std::uint32_t nx_;
  std::vector<MeasurementMap> maps_;
  std::vector<double> sd_;
  double sum_ = 0, log_ = 0;
  std::size_t count_ = 0;
};

bool has_start(const Scene& scene, const Grid& grid, std::string& error) {
  const tiller_model_t& model = *scene.config.model;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const auto finite_in = [&](std::uint32_t s) { return !grid.state[s].empty() && std::isfinite(grid.state[s][0]); };
    bool told = finite_in(i) || scene.config.initial_state_sd[i] > 0;
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      told = told || (model.joints[j].velocity == i && model.joints[j].position != TILLER_NO_POSITION &&
                      finite_in(model.joints[j].position));
    if (told) continue;
    error = grid.path + ": nothing tells where " + model.state_names[i] +
            " begins; log it, or write start.sd of it in the robot file";
    return false;
  }
  return true;
}

/// A forward pass with what the backward one needs.
struct Forward {
  std::vector<Estimate> filtered, predicted;
  std::vector<Matrix> a;
  double misfit = 0, log_likelihood = 0;
};

Forward filter_forward(const Scene& scene, const Grid& grid, const Matrix& input, double process_scale) {
  const std::size_t points = grid.points();
  Forward f{std::vector<Estimate>(points), std::vector<Estimate>(points), std::vector<Matrix>(points), 0, 0};
  Filter filter(scene, grid, process_scale);
  f.filtered[0] = filter.first();
  filter.correct(0, f.filtered[0]);
  for (std::size_t p = 1; p < points; ++p) {
    f.predicted[p] = filter.predict(f.filtered[p - 1], input.col(static_cast<Eigen::Index>(p) - 1), f.a[p]);
    f.filtered[p] = f.predicted[p];
    filter.correct(p, f.filtered[p]);
  }
  f.misfit = filter.misfit();
  f.log_likelihood = filter.log_likelihood();
  return f;
}

/// The process noise of the robot file, or a part of it: what explains this log best. A state is known the better, the
/// less the motion leaves the model.
Forward best_forward(const Scene& scene, const Grid& grid, const Matrix& input) {
  Forward best = filter_forward(scene, grid, input, 1);
  for (const double scale : {0.3, 0.1, 0.03, 0.01}) {
    Forward next = filter_forward(scene, grid, input, scale);
    if (!(next.log_likelihood > best.log_likelihood)) break;
    best = std::move(next);
  }
  return best;
}

}  // namespace

bool smooth(const Scene& scene, const Grid& grid, Smoothed& result, std::string& error) {
  if (!has_start(scene, grid, error)) return false;
  const auto points = static_cast<Eigen::Index>(grid.points());
  Motion& motion = result.motion;
  motion.state.resize(scene.nx(), points);
  motion.input.resize(scene.nu(), points - 1);
  for (Eigen::Index k = 0; k + 1 < points; ++k)
    for (std::uint32_t i = 0; i < scene.nu(); ++i) motion.input(i, k) = grid.input[i][static_cast<std::size_t>(k)];
  const Forward f = best_forward(scene, grid, motion.input);
  motion.state.col(points - 1) = f.filtered.back().mean;
  for (std::size_t p = grid.points() - 1; p-- > 0;) {
    const auto at = static_cast<Eigen::Index>(p);
    const Matrix cross = f.a[p + 1] * f.filtered[p].covariance;
    const Matrix gain = f.predicted[p + 1].covariance.ldlt().solve(cross).transpose();
    motion.state.col(at) =
        f.filtered[p].mean + gain * scene.difference(motion.state.col(at + 1), f.predicted[p + 1].mean);
  }
  result.misfit = f.misfit;
  if (motion.state.allFinite()) return true;
  error = grid.path + ": the model goes beyond all bounds along this log; is it of this robot?";
  return false;
}

}  // namespace tiller::tools::imitate
