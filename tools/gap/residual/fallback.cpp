#include "tools/gap/residual/fallback.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "posterior/prior.hpp"
#include "tiller/config.hpp"
#include "tools/base/file_errors.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/gap/residual/residual_regression.hpp"

namespace tiller::tools::gap {
namespace {

constexpr const char* kNoFit = "residual: no fit: the model's prediction errors have no bound on these logs";

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double kNoiseLow = 1e-4, kNoiseHigh = 1.0;  // of the random force, times the typical force
constexpr double kReach = 1.5;  // of the features over the velocities in the data: faster is elsewhere
// Spacings over that at which the four bumps stand on the data, and velocity scales over the largest velocity.
constexpr double kSpacings[] = {0.7, 1.1}, kVelocityScales[] = {0.03, 0.15, 0.6, 2.0};
constexpr double kLeastShare = 1e-6;  // of the likelihood that is believed

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

/// How far the law must be widened so that rollouts from it are as wrong as it says: what the features cannot express
/// is wrong in the same way wherever the robot comes by, which a random force is not.
struct Widening {
  double share = 1.0;  ///< of the likelihood that is believed
  double wider = 1.0;  ///< the forces' prior deviation, where disbelief alone does not do
};
Widening widening_of(const ResidualRegression& r, const ResidualRegression::Prediction& f, double typical) {
  Widening w;
  if (f.error.size() == 0) return w;
  const auto too_narrow = [&](double share, double wider) {
    const Matrix covariance =
        r.posterior_precision(r.sums(), share, wider).llt().solve(Matrix::Identity(r.z().size(), r.z().size()));
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
void take(const ResidualRegression& r, const std::vector<Grid>& grids, double force_sd, double typical, double period_s,
          ResidualFit& fit) {
  const auto d = static_cast<Eigen::Index>(r.free().size());
  const ResidualRegression::Prediction predicted = r.predict(grids, force_sd);
  fit.rollout_ratio = predicted.rms_sigma / fit.rollout_ratio;
  const Widening w = widening_of(r, predicted, typical);
  const Matrix covariance = r.posterior_precision(r.sums(), w.share, w.wider).llt().solve(Matrix::Identity(d, d));
  fit.believed = w.share;
  fit.at = r.free();
  fit.mean.assign(r.z().data(), r.z().data() + d);
  const Matrix symmetric = 0.5 * (covariance + covariance.transpose());
  fit.covariance.assign(symmetric.data(), symmetric.data() + d * d);
  fit.prior_sd = w.wider * r.prior_sd();
  fit.force_sd = force_sd;
  for (Eigen::Index j = d - kResidualForces; j < d; ++j) {
    tiller_prior_t& prior = fit.config.priors[r.free()[static_cast<std::size_t>(j)]];
    prior.a = r.z()(j);
    prior.b = std::sqrt(covariance(j, j));
  }
  for (std::uint32_t i = 0; i < fit.config.model->state_count; ++i) {
    const double kick = force_sd * r.sums().response(i);
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
                   Config& out, std::string& error) {
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

namespace {

// What the logs say of the size of the force, before its shape is sought.
struct ForceSizes {
  double typical = 0.0;        // accelerates the joint as the data do
  double force_sd = 0.0;       // noise of the force
  double nominal = -HUGE_VAL;  // log evidence of the model without it
};

// `r` is of the first scales. False: the force moves nothing.
bool size_up(ResidualRegression& r, const tiller_config_t& config, const tiller_config_t& extended,
             const std::vector<Grid>& grids, const double* params, const tiller_joint_t& port, const Travel& travel,
             ForceSizes& sizes, ResidualFit& fit) {
  const PredictionSums at = r.pass(r.z(), 0.1);
  const double response = at.response(port.velocity);
  double& typical = sizes.typical;
  typical = response > 0.0 ? travel.acceleration * travel.period_s / response : 0.0;
  if (!(typical > 0.0)) return false;
  // the model without it: forces held at nothing
  r.set_prior(1e-6 * typical);
  for (int pass = 0; pass < 2; ++pass) {
    sizes.force_sd = pass == 0 ? 0.1 * typical : r.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
    if (!r.solve(sizes.force_sd, 0.0)) break;
  }
  if (r.sums().finite) {
    sizes.nominal = r.evidence(r.sums(), r.z());
    fit.rollout_ratio = r.predict(grids, sizes.force_sd).rms_sigma;
  }
  std::vector<double> step;
  r.at(r.z(), fit.nominal, step);
  fit.nominal.resize(config.param_count);
  ResidualRegression first(extended, grids, params, config.param_count);
  first.set_prior(0.3 * typical);
  if (first.solve(0.1 * typical, typical))
    sizes.force_sd = first.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
  return true;
}

// The scales of the largest evidence go into `fit`; false with a message where none fits.
bool choose_scales(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params,
                   std::uint32_t joint, const Travel& travel, const std::vector<ResidualScales>& all, ForceSizes& sizes,
                   ResidualFit& fit, std::string& error) {
  double best = -HUGE_VAL;
  Config extended;
  for (const ResidualScales& scales : all) {
    with_residual(config, joint, scales, 1.0, extended, error);
    ResidualRegression r(extended, grids, params, config.param_count);
    if (sizes.typical == 0.0 &&
        !size_up(r, config, extended, grids, params, config.model->joints[joint], travel, sizes, fit)) {
      error = "residual: a force at the joint moves nothing; the nominal model is unusable";
      return false;
    }
    r.set_prior(0.3 * sizes.typical);
    if (!r.solve(sizes.force_sd, sizes.typical)) continue;
    const double evidence = r.evidence(r.sums(), r.z());
    if (!(evidence > best)) continue;
    best = evidence;
    fit.scales = scales;
  }
  if (std::isfinite(best)) return true;
  error = kNoFit;
  return false;
}

}  // namespace

bool fit_residual(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params,
                  std::uint32_t joint, ResidualFit& fit, std::string& error) {
  Config extended;
  if (!with_residual(config, joint, {}, 1.0, extended, error)) return false;
  const tiller_joint_t& port = config.model->joints[joint];
  const Travel travel = travel_of(config, grids, port);
  if (!(travel.speed > 0.0 && travel.acceleration > 0.0)) {
    error = std::string("residual: the logs never move ") + port.name + ", or are too short to tell";
    return false;
  }
  const bool is_angle = ((config.model->angle_mask >> port.position) & 1u) != 0;
  const std::vector<ResidualScales> all = scales_of(travel, is_angle);
  ForceSizes sizes;
  if (!choose_scales(config, grids, params, joint, travel, all, sizes, fit, error)) return false;

  fit.joint = joint;
  fit.first = config.param_count;
  with_residual(config, joint, fit.scales, 1.0, fit.config, error);
  ResidualRegression r(fit.config, grids, params, config.param_count);
  const double typical = sizes.typical;
  double force_sd = sizes.force_sd;
  r.set_prior(0.3 * typical);
  for (int pass = 0; pass < 2; ++pass) {
    if (!r.solve(force_sd, typical)) {
      error = kNoFit;
      return false;
    }
    if (pass == 0) force_sd = r.choose_force_sd(kNoiseLow * typical, kNoiseHigh * typical);
  }
  // the best of several widths stands for all of them
  fit.log_evidence = r.evidence(r.sums(), r.z()) - std::log(static_cast<double>(all.size()));
  fit.evidence_nats = fit.log_evidence - sizes.nominal;
  fit.after_sigma = std::sqrt(r.sums().squared / r.sums().count);
  Vector without = r.z();
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
                ? number_text(as_written(prior.a))
                : "{ normal = [" + number_text(as_written(prior.a)) + ", " + number_text(prior.b) + "] }";
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
