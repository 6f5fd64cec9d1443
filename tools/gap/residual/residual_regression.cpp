#include "tools/gap/residual/residual_regression.hpp"

#include <algorithm>

#include "posterior/prior.hpp"
#include "tools/gap/residual/fallback.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools::gap {
namespace {

constexpr int kSteps = 5;       // Gauss-Newton's; the forces enter nearly linearly, so that three nearly do
constexpr int kPriorGrid = 33;  // deviations tried, evenly in the logarithm
constexpr double kPriorLow = 1e-3, kPriorHigh = 3.0;  // times the typical force
constexpr double kHorizon_s = 1.0;                    // over which the law is asked to predict rollouts

}  // namespace

ResidualRegression::ResidualRegression(const tiller_config_t& config, const std::vector<Grid>& grids,
                                       const double* params, std::uint32_t first)
    : config_(config), params_(params, params + first) {
  for (std::uint32_t i = first; i < config.param_count; ++i) params_.push_back(config.priors[i].a);
  std::vector<std::uint32_t> forces;
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    if (config.priors[i].kind == tiller_prior_fixed) continue;
    free_.push_back(i);
    if (i > first) forces.push_back(i);
  }
  own_ = free_.size() - forces.size();
  const auto d = static_cast<Eigen::Index>(free_.size());
  z_.resize(d);
  centre_.resize(d);
  precision_.resize(d);
  for (std::size_t j = 0; j < free_.size(); ++j) {
    const tiller_prior_t& prior = config.priors[free_[j]];
    const auto i = static_cast<Eigen::Index>(j);
    z_(i) = to_coordinate(prior, params_[free_[j]]);
    centre_(i) = prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : to_coordinate(prior, prior.a);
    precision_(i) = 1.0 / (prior_spread(prior) * prior_spread(prior));
  }
  error_ = std::make_unique<PredictionError>(config_, grids, free_, forces);
}

void ResidualRegression::set_prior(double sd) { precision_.tail(kResidualForces).setConstant(1.0 / (sd * sd)); }

PredictionSums ResidualRegression::pass(const Vector& z, double force_sd) const {
  std::vector<double> params, step;
  at(z, params, step);
  PredictionSums sums = error_->run(params, step, force_sd);
  for (std::size_t j = 0; j < free_.size(); ++j) {  // by the coordinate
    const tiller_prior_t& prior = config_.priors[free_[j]];
    const auto i = static_cast<Eigen::Index>(j);
    const double slope = prior.kind == tiller_prior_log_normal ? params[free_[j]] : 1.0;
    sums.gradient(i) *= slope;
    sums.information.row(i) *= slope;
    sums.information.col(i) *= slope;
  }
  return sums;
}

void ResidualRegression::at(const Vector& z, std::vector<double>& params, std::vector<double>& step) const {
  params = params_;
  step.resize(free_.size());
  for (std::size_t j = 0; j < free_.size(); ++j) {
    const tiller_prior_t& prior = config_.priors[free_[j]];
    params[free_[j]] = from_coordinate(prior, z(static_cast<Eigen::Index>(j)));
    step[j] = 1e-4 * (prior.kind == tiller_prior_log_normal ? params[free_[j]] : prior_spread(prior));
  }
}

/// The deviation of the forces' prior by the evidence of the expansion at z.
void ResidualRegression::choose_prior(const PredictionSums& at, const Vector& z, double typical) {
  double best = -HUGE_VAL, best_sd = prior_sd();
  for (int k = 0; k < kPriorGrid; ++k) {
    const double sd = typical * kPriorLow * std::pow(kPriorHigh / kPriorLow, k / (kPriorGrid - 1.0));
    set_prior(sd);
    const double value = evidence(at, z);
    if (value > best) best = value, best_sd = sd;
  }
  set_prior(best_sd);
}

double ResidualRegression::evidence(const PredictionSums& at, const Vector& z) const {
  const Vector pull = at.gradient - precision_.cwiseProduct(z - centre_);
  const Matrix whole = posterior_precision(at);
  const Eigen::LLT<Matrix> factor(whole);
  if (factor.info() != Eigen::Success) return -HUGE_VAL;
  const Vector diagonal = Matrix(factor.matrixL()).diagonal();
  return at.log_likelihood - penalty(z) + 0.5 * pull.dot(factor.solve(pull)) - diagonal.array().log().sum() +
         0.5 * precision_.array().log().sum();
}

ResidualRegression::Matrix ResidualRegression::posterior_precision(const PredictionSums& at, double share,
                                                                   double wider) const {
  Vector prior = precision_;
  prior.tail(kResidualForces) /= wider * wider;
  return share * at.information + Matrix(prior.asDiagonal());
}

bool ResidualRegression::solve(double force_sd, double typical) {
  sums_ = pass(z_, force_sd);
  if (!sums_.finite) return false;
  for (int k = 0; k < kSteps; ++k) {
    if (typical > 0.0) choose_prior(sums_, z_, typical);
    const Vector pull = sums_.gradient - precision_.cwiseProduct(z_ - centre_);
    const Vector step = Eigen::LLT<Matrix>(posterior_precision(sums_)).solve(pull);
    const double now = objective(sums_, z_);
    bool moved = false;
    double share = 2.0;
    while (!moved && (share *= 0.5) > 0.05) {
      const Vector z = inside(z_ + share * step);
      const PredictionSums sums = pass(z, force_sd);
      if (!(objective(sums, z) < now)) continue;
      moved = true;
      z_ = z;
      sums_ = sums;
      if (now - objective(sums, z) < 0.01) return true;
    }
    if (!moved) return true;
  }
  return true;
}

