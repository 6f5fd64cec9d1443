#include "tools/gap/fallback.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "posterior/prior.hpp"
#include "tiller/tiller.h"
#include "tools/file_errors.hpp"
#include "tools/gap/prediction_error.hpp"
#include "tools/grid_rollout.hpp"

namespace tiller::tools::gap {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr int kSteps = 5;       // Gauss-Newton's; the forces enter nearly linearly, so that three nearly do
constexpr int kPriorGrid = 33;  // deviations tried, evenly in the logarithm
constexpr double kPriorLow = 1e-3, kPriorHigh = 3.0;  // times the typical force
constexpr double kNoiseLow = 1e-4, kNoiseHigh = 1.0;  // of the random force, times the typical force
constexpr double kReach = 1.5;  // of the features over the velocities in the data: faster is elsewhere
// Spacings over that at which the four bumps stand on the data, and velocity scales over the largest velocity.
constexpr double kSpacings[] = {0.7, 1.1}, kVelocityScales[] = {0.03, 0.15, 0.6, 2.0};
constexpr double kLeastShare = 1e-6;  // of the likelihood that is believed
constexpr double kHorizon_s = 1.0;    // over which the law is asked to foretell rollouts

/// Where the joint went in the logs.
struct Travel {
  double low = HUGE_VAL, high = -HUGE_VAL, speed = 0, acceleration = 0, period_s = 0;
};

Travel travel_of(const tiller_config_t& config, const std::vector<Grid>& grids, const tiller_joint_t& joint) {
  Travel t;
  std::vector<double> speeds;
  double squares = 0.0, count = 0.0;
  for (const Grid& grid : grids) {
    t.period_s = grid.period_s;
    double before = NAN;
    const std::size_t every = 5;
    for (std::size_t point = 0; point < grid.points(); point += every) {
      double state[TILLER_MAX_STATES];
      const bool known = estimate_state(grid, config, point, 0.05, state);
      const double speed = known ? state[joint.velocity] : NAN;
      if (known) {
        t.low = std::min(t.low, state[joint.position]);
        t.high = std::max(t.high, state[joint.position]);
        speeds.push_back(std::fabs(speed));
        if (std::isfinite(before)) {
          const double a = (speed - before) / (every * grid.period_s);
          squares += a * a;
          ++count;
        }
      }
      before = speed;
    }
  }
  if (speeds.empty() || count == 0.0) return t;
  t.speed = *std::max_element(speeds.begin(), speeds.end());
  t.acceleration = std::sqrt(squares / count);
  return t;
}

std::vector<ResidualScales> scales_of(const Travel& t, bool is_angle) {
  const double range = t.high - t.low;
  ResidualScales s;
  s.period = is_angle ? 2.0 * 3.14159265358979323846 : 100.0 * std::max(range, 1e-6);
  s.centre = 0.5 * (t.low + t.high);
  s.velocity_reach = kReach * t.speed;
  std::vector<ResidualScales> all;
  for (const double spacing : kSpacings)
    for (const double velocity : kVelocityScales) {
      // four bumps once round at most
      s.spacing = std::min(spacing * range / 3.0, s.period / 4.0);
      s.velocity_scale = velocity * t.speed;
      all.push_back(s);
    }
  return all;
}

/// The regression for one set of widths.
class Regression {
 public:
  Regression(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params, std::uint32_t first)
      : config_(config), first_(first), params_(params, params + first) {
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

  /// Forces ~ N(0, sd^2).
  void set_prior(double sd) { precision_.tail(kResidualForces).setConstant(1.0 / (sd * sd)); }
  double prior_sd() const { return 1.0 / std::sqrt(precision_(precision_.size() - 1)); }

  PredictionSums pass(const Vector& z, double force_sd) const {
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

  /// Parameters of z, and differences to take derivatives by.
  void at(const Vector& z, std::vector<double>& params, std::vector<double>& step) const {
    params = params_;
    step.resize(free_.size());
    for (std::size_t j = 0; j < free_.size(); ++j) {
      const tiller_prior_t& prior = config_.priors[free_[j]];
      params[free_[j]] = from_coordinate(prior, z(static_cast<Eigen::Index>(j)));
      step[j] = 1e-4 * (prior.kind == tiller_prior_log_normal ? params[free_[j]] : prior_spread(prior));
    }
  }

  /// How wrong rollouts of kHorizon_s from the filter's states are, and what they depend on: rows of error, variance
  /// that the state's doubt and the sensor leave, and slope along each parameter of z (d).
  struct Foretold {
    Vector error, variance;
    Matrix slope;
    double rms_sigma = HUGE_VAL;  ///< errors in the sensor's deviations
  };
  Foretold foretell(const std::vector<Grid>& grids, double force_sd) const;

  double penalty(const Vector& z) const { return 0.5 * (z - centre_).cwiseAbs2().dot(precision_); }
  double objective(const PredictionSums& s, const Vector& z) const {
    return s.finite ? penalty(z) - s.log_likelihood : HUGE_VAL;
  }

  /// The deviation of the forces' prior by the evidence of the expansion at z.
  void choose_prior(const PredictionSums& at, const Vector& z, double typical) {
    double best = -HUGE_VAL, best_sd = prior_sd();
    for (int k = 0; k < kPriorGrid; ++k) {
      const double sd = typical * kPriorLow * std::pow(kPriorHigh / kPriorLow, k / (kPriorGrid - 1.0));
      set_prior(sd);
      const double value = evidence(at, z);
      if (value > best) best = value, best_sd = sd;
    }
    set_prior(best_sd);
  }

  /// Laplace's approximation of the log marginal likelihood from the expansion at z.
  double evidence(const PredictionSums& at, const Vector& z) const {
    const Vector pull = at.gradient - precision_.cwiseProduct(z - centre_);
    const Matrix whole = posterior_precision(at);
    const Eigen::LLT<Matrix> factor(whole);
    if (factor.info() != Eigen::Success) return -HUGE_VAL;
    const Vector diagonal = Matrix(factor.matrixL()).diagonal();
    return at.log_likelihood - penalty(z) + 0.5 * pull.dot(factor.solve(pull)) - diagonal.array().log().sum() +
           0.5 * precision_.array().log().sum();
  }
  Matrix posterior_precision(const PredictionSums& at, double share = 1.0, double wider = 1.0) const {
    Vector prior = precision_;
    prior.tail(kResidualForces) /= wider * wider;
    return share * at.information + Matrix(prior.asDiagonal());
  }

  /// Gauss-Newton with the step halved until the objective falls; the prior's deviation chosen along the way unless
  /// `typical` is 0.
  bool solve(double force_sd, double typical) {
    sums_ = pass(z_, force_sd);
    if (!sums_.finite) return false;
    for (int k = 0; k < kSteps; ++k) {
      if (typical > 0.0) choose_prior(sums_, z_, typical);
      const Vector pull = sums_.gradient - precision_.cwiseProduct(z_ - centre_);
      const Vector step = Eigen::LLT<Matrix>(posterior_precision(sums_)).solve(pull);
      const double now = objective(sums_, z_);
      bool moved = false;
      for (double share = 1.0; share > 0.05 && !moved; share *= 0.5) {
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

  /// The random force that is most likely at the present parameters, between `low` and `high`.
  double choose_force_sd(double low, double high) const {
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

  Vector z_;
  PredictionSums sums_;
  std::vector<std::uint32_t> free_;
  std::size_t own_ = 0;  // parameters beside the forces

 private:
  Vector inside(Vector z) const {
    for (std::size_t j = 0; j < own_; ++j) {
      const tiller_prior_t& prior = config_.priors[free_[j]];
      auto& value = z(static_cast<Eigen::Index>(j));
      value = std::min(std::max(value, coordinate_low(prior)), coordinate_high(prior));
    }
    return z;
  }

  tiller_config_t config_;
  std::uint32_t first_;
  std::vector<double> params_;
  Vector centre_, precision_;
  std::unique_ptr<PredictionError> error_;
};

Regression::Foretold Regression::foretell(const std::vector<Grid>& grids, double force_sd) const {
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
  Foretold out;
  if (!error.empty()) out.rms_sigma = std::sqrt(squares / static_cast<double>(error.size()));
  const auto rows = static_cast<Eigen::Index>(error.size());
  out.error = Eigen::Map<Vector>(error.data(), rows);
  out.variance = Eigen::Map<Vector>(variance.data(), rows);
  out.slope = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      slope.data(), rows, static_cast<Eigen::Index>(d));
  return out;
}

/// How far the law must be widened so that rollouts from it are as wrong as it says: what the features cannot express
/// is wrong in the same way wherever the robot comes by, which a random force is not.
struct Widening {
  double share = 1.0;  ///< of the likelihood that is believed
  double wider = 1.0;  ///< the forces' prior deviation, where disbelief alone does not do
};
Widening widening_of(const Regression& r, const Regression::Foretold& f, double typical) {
  Widening w;
  if (f.error.size() == 0) return w;
  const auto too_narrow = [&](double share, double wider) {
    const Matrix covariance =
        r.posterior_precision(r.sums_, share, wider).llt().solve(Matrix::Identity(r.z_.size(), r.z_.size()));
    const Vector spread = (f.slope * covariance).cwiseProduct(f.slope).rowwise().sum() + f.variance;
    return f.error.cwiseAbs2().cwiseQuotient(spread).mean() > 1.0;
  };
  // the exponent at which a falling function of e^t has its step
  const auto seek = [](double low, double high, const auto& narrow) {
    for (int k = 0; k < 30; ++k) {
      const double middle = 0.5 * (low + high);
      (narrow(std::exp(middle)) ? low : high) = middle;
    }
    return std::exp(high);
  };
  if (!too_narrow(1.0, 1.0)) return w;
  w.share = 1.0 / seek(0.0, -std::log(kLeastShare), [&](double inverse) { return too_narrow(1.0 / inverse, 1.0); });
  if (!too_narrow(w.share, 1.0)) return w;
  const double most = std::max(1.0, typical / r.prior_sd());
  w.wider = seek(0.0, std::log(most), [&](double wider) { return too_narrow(w.share, wider); });
  return w;
}

/// Everything of the fit from a regression at its optimum.
void take(const Regression& r, const std::vector<Grid>& grids, double force_sd, double typical, double period_s,
          ResidualFit& fit) {
  const auto d = static_cast<Eigen::Index>(r.free_.size());
  const Regression::Foretold foretold = r.foretell(grids, force_sd);
  fit.rollout_ratio = foretold.rms_sigma / fit.rollout_ratio;
  const Widening w = widening_of(r, foretold, typical);
  const Matrix covariance = r.posterior_precision(r.sums_, w.share, w.wider).llt().solve(Matrix::Identity(d, d));
  fit.believed = w.share;
  fit.at = r.free_;
  fit.mean.assign(r.z_.data(), r.z_.data() + d);
  const Matrix symmetric = 0.5 * (covariance + covariance.transpose());
  fit.covariance.assign(symmetric.data(), symmetric.data() + d * d);
  fit.prior_sd = w.wider * r.prior_sd();
  fit.force_sd = force_sd;
  for (Eigen::Index j = d - kResidualForces; j < d; ++j) {
    tiller_prior_t& prior = fit.config.priors[r.free_[static_cast<std::size_t>(j)]];
    prior.a = r.z_(j);
    prior.b = std::sqrt(covariance(j, j));
  }
  for (std::uint32_t i = 0; i < fit.config.model->state_count; ++i) {
    const double kick = force_sd * r.sums_.response(i);
    fit.config.process_sd[i] = std::sqrt(fit.config.process_sd[i] * fit.config.process_sd[i] + kick * kick / period_s);
  }
  GaussianMixture mixture;
  mixture.dimension = static_cast<std::uint32_t>(d);
  mixture.weight = {1.0};
  mixture.mean = fit.mean;
  mixture.covariance = fit.covariance;
  fit.joint_prior = std::make_shared<JointPrior>(mixture);
}

}  // namespace

bool with_residual(const tiller_config_t& config, std::uint32_t joint, const ResidualScales& scales, double prior_sd,
                   tiller_config_t& out, std::string& error) {
  const EffectInfo& info = effect_info(tiller_effect_residual);
  if (joint >= config.model->joint_count || !port_fits(info, joint, *config.model)) {
    error = "residual: the model has no joint " + std::to_string(joint) + " with a position";
    return false;
  }
  if (config.effect_count >= TILLER_MAX_EFFECTS ||
      config.param_count + static_cast<std::uint32_t>(info.param_count) > TILLER_MAX_PARAMS) {
    error = "residual: needs " + std::to_string(info.param_count) + " parameters more than the " +
            std::to_string(config.param_count) + " of the configuration; " + std::to_string(TILLER_MAX_PARAMS) +
            " are the most";
    return false;
  }
  out = config;
  out.effects[out.effect_count++] = {tiller_effect_residual, joint};
  const double widths[kResidualScales] = {scales.centre, scales.spacing, scales.period, scales.velocity_scale,
                                          scales.velocity_reach};
  for (const double width : widths)
    out.priors[out.param_count++] = {tiller_prior_fixed, 0, width, 0.0, -HUGE_VAL, HUGE_VAL};
  for (std::uint32_t k = 0; k < kResidualForces; ++k)
    out.priors[out.param_count++] = {tiller_prior_normal, 0, 0.0, prior_sd, -HUGE_VAL, HUGE_VAL};
  out.prior_mixture = nullptr;
  return true;
}

bool fit_residual(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params,
                  std::uint32_t joint, ResidualFit& fit, std::string& error) {
  tiller_config_t extended;
  if (!with_residual(config, joint, {}, 1.0, extended, error)) return false;
  const tiller_joint_t& port = config.model->joints[joint];
  const Travel travel = travel_of(config, grids, port);
  if (!(travel.speed > 0.0 && travel.acceleration > 0.0)) {
    error = std::string("residual: the logs never move ") + port.name + ", or are too short to tell";
    return false;
  }
  const bool is_angle = ((config.model->angle_mask >> port.position) & 1u) != 0;
  double best = -HUGE_VAL, nominal = -HUGE_VAL, typical = 0.0, force_sd = 0.0;
  for (const ResidualScales& scales : scales_of(travel, is_angle)) {
    with_residual(config, joint, scales, 1.0, extended, error);
    Regression r(extended, grids, params, config.param_count);
    if (typical == 0.0) {
      // what accelerates the joint as the data do
      const PredictionSums at = r.pass(r.z_, 0.1);
      const double response = at.response(port.velocity);
      typical = response > 0.0 ? travel.acceleration * travel.period_s / response : 0.0;
      if (!(typical > 0.0)) {
        error = "residual: a force at the joint moves nothing; the nominal model is unusable";
        return false;
      }
      // the model without it: forces held at nothing
      r.set_prior(1e-6 * typical);
      for (int pass = 0; pass < 2; ++pass) {
        force_sd = pass == 0 ? 0.1 * typical : r.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
        if (!r.solve(force_sd, 0.0)) break;
      }
      if (r.sums_.finite) {
        nominal = r.evidence(r.sums_, r.z_);
        fit.rollout_ratio = r.foretell(grids, force_sd).rms_sigma;
      }
      std::vector<double> step;
      r.at(r.z_, fit.nominal, step);
      fit.nominal.resize(config.param_count);
      Regression first(extended, grids, params, config.param_count);
      first.set_prior(0.3 * typical);
      if (first.solve(0.1 * typical, typical))
        force_sd = first.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
    }
    r.set_prior(0.3 * typical);
    if (!r.solve(force_sd, typical)) continue;
    const double evidence = r.evidence(r.sums_, r.z_);
    if (!(evidence > best)) continue;
    best = evidence;
    fit.scales = scales;
  }
  if (!std::isfinite(best)) {
    error = "residual: no fit: the model's prediction errors have no bound on these logs";
    return false;
  }
  fit.joint = joint;
  fit.first = config.param_count;
  with_residual(config, joint, fit.scales, 1.0, fit.config, error);
  Regression r(fit.config, grids, params, config.param_count);
  r.set_prior(0.3 * typical);
  for (int pass = 0; pass < 2; ++pass) {
    if (!r.solve(force_sd, typical)) {
      error = "residual: no fit: the model's prediction errors have no bound on these logs";
      return false;
    }
    if (pass == 0) force_sd = r.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
  }
  // the best of several widths stands for all of them
  fit.log_evidence = r.evidence(r.sums_, r.z_) - std::log(static_cast<double>(scales_of(travel, is_angle).size()));
  fit.evidence_nats = fit.log_evidence - nominal;
  fit.after_sigma = std::sqrt(r.sums_.squared / r.sums_.count);
  Vector without = r.z_;
  without.tail(kResidualForces).setZero();
  const PredictionSums before = r.pass(without, force_sd);
  fit.before_sigma = before.finite ? std::sqrt(before.squared / before.count) : HUGE_VAL;
  take(r, grids, force_sd, typical, travel.period_s, fit);
  return true;
}

std::string residual_toml(const ResidualFit& fit) {
  const EffectInfo& info = effect_info(tiller_effect_residual);
  std::string text = "[[effects]]\nkind = \"residual\"\nport = \"";
  text += fit.config.model->joints[fit.joint].name;
  text += "\"\n";
  for (int k = 0; k < info.param_count; ++k) {
    const tiller_prior_t& prior = fit.config.priors[fit.first + static_cast<std::uint32_t>(k)];
    text += std::string(info.params[k].name) + " = ";
    text += prior.kind == tiller_prior_fixed
                ? number_text(prior.a)
                : "{ normal = [" + number_text(prior.a) + ", " + number_text(prior.b) + "] }";
    text += "\n";
  }
  return text;
}

StoredPosterior residual_posterior(const ResidualFit& fit, const Words& params, const std::string& robot) {
  StoredPosterior out;
  out.model = fit.config.model->name;
  for (const std::uint32_t i : fit.at) {
    out.params.push_back(params[i]);
    out.is_logarithm.push_back(fit.config.priors[i].kind == tiller_prior_log_normal);
  }
  out.mixture.dimension = static_cast<std::uint32_t>(fit.at.size());
  out.mixture.weight = {1.0};
  out.mixture.mean = fit.mean;
  out.mixture.covariance = fit.covariance;
  out.robot = robot;
  out.created_by = std::string("tiller ") + tiller_version();
  return out;
}

}  // namespace tiller::tools::gap
