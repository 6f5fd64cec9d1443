#pragma once

#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/gap/fit/scales.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

constexpr std::size_t kMostUnseen = 4;  ///< two rotors

/// A parameter that a fit may move.
struct FreeParam {
  std::uint32_t index = 0;  ///< in the configuration's parameters
  double low = 0, high = 0;
  double scale = 1;      ///< typical magnitude
  tiller_prior_t prior;  ///< counts unless fixed or uniform
};

/// The robot file's model with effects added: what a fit is made of.
struct Hypothesis {
  Config config;
  StepSetup setup;
  std::vector<EffectAt> added;
  std::vector<FreeParam> free;  ///< the model's inferred ones, then all of the added effects'
  bool sensors = false;         ///< an effect changes what is measured
  bool late = false;            ///< by delays, too: a window's first readings are of before it
  bool follows = false;         ///< an effect has states that follow the motion
  /// Rows of effect states that neither commands nor the measured path tell: a rotor behind a spring or a play rings on
  /// its own. Their place at a window's start is fitted with its start state, a supply's load where the log begins. The first kMostUnseen of them.
  std::vector<std::uint32_t> unseen;
  std::uint32_t own_params = 0;  ///< parameters of the robot file's own model and effects
  std::size_t freedom = 0;       ///< free parameters; a changed one counts twice, for it was free before
  std::vector<double> before;    ///< (free x free) of half the cost: what logs of before say; empty without
  std::vector<double> centre;    ///< (free) where that is least
};

/// False where the effects do not fit into the runtime's limits or the model's ports.
bool make_hypothesis(const tiller_config_t& nominal, const std::vector<EffectAt>& added, const Scales* scales,
                     Hypothesis& out);

/// Centre of the robot file's priors (np).
std::vector<double> prior_centre(const tiller_config_t& config);

/// Square of the parameter's distance from its prior in deviations; 0 for a uniform one. `slope`, `curvature`: of half
/// of it.
double prior_penalty(const FreeParam& param, double value, double* slope, double* curvature);

/// What priors and logs of before add to half the cost's slope (free) and second derivative (free x free) at params.
void add_prior(const Hypothesis& hypothesis, const std::vector<double>& params, double* slope, double* curvature);

/// Twice what they add to half the cost; params (np) with a stride.
double penalty_of(const Hypothesis& hypothesis, const double* params, std::size_t stride);

/// As the robot file calls it: "mass_kg", "joint.friction_SI".
std::string param_name(const tiller_config_t& config, std::uint32_t param);

/// "coulomb_friction (joint)", "mass_kg changed"
std::string effect_text(const EffectAt& effect, const tiller_config_t& config);
std::string effects_text(const std::vector<EffectAt>& effects, const tiller_config_t& config);

}  // namespace tiller::tools::gap
