#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "effects/residual.hpp"
#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/robot/joint_prior.hpp"
#include "tools/robot/posterior_file.hpp"

// When nothing in the catalogue fits: the effect `residual` with what the logs tell of it.

namespace tiller::tools::gap {

constexpr std::uint32_t kResidualScales = 5, kResidualForces = 9;

/// Centre and widths of a residual's features, in the order of its parameters (effects/residual.hpp).
struct ResidualScales {
  double centre = 0, spacing = 1, period = 1, velocity_scale = 1, velocity_reach = 1;
};

/// The posterior of the residual after the logs.
struct ResidualFit {
  std::uint32_t joint = 0;
  ResidualScales scales;
  std::uint32_t first = 0;         ///< of the effect's 14 parameters among the configuration's
  std::vector<std::uint32_t> at;   ///< (d) the inferred parameters, the nine forces last
  std::vector<double> mean;        ///< (d) in their coordinates (the logarithm for a log-normal prior)
  std::vector<double> covariance;  ///< (d x d)
  double prior_sd = 0;             ///< of each force before the logs, N or N m: what is left where no data are
  double force_sd = 0;             ///< random force left, constant over a period, N or N m
  double believed = 1;             ///< share of the likelihood that the law believes (see fit_residual)
  double log_evidence = 0;         ///< marginal likelihood: compares joints
  double evidence_nats = 0;        ///< the same over that of the model without it
  double rollout_ratio = NAN;      ///< errors of rollouts of 1 s on these logs, with it over without it
  std::vector<double> nominal;     ///< (np of the configuration without it) refitted without the effect
  double before_sigma = 0, after_sigma = 0;  ///< rms of one-step innovations, normalised by what is left at the end

  /// The configuration with the effect: widths fixed, forces normal (these means and deviations, their correlations
  /// left out), process_sd raised by what force_sd does to the state.
  Config config{};
  /// The joint law of all inferred parameters, for config.prior_mixture (not set: it would point into this object).
  std::shared_ptr<const JointPrior> joint_prior;
};

/// Adds the effect with fixed widths and forces ~ N(0, prior_sd^2). False with a sentence in `error` where there is no
/// room for it (TILLER_MAX_EFFECTS, TILLER_MAX_PARAMS) or the joint has no position.
bool with_residual(const tiller_config_t& config, std::uint32_t joint, const ResidualScales& scales, double prior_sd,
                   Config& out, std::string& error);

/// Bayesian regression of the residual force at `joint`, jointly with the configuration's inferred parameters under
/// their priors: prediction errors of an extended Kalman filter (encoders suffice), Gauss-Newton around the optimum
/// (Laplace's approximation; the forces enter nearly linearly), the forces' prior deviation, the random force left
/// over and the features' widths by marginal likelihood (MacKay 1992, Bayesian interpolation). The law is then widened
/// until rollouts of 1 s from its particles are as wrong on these logs as it says, without any random force, which a
/// planner's rollouts do not have: the likelihood counts with the exponent `believed` (Miller and Dunson 2019, Robust
/// Bayesian inference via coarsening). Directions that no data tell keep the prior,
/// which is widened itself where that does not do: where the missing physics is no force over position and velocity.
/// `params` (np of `config`): where to begin, as the nominal fit gave them. Deterministic. A fifth of a second for a
/// pendulum's 48 s at 100 Hz. False with a sentence in `error`.
bool fit_residual(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params,
                  std::uint32_t joint, ResidualFit& fit, std::string& error);

/// The section of the robot file: [[effects]] with numbers for the widths and normal priors for the forces. Its text
/// ends in a line feed. The correlations are not in it: write residual_posterior() beside it and name that file with
/// `tiller run --posterior`.
std::string residual_toml(const ResidualFit& fit);

/// The joint law as a posterior file for the robot file with that section. `params`: names of all of fit.config's
/// parameters, as RobotNames::params has them.
StoredPosterior residual_posterior(const ResidualFit& fit, const Words& params, const std::string& robot);

}  // namespace tiller::tools::gap