double ResidualRegression::choose_force_sd(double low, double high) const {
  double from = std::log(low), to = std::log(high);
  const auto value = [&](double t) {
    const PredictionSums s = pass(z_, std::exp(t));
    return s.finite ? s.log_likelihood : -HUGE_VAL;
  };
  // golden section: the likelihood of a noise has one peak
  constexpr double kGolden = 0.6180339887498949;
  double left = to - kGolden * (to - from), right = from + kGolden * (to - from);
  double at_left = value(left), at_right = value(right);
  while (to - from > 0.3) {
    if (at_left >= at_right) {
      to = right, right = left, at_right = at_left;
      at_left = value(left = to - kGolden * (to - from));
    } else {
      from = left, left = right, at_left = at_right;
      at_right = value(right = from + kGolden * (to - from));
    }
  }
  return std::exp(0.5 * (from + to));
}

ResidualRegression::Vector ResidualRegression::inside(Vector z) const {
  for (std::size_t j = 0; j < own_; ++j) {
    const tiller_prior_t& prior = config_.priors[free_[j]];
    auto& value = z(static_cast<Eigen::Index>(j));
    value = std::min(std::max(value, coordinate_low(prior)), coordinate_high(prior));
  }
  return z;
}

ResidualRegression::Prediction ResidualRegression::predict(const std::vector<Grid>& grids, double force_sd) const {
  const tiller_model_t& model = *config_.model;
  const std::uint32_t nx = model.state_count, d = static_cast<std::uint32_t>(free_.size());
  const std::uint32_t lanes = (d + nx + kLanePadding) / kLanePadding * kLanePadding;
  std::vector<double> params, step;
  at(z_, params, step);
  GridRollout rollout(config_, lanes);
  for (std::uint32_t i = 0; i < config_.param_count; ++i) std::fill_n(rollout.params() + i * lanes, lanes, params[i]);
  for (std::uint32_t j = 0; j < d; ++j) rollout.params()[free_[j] * lanes + 1 + j] += step[j];
  const auto horizon = static_cast<std::size_t>(std::lround(kHorizon_s / config_.period_s));
  std::vector<double> error, variance, slope;
  double squares = 0.0;
  for (const Filtered& from : error_->filter(params, step, force_sd, std::max<std::size_t>(horizon / 2, 1))) {
    const Grid& grid = grids[from.grid];
    if (from.point + horizon >= grid.points()) continue;
    RolloutJob<double> job = rollout.job(grid, from.point, horizon);
    const std::vector<double> first = rollout.first_effect_state(grid, from.point);
    std::vector<double> state(std::size_t{nx} * lanes), path((horizon + 1) * nx * lanes);
    for (std::uint32_t i = 0; i < nx; ++i) {
      std::fill_n(&state[i * lanes], lanes, from.state(i));
      state[i * lanes + 1 + d + i] += 1e-3 * std::sqrt(from.covariance(i, i)) + 1e-9;
    }
    job.state = {state.data(), lanes};
    job.effect_state.data = first.data();
    job.trajectory = path.data();
    select_rollout(model).rollout_f64(model, job);
    for (std::uint32_t c = 0; c < config_.measurement_count; ++c) {
      const std::uint32_t i = config_.measured_state[c];
      const double* row = &path[(horizon * nx + i) * lanes];
      const double e = state_difference(model, i, grid.state[i][from.point + horizon], row[0]);
      Vector by_state(nx);
      for (std::uint32_t s = 0; s < nx; ++s)
        by_state(s) = (row[1 + d + s] - row[0]) / (state[s * lanes + 1 + d + s] - from.state(s));
      const double left =
          by_state.dot(from.covariance * by_state) + config_.measurement_sd[c] * config_.measurement_sd[c];
      if (!std::isfinite(e) || !std::isfinite(left)) continue;
      error.push_back(e);
      squares += e * e / (config_.measurement_sd[c] * config_.measurement_sd[c]);
      variance.push_back(left);
      for (std::uint32_t j = 0; j < d; ++j) {
        const tiller_prior_t& prior = config_.priors[free_[j]];
        const double chain = prior.kind == tiller_prior_log_normal ? params[free_[j]] : 1.0;
        slope.push_back((row[1 + j] - row[0]) / step[j] * chain);
      }
    }
  }
  Prediction out;
  if (!error.empty()) out.rms_sigma = std::sqrt(squares / static_cast<double>(error.size()));
  const auto rows = static_cast<Eigen::Index>(error.size());
  out.error = Eigen::Map<Vector>(error.data(), rows);
  out.variance = Eigen::Map<Vector>(variance.data(), rows);
  out.slope = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      slope.data(), rows, static_cast<Eigen::Index>(d));
  return out;
}

}  // namespace tiller::tools::gap
