#include "tools/smooth/smoother.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>

#include "rollout/measurement.hpp"
#include "tools/smooth/forced_step.hpp"

namespace tiller::tools {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kBeginSpan_s = 0.05;          // over which a speed is taken from positions, and
constexpr std::size_t kLeastBeginPeriods = 5;  // at least so many periods
constexpr double kWide = 30;       // of a state that is measured where the filter begins: that measurement decides it
constexpr double kExact = 1e-6;    // deviation of a sensor that is stated to have none
constexpr double kRegular = 1e-9;  // share of a state that keeps the covariance regular where there is no noise
constexpr double kLargest = 1e9;   // a filter beyond it ran away

/// What the smoother needs of one period.
struct Pass {
  Vector z, next;           // filtered at its beginning, predicted at its end
  Matrix p, p_next, slope;  // covariances of both; slope of the whole step
};

class Filter {
 public:
  /// `forced`: the configuration with forces, or `plain` itself without.
  Filter(const tiller_config_t& plain, const tiller_config_t& forced, const std::vector<double>& params,
         const SmoothSettings& settings)
      : plain_(plain),
        model_(*plain.model),
        settings_(settings),
        nx_(model_.state_count),
        nf_(static_cast<std::uint32_t>(settings.force_sd.size())),
        step_(forced, params, 1e-3 * settings.force_sd.cwiseMax(1e-9)),
        params_(params),
        sensors_(has_sensor_effects(plain)),
        sd_(nx_, settings.unlisted_sd) {
    for (std::uint32_t c = 0; c < plain.measurement_count; ++c)
      sd_[plain.measured_state[c]] = std::max(plain.measurement_sd[c], kExact);
  }

  /// False: it ran away. `keep`: the passes, for the way back.
  bool forward(const Grid& grid, bool keep) {
    passes_.clear();
    first_ = 0;
    while (first_ < grid.points() && !begins(grid, first_)) ++first_;
    if (first_ + 2 > grid.points()) return true;
    begin(grid);
    step_.begin(grid, first_);
    for (std::size_t point = first_; point + 1 < grid.points(); ++point) {
      measure(grid, point);
      if (!predict(grid, point, keep)) return false;
    }
    measure(grid, grid.points() - 1);
    return true;
  }

  /// From the last point to the first: each, given the one after it.
  void back(SmoothedGrid& out) const {
    out.first = first_;
    out.log_likelihood = log_likelihood();
    out.misfit = count_ > 0 ? std::sqrt(squares_ / count_) : 0.0;
    const auto count = static_cast<Eigen::Index>(passes_.empty() ? 0 : passes_.size() + 1);
    for (Matrix* m : {&out.state, &out.state_variance, &out.filtered}) m->resize(nx_, count);
    for (Matrix* m : {&out.force, &out.force_variance}) m->resize(nf_, count);
    if (count == 0) return;
    Vector z = z_;
    Matrix p = p_;
    put(count - 1, z_, z, p, out);
    for (Eigen::Index k = count - 1; k-- > 0;) {
      const Pass& pass = passes_[static_cast<std::size_t>(k)];
      const Matrix gain = pass.p_next.ldlt().solve(pass.slope * pass.p).transpose();
      z = pass.z + gain * difference(z, pass.next);
      p = pass.p + gain * (p - pass.p_next) * gain.transpose();
      put(k, pass.z, z, p, out);
    }
  }
  double log_likelihood() const { return -0.5 * (squares_ + logs_); }

 private:
  /// The state that would be read so.
  double logged(const Grid& grid, std::uint32_t i, std::size_t point) const {
    if (grid.state[i].empty()) return kNaN;
    if (!sensors_) return grid.state[i][point];
    const double place = static_cast<double>(point) + late_by_s(plain_, i, params_.data()) / grid.period_s;
    const auto row = static_cast<std::size_t>(place);
    const double share = place - static_cast<double>(row);
    if (row + (share > 0 ? 1 : 0) >= grid.points()) return kNaN;
    double reading = grid.state[i][row];
    if (share > 0) reading += share * state_difference(model_, i, grid.state[i][row + 1], reading);
    return state_of_measured(plain_, params_.data(), i, reading);
  }
  bool reads(std::uint32_t i) const { return std::isfinite(sd_[i]); }
  /// Of the state, where it is `at`.
  double sd_of(std::uint32_t i, double at) const {
    return sensors_ ? sd_[i] / measurement_map(plain_, i, {at}, params_.data()).gain : sd_[i];
  }
  const tiller_joint_t* joint_of_speed(std::uint32_t i) const {
    for (std::uint32_t j = 0; j < model_.joint_count; ++j)
      if (model_.joints[j].velocity == i && model_.joints[j].position != TILLER_NO_POSITION) return &model_.joints[j];
    return nullptr;
  }
  std::size_t span(const Grid& grid) const {
    const auto periods = static_cast<std::size_t>(std::round(kBeginSpan_s / grid.period_s));
    return std::max(kLeastBeginPeriods, periods);
  }

  bool begins(const Grid& grid, std::size_t point) const {
    for (std::uint32_t i = 0; i < nx_; ++i) {
      if (reads(i) && std::isfinite(logged(grid, i, point))) continue;
      const tiller_joint_t* const joint = joint_of_speed(i);
      if (joint && reads(joint->position)) {
        const std::size_t ahead = std::min(point + span(grid), grid.points() - 1);
        if (!std::isfinite(logged(grid, joint->position, point) + logged(grid, joint->position, ahead))) return false;
      } else if (reads(i) && has_readings(grid, i)) {
        return false;
      }
    }
    return true;
  }
  static bool has_readings(const Grid& grid, std::uint32_t i) {
    return std::any_of(grid.state[i].begin(), grid.state[i].end(), [](double v) { return std::isfinite(v); });
  }

  void begin(const Grid& grid) {
    z_ = Vector::Zero(nx_ + nf_);
    p_ = Matrix::Zero(nx_ + nf_, nx_ + nf_);
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double value = logged(grid, i, first_);
      z_(i) = std::isfinite(value) ? value : plain_.initial_state[i];
      const bool measured = reads(i) && std::isfinite(value);
      const double sd = measured ? kWide * sd_of(i, value) : std::max(plain_.initial_state_sd[i], kExact);
      p_(i, i) = sd * sd;
    }
    for (std::uint32_t i = 0; i < nx_; ++i)
      if (const tiller_joint_t* const joint = joint_of_speed(i))
        if (reads(joint->position) && !(reads(i) && std::isfinite(logged(grid, i, first_)))) begin_speed(grid, *joint);
    // a force is unknown to what it walks in a second
    for (std::uint32_t j = 0; j < nf_; ++j) p_(nx_ + j, nx_ + j) = std::pow(settings_.force_sd(j), 2);
  }
  /// The speed of a joint whose position alone is measured: the mean until a little later, known as badly as that.
  void begin_speed(const Grid& grid, const tiller_joint_t& joint) {
    const std::size_t ahead = std::min(first_ + span(grid), grid.points() - 1);
    const double span_s = static_cast<double>(ahead - first_) * grid.period_s;
    const double to = logged(grid, joint.position, ahead), from = logged(grid, joint.position, first_);
    z_(joint.velocity) = state_difference(model_, joint.position, to, from) / span_s;
    const double doubt = std::fabs(z_(joint.velocity)) + 10 * sd_of(joint.position, from) / span_s;
    p_(joint.velocity, joint.velocity) += doubt * doubt;
  }

  /// One measured state after the other.
  void measure(const Grid& grid, std::size_t point) {
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double reading = logged(grid, i, point);
      if (!reads(i) || !std::isfinite(reading)) continue;
      const double innovation = state_difference(model_, i, reading, z_(i)),
                   variance = p_(i, i) + std::pow(sd_of(i, reading), 2);
      if (point > first_) {  // the first reading is what the filter began with
        squares_ += innovation * innovation / variance;
        logs_ += std::log(variance);
        count_ += 1;
      }
      const Vector column = p_.col(i);
      z_ += column * (innovation / variance);
      p_ -= column * column.transpose() / variance;
    }
  }

  bool predict(const Grid& grid, std::size_t point, bool keep) {
    Vector next;
    Matrix rows, slope = Matrix::Identity(nx_ + nf_, nx_ + nf_);
    if (!step_.run(grid, point, z_, next, rows)) return false;
    slope.topRows(nx_) = rows;
    Matrix p_next = slope * p_ * slope.transpose();
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double least = kRegular * (1.0 + std::fabs(next(i)));
      p_next(i, i) += std::pow(settings_.process_scale * plain_.process_sd[i], 2) * grid.period_s + least * least;
    }
    for (std::uint32_t j = 0; j < nf_; ++j)
      p_next(nx_ + j, nx_ + j) += std::pow(settings_.force_sd(j), 2) * grid.period_s;
    p_next = 0.5 * (p_next + p_next.transpose()).eval();
    Vector z_next = z_;
    z_next.head(nx_) = next;
    if (keep) passes_.push_back({z_, z_next, p_, p_next, std::move(slope)});
    z_ = std::move(z_next);
    p_ = std::move(p_next);
    return z_.allFinite() && p_.allFinite() && z_.cwiseAbs().maxCoeff() < kLargest;
  }

  Vector difference(const Vector& a, const Vector& b) const {
    Vector d = a - b;
    for (std::uint32_t i = 0; i < nx_; ++i) d(i) = state_difference(model_, i, a(i), b(i));
    return d;
  }
  void put(Eigen::Index k, const Vector& filtered, const Vector& z, const Matrix& p, SmoothedGrid& out) const {
    out.state.col(k) = z.head(nx_);
    out.state_variance.col(k) = p.diagonal().head(nx_).cwiseMax(0.0);
    out.filtered.col(k) = filtered.head(nx_);
    out.force.col(k) = z.tail(nf_);
    out.force_variance.col(k) = p.diagonal().tail(nf_).cwiseMax(0.0);
  }

  const tiller_config_t& plain_;
  const tiller_model_t& model_;
  const SmoothSettings& settings_;
  std::uint32_t nx_, nf_;
  ForcedStep step_;
  const std::vector<double>& params_;
  bool sensors_;
  std::vector<double> sd_;  // (nx) of the sensors; NaN: not read
  std::size_t first_ = 0;
  Vector z_;
  Matrix p_;
  std::vector<Pass> passes_;
  double squares_ = 0, logs_ = 0, count_ = 0;
};

/// The configuration that the filter steps: `forced` is made where forces are wanted.
const tiller_config_t* stepped(const tiller_config_t& config, const SmoothSettings& settings, Config& forced,
                               std::string& error) {
  if (settings.force_sd.size() == 0) return &config;
  return with_forces(config, forced, error) ? &forced : nullptr;
}

}  // namespace

bool smooth_grid(const tiller_config_t& config, const std::vector<double>& params, const Grid& grid,
                 const SmoothSettings& settings, SmoothedGrid& out, std::string& error) {
  Config forced;
  const tiller_config_t* const with = stepped(config, settings, forced, error);
  if (!with) return false;
  Filter filter(config, *with, params, settings);
  if (filter.forward(grid, true)) {
    filter.back(out);
    if (out.state.allFinite() && out.force.allFinite()) return true;
  }
  error = "the model runs away on " + grid.path + "; its parameters are far off: `tiller identify` first";
  return false;
}

double filter_log_likelihood(const tiller_config_t& config, const std::vector<double>& params,
                             const std::vector<Grid>& grids, const SmoothSettings& settings) {
  Config forced;
  std::string error;
  const tiller_config_t* const with = stepped(config, settings, forced, error);
  if (!with) return -HUGE_VAL;
  Filter filter(config, *with, params, settings);
  for (const Grid& grid : grids)
    if (!filter.forward(grid, false)) return -HUGE_VAL;
  return filter.log_likelihood();
}

}  // namespace tiller::tools
