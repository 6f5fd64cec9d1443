#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>

#include "planners/planner.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

// Every field that tiller_init relies on is spoiled, one at a time; the check must name that field.

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
using C = tiller::Config;

const double kRows[8] = {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};
const double kRowsWithNan[8] = {0.0, 1.0, 2.0, kNan, 4.0, 5.0, 6.0, 7.0};

/// A right obstacle, to be spoiled.
tiller_cost_term_t& obstacle(C& c) {
  c.cost.term_count = 1;
  c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 100.0, {0.5, -0.5, 0.1}};
  return c.terms[0];
}

void sqp_tree(C& c) {
  c.planner.kind = tiller_planner_sqp;
  c.planner.particles = 2;
  c.planner.shared_steps = 1;
  c.planner.closed_loop = 1;
}

/// A right demonstration of two periods of two states.
void demonstrate(C& c) {
  c.cost.demonstration_mean = c.cost.demonstration_root = kRows;
  c.cost.demonstration_steps = 2;
  c.cost.demonstration_weight = 1.0;
}

double no_cost(const double*, const double*, const double*, double, void*) { return 0.0; }

/// A right cost of one's own, new at every call.
tiller_own_cost_t& own(C& c) {
  static tiller_own_cost_t cost;
  cost = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, no_cost, nullptr, nullptr};
  c.cost.own = &cost;
  c.cost.own_weight = 1.0;
  return cost;
}

/// A right joint prior of the pendulum's two inferred parameters, new at every call.
struct Joint {
  double weight[2] = {0.25, 0.75};
  double mean[4] = {1.0, 0.05, 1.4, 0.15};
  double root[8] = {0.1, 0.0, -0.02, 0.01, 0.2, 0.0, 0.01, 0.02};
  tiller_mixture_t mixture{};
};
Joint& joint(C& c) {
  static Joint j;
  j = Joint{};
  j.mixture = {sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, 2, 2, j.weight, j.mean, j.root};
  c.prior_mixture = &j.mixture;
  return j;
}

constexpr float kNoWeights[4] = {2e9f, 0.0f, -INFINITY, NAN};

/// The rig's policy, to be spoilt, as the planner; and the network that it was given.
struct OwnPolicy {
  tiller_network_t network{};
  tiller_policy_t policy{};
};
OwnPolicy& own_policy(C& c) {
  static OwnPolicy own;
  own.policy = *c.policy;
  own.network = *own.policy.network;
  own.policy.network = &own.network;
  c.policy = &own.policy;
  c.planner.kind = tiller_planner_policy;
  return own;
}
tiller_policy_t& policy(C& c) { return own_policy(c).policy; }
tiller_network_t& policy_network(C& c) { return own_policy(c).network; }
/// As an output more has it: right but for the robot.
void add_output(C& c) {
  static const float weights[8] = {};
  tiller_network_t& network = policy_network(c);
  network.outputs = 2;
  network.weights = weights;
  network.weight_count = 8;
}

/// The exact engine: every state measured, the damping unknown.
void conjugate(C& c) {
  c.posterior.kind = tiller_posterior_conjugate;
  c.measurement_count = 2;
  c.measured_state[1] = 1;
  c.measurement_sd[1] = 0.02;
  c.priors[0] = {tiller_prior_fixed, 0, 1.2, 0, 0, 0};
  c.priors[2] = {tiller_prior_normal, 0, 0.1, 0.05, -kInf, kInf};
}

struct Spoiled {
  const char* field;
  tiller_status_t status;
  std::function<void(C&)> spoil;
};

const Spoiled kSpoiled[] = {
    {"size", tiller_status_version_mismatch, [](C& c) { c.size = 12; }},
    {"version", tiller_status_version_mismatch, [](C& c) { c.version = 0; }},
    {"model", tiller_status_no_model, [](C& c) { c.model = nullptr; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = 0.0; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = kNan; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = 150; }},
    {"substeps", tiller_status_bad_period, [](C& c) { c.substeps = 0; }},
    {"substeps", tiller_status_bad_period, [](C& c) { c.substeps = 65; }},
    {"integrator", tiller_status_bad_period, [](C& c) { c.integrator = 3; }},
    {"body.gravity_x_m_s2", tiller_status_bad_limit, [](C& c) { c.body.gravity_x_m_s2 = kNan; }},
    {"body.gravity_z_m_s2", tiller_status_bad_limit, [](C& c) { c.body.gravity_z_m_s2 = kInf; }},
    {"body.payload_kg", tiller_status_bad_limit, [](C& c) { c.body.payload_kg = -1.0; }},
    {"body.payload_kgm2", tiller_status_bad_limit, [](C& c) { c.body.payload_kgm2 = -1.0; }},
    {"effect_count", tiller_status_bad_dimension, [](C& c) { c.effect_count = TILLER_MAX_EFFECTS + 1; }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {99, 0};
     }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {0, 1};
     }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {3, 1};
     }},
    {"param_count", tiller_status_bad_dimension,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {0, 0};
     }},
    {"param_count", tiller_status_bad_dimension, [](C& c) { c.param_count = 2; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_fixed, 0, kNan, 0, 0, 0}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 2, 1}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 1, 1}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0, kInf}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_normal, 0, 1, 0, 0, 2}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_normal, 0, 0, 1, 9, 10}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_log_normal, 0, -1, 1, 0, 2}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_log_normal, 0, 1, 1, -2, -1}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2].kind = 4; }},
    {"priors[3]", tiller_status_bad_prior,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {tiller_effect_coulomb_friction, 0}, c.param_count = 4;
       c.priors[3] = {tiller_prior_uniform, 0, 0, 0, -0.1, 1};
     }},
    {"effects", tiller_status_bad_effect,
     [](C& c) {  // 1 s of delay is 50 periods
       c.effect_count = 1, c.effects[0] = {tiller_effect_input_delay, 0}, c.param_count = 4;
       c.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0, 1};
     }},
    {"prior_mixture.size", tiller_status_version_mismatch, [](C& c) { joint(c).mixture.size = 8; }},
    {"prior_mixture.version", tiller_status_version_mismatch, [](C& c) { joint(c).mixture.version = 2; }},
    {"prior_mixture.components", tiller_status_bad_prior, [](C& c) { joint(c).mixture.components = 0; }},
    {"prior_mixture.components", tiller_status_bad_prior, [](C& c) { joint(c).mixture.components = 65; }},
    {"prior_mixture.dimension", tiller_status_bad_prior, [](C& c) { joint(c).mixture.dimension = 3; }},
    {"prior_mixture.dimension", tiller_status_bad_prior,
     [](C& c) {
       joint(c).mixture.dimension = 0;
       c.priors[0] = c.priors[2] = {tiller_prior_fixed, 0, 0.1, 0, 0.1, 0.1};
     }},
    {"prior_mixture.weight", tiller_status_null_argument, [](C& c) { joint(c).mixture.weight = nullptr; }},
    {"prior_mixture.mean", tiller_status_null_argument, [](C& c) { joint(c).mixture.mean = nullptr; }},
    {"prior_mixture.root", tiller_status_null_argument, [](C& c) { joint(c).mixture.root = nullptr; }},
    {"prior_mixture.weight", tiller_status_bad_prior, [](C& c) { joint(c).weight[0] = kNan; }},
    {"prior_mixture.weight", tiller_status_bad_prior, [](C& c) { joint(c).weight[0] = 0.2501; }},
    {"prior_mixture.weight", tiller_status_bad_prior,
     [](C& c) {
       Joint& j = joint(c);
       j.weight[0] = -0.25, j.weight[1] = 1.25;
     }},
    {"prior_mixture.mean", tiller_status_bad_prior, [](C& c) { joint(c).mean[3] = kNan; }},
    {"prior_mixture.mean", tiller_status_bad_prior, [](C& c) { joint(c).mean[3] = 0.21; }},
    {"prior_mixture.root", tiller_status_bad_prior, [](C& c) { joint(c).root[3] = 0.0; }},
    {"prior_mixture.root", tiller_status_bad_prior, [](C& c) { joint(c).root[4] = kInf; }},
    {"prior_mixture.root", tiller_status_bad_prior, [](C& c) { joint(c).root[5] = 1e-9; }},
    {"prior_mixture.root", tiller_status_bad_prior, [](C& c) { joint(c).root[6] = kNan; }},
    {"measurement_count", tiller_status_bad_dimension, [](C& c) { c.measurement_count = 0; }},
    {"measurement_count", tiller_status_bad_dimension, [](C& c) { c.measurement_count = TILLER_MAX_MEASUREMENTS + 1; }},
    {"measured_state[0]", tiller_status_bad_dimension, [](C& c) { c.measured_state[0] = 2; }},
    {"measurement_sd[0]", tiller_status_bad_noise, [](C& c) { c.measurement_sd[0] = 0.0; }},
    {"measurement_sd[0]", tiller_status_bad_noise, [](C& c) { c.measurement_sd[0] = kInf; }},
    {"process_sd[0]", tiller_status_bad_noise, [](C& c) { c.process_sd[0] = -1.0; }},
    {"process_sd", tiller_status_bad_posterior,  // without any noise there is no scale to infer
     [](C& c) {
       conjugate(c);
       c.process_sd[0] = c.process_sd[1] = 0.0;
     }},
    {"initial_state[1]", tiller_status_bad_seed, [](C& c) { c.initial_state[1] = kNan; }},
    {"initial_state_sd[1]", tiller_status_bad_seed, [](C& c) { c.initial_state_sd[1] = -1.0; }},
    {"posterior.particles", tiller_status_bad_posterior, [](C& c) { c.posterior.particles = 24; }},
    {"posterior.particles", tiller_status_bad_posterior, [](C& c) { c.posterior.particles = 4112; }},
    {"posterior.window", tiller_status_bad_posterior, [](C& c) { c.posterior.window = 15; }},
    {"posterior.moves_per_tick", tiller_status_bad_posterior, [](C& c) { c.posterior.moves_per_tick = 4; }},
    {"posterior.moves_per_tick", tiller_status_bad_posterior, [](C& c) { c.posterior.moves_per_tick = 72; }},
    {"posterior.ess_fraction", tiller_status_bad_posterior, [](C& c) { c.posterior.ess_fraction = 0.0; }},
    {"posterior.noise_scale_shape", tiller_status_bad_posterior, [](C& c) { c.posterior.noise_scale_shape = kNan; }},
    {"planner.kind", tiller_status_bad_planner, [](C& c) { c.planner.kind = tiller_planner_kind_count; }},
    {"planner.fallback", tiller_status_bad_planner, [](C& c) { c.planner.fallback = tiller_planner_kind_count; }},
    {"policy", tiller_status_null_argument, [](C& c) { policy(c), c.policy = nullptr; }},
    {"policy.size", tiller_status_version_mismatch, [](C& c) { policy(c).size = 1; }},
    {"policy.version", tiller_status_version_mismatch, [](C& c) { policy(c).version = 0; }},
    {"policy.reads", tiller_status_bad_planner, [](C& c) { policy(c).reads = 0; }},
    {"policy.reads", tiller_status_bad_planner, [](C& c) { policy(c).reads = 32; }},
    {"policy.squash", tiller_status_bad_planner, [](C& c) { policy(c).squash = 2; }},
    {"policy.network", tiller_status_null_argument, [](C& c) { policy(c).network = nullptr; }},
    {"policy.network.inputs", tiller_status_bad_planner, [](C& c) { policy(c).reads = tiller_policy_goal; }},
    {"policy.network.inputs", tiller_status_bad_planner, [](C& c) { policy(c).reads |= tiller_policy_last_command; }},
    {"policy.network.size", tiller_status_version_mismatch, [](C& c) { policy_network(c).size = 1; }},
    {"policy.network.version", tiller_status_version_mismatch, [](C& c) { policy_network(c).version = 0; }},
    {"policy.network.outputs", tiller_status_bad_planner, add_output},
    {"policy.network.weight_count", tiller_status_bad_planner, [](C& c) { policy_network(c).weight_count = 3; }},
    {"policy.network.weights", tiller_status_bad_planner, [](C& c) { policy_network(c).weights = kNoWeights; }},
    {"policy.input_low", tiller_status_bad_planner, [](C& c) { policy(c).input_low = nullptr; }},
    {"policy.input_high", tiller_status_bad_planner, [](C& c) { policy(c).input_high = kNoWeights; }},
    {"planner.horizon", tiller_status_bad_planner, [](C& c) { c.planner.horizon = 1; }},
    {"planner.knots", tiller_status_bad_planner, [](C& c) { c.planner.knots = 65; }},
    {"planner.rollouts", tiller_status_bad_planner, [](C& c) { c.planner.rollouts = 20; }},
    {"planner.particles", tiller_status_bad_planner, [](C& c) { c.planner.particles = 0; }},
    {"planner.iterations", tiller_status_bad_planner, [](C& c) { c.planner.iterations = 0; }},
    {"planner.risk", tiller_status_bad_planner, [](C& c) { c.planner.risk = 3; }},
    {"planner.cvar_alpha", tiller_status_bad_planner, [](C& c) { c.planner.cvar_alpha = 1.0; }},
    {"planner.noise_sd[0]", tiller_status_bad_planner, [](C& c) { c.planner.noise_sd[0] = -1.0; }},
    {"planner.temperature", tiller_status_bad_planner, [](C& c) { c.planner.temperature = 0.0; }},
    {"planner.elite_fraction", tiller_status_bad_planner, [](C& c) { c.planner.elite_fraction = 1.5; }},
    {"planner.smoothing", tiller_status_bad_planner, [](C& c) { c.planner.smoothing = 1.0; }},
    {"planner.interpolation", tiller_status_bad_planner, [](C& c) { c.planner.interpolation = 2; }},
    {"planner.adapt_covariance", tiller_status_bad_planner, [](C& c) { c.planner.adapt_covariance = 2; }},
    {"planner.noise_colour", tiller_status_bad_planner, [](C& c) { c.planner.noise_colour = 4.5; }},
    {"planner.noise_colour", tiller_status_bad_planner, [](C& c) { c.planner.noise_colour = kNan; }},
    {"planner.filter", tiller_status_bad_planner, [](C& c) { c.planner.filter = 0.0; }},
    {"planner.filter", tiller_status_bad_planner, [](C& c) { c.planner.filter = 1.1; }},
    {"planner.filter", tiller_status_bad_planner, [](C& c) { c.planner.filter = kNan; }},
    {"planner.anneal_iterations", tiller_status_bad_planner, [](C& c) { c.planner.anneal_iterations = 20.5; }},
    {"planner.anneal_iterations", tiller_status_bad_planner, [](C& c) { c.planner.anneal_iterations = kNan; }},
    {"planner.anneal_horizon", tiller_status_bad_planner, [](C& c) { c.planner.anneal_horizon = -0.1; }},
    {"planner.anneal_horizon", tiller_status_bad_planner, [](C& c) { c.planner.anneal_horizon = kInf; }},
    {"planner.hypotheses", tiller_status_bad_planner, [](C& c) { c.planner.hypotheses = 2; }},
    {"planner.closed_loop", tiller_status_bad_planner, [](C& c) { c.planner.closed_loop = 2; }},
    {"planner.shared_steps", tiller_status_bad_planner, [](C& c) { c.planner.shared_steps = 0; }},
    {"planner.shared_steps", tiller_status_bad_planner, [](C& c) { c.planner.shared_steps = 513; }},
    {"planner.predict_spread", tiller_status_bad_planner, [](C& c) { c.planner.predict_spread = 2; }},
    {"planner.noisy_rollouts", tiller_status_bad_planner, [](C& c) { c.planner.noisy_rollouts = 2; }},
    {"cost.demonstration_divergence", tiller_status_bad_cost,
     [](C& c) { c.cost.demonstration_divergence = tiller_divergence_kl; }},  // from nothing
    {"cost.demonstration_divergence", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_divergence = 2; }},
    {"cost.demonstration_divergence", tiller_status_bad_cost,
     [](C& c) {
       demonstrate(c), c.cost.demonstration_divergence = tiller_divergence_kl, c.cost.demonstration_weight = 0.0;
     }},
    {"cost.demonstration_root", tiller_status_bad_cost,  // infinitely wide in its second period
     [](C& c) {
       static const double kFlat[8] = {0.0, 1.0, 2.0, 3.0, 1.0, 2.0, 2.0, 4.0};
       demonstrate(c), c.cost.demonstration_divergence = tiller_divergence_kl, c.cost.demonstration_root = kFlat;
     }},
    {"cost.bound_risk", tiller_status_bad_cost, [](C& c) { c.cost.bound_risk = 0.6; }},
    {"cost.bound_risk", tiller_status_bad_cost, [](C& c) { c.cost.bound_risk = kNan; }},
    {"planner.shooting", tiller_status_bad_planner, [](C& c) { c.planner.shooting = 2; }},
    {"planner.qp_solver", tiller_status_bad_planner, [](C& c) { c.planner.qp_solver = 2; }},
    {"planner.qp_solver", tiller_status_bad_planner,  // OSQP solves no trees
     [](C& c) { sqp_tree(c), c.planner.qp_solver = tiller_qp_osqp; }},
    {"planner.qp_iterations", tiller_status_bad_planner, [](C& c) { c.planner.qp_iterations = 0; }},
    {"planner.qp_iterations", tiller_status_bad_planner, [](C& c) { c.planner.qp_iterations = 10001; }},
    {"planner.refine_iterations", tiller_status_bad_planner, [](C& c) { c.planner.refine_iterations = 21; }},
    {"planner.qp_tolerance", tiller_status_bad_planner, [](C& c) { c.planner.qp_tolerance = 0.0; }},
    {"planner.qp_tolerance", tiller_status_bad_planner, [](C& c) { c.planner.qp_tolerance = kNan; }},
    {"planner.regularisation", tiller_status_bad_planner, [](C& c) { c.planner.regularisation = -1e-9; }},
    {"planner.regularisation", tiller_status_bad_planner, [](C& c) { c.planner.regularisation = kInf; }},
    {"planner.levels", tiller_status_bad_planner, [](C& c) { c.planner.levels = 1; }},
    {"planner.levels", tiller_status_bad_planner, [](C& c) { c.planner.levels = 17; }},
    {"planner.nodes", tiller_status_bad_planner, [](C& c) { c.planner.nodes = 15; }},
    {"planner.nodes", tiller_status_bad_planner, [](C& c) { c.planner.nodes = 65537; }},
    {"planner.hold_steps", tiller_status_bad_planner, [](C& c) { c.planner.hold_steps = 0; }},
    {"planner.hold_steps", tiller_status_bad_planner, [](C& c) { c.planner.hold_steps = 513; }},
    {"planner.predict_delay", tiller_status_bad_planner, [](C& c) { c.planner.predict_delay = 2; }},
    {"planner.exploration", tiller_status_bad_planner, [](C& c) { c.planner.exploration = -0.1; }},
    {"planner.exploration", tiller_status_bad_planner, [](C& c) { c.planner.exploration = kNan; }},
    {"cost.target[0]", tiller_status_bad_cost, [](C& c) { c.cost.target[0] = kInf; }},
    {"cost.state_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.state_weight[0] = -1.0; }},
    {"cost.terminal_weight[1]", tiller_status_bad_cost, [](C& c) { c.cost.terminal_weight[1] = kNan; }},
    {"cost.input_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.input_weight[0] = -1.0; }},
    {"cost.input_rate_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.input_rate_weight[0] = kInf; }},
    {"cost.terminal", tiller_status_bad_cost, [](C& c) { c.cost.terminal = 2; }},
    {"cost.terminal", tiller_status_bad_cost,  // an input that costs nothing has no cost-to-go
     [](C& c) { c.cost.terminal = tiller_terminal_lqr, c.cost.input_weight[0] = 0.0; }},
    {"cost.saturating_weight", tiller_status_bad_cost, [](C& c) { c.cost.saturating_weight = -1.0; }},
    {"cost.saturating_weight", tiller_status_bad_cost, [](C& c) { c.cost.saturating_weight = kNan; }},
    {"cost.saturating_width[1]", tiller_status_bad_cost, [](C& c) { c.cost.saturating_width[1] = 0.0; }},
    {"cost.saturating_width[1]", tiller_status_bad_cost, [](C& c) { c.cost.saturating_width[1] = kNan; }},
    {"cost.state_low[0]", tiller_status_bad_cost, [](C& c) { c.state_low[0] = kNan; }},
    {"cost.state_high[0]", tiller_status_bad_cost, [](C& c) { c.state_high[0] = kNan; }},
    {"cost.state_high[1]", tiller_status_bad_cost, [](C& c) { c.state_low[1] = c.state_high[1] = 1.0; }},
    {"cost.bound_weight[0]", tiller_status_bad_cost, [](C& c) { c.bound_weight[0] = -1.0; }},
    {"cost.bound_weight[0]", tiller_status_bad_cost, [](C& c) { c.bound_weight[0] = kInf; }},
    {"cost.hard_bounds", tiller_status_bad_cost, [](C& c) { c.cost.hard_bounds = 1u << 2; }},
    {"cost.term_count", tiller_status_bad_cost, [](C& c) { c.cost.term_count = 9; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).kind = tiller_cost_term_kind_count; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).states[0] = 2; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).states[1] = 2; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).states[1] = 0; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).params[0] = kNan; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).params[1] = kInf; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).params[2] = 0.0; }},
    {"cost.terms[0]", tiller_status_bad_cost, [](C& c) { obstacle(c).weight = -1.0; }},
    {"cost.reference_steps", tiller_status_bad_cost, [](C& c) { c.cost.reference_steps = 2; }},
    {"cost.reference_steps", tiller_status_bad_cost, [](C& c) { c.cost.reference = kRows; }},
    {"cost.reference", tiller_status_bad_cost,
     [](C& c) { c.cost.reference = kRowsWithNan, c.cost.reference_steps = 2; }},
    {"cost.demonstration_mean", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_mean = nullptr; }},
    {"cost.demonstration_mean", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_mean = kRowsWithNan; }},
    {"cost.demonstration_mean", tiller_status_bad_cost, [](C& c) { demonstrate(c), c.cost.demonstration_steps = 0; }},
    {"cost.demonstration_root", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_root = nullptr; }},
    {"cost.demonstration_root", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_root = kRowsWithNan; }},
    {"cost.demonstration_weight", tiller_status_bad_cost,
     [](C& c) { demonstrate(c), c.cost.demonstration_weight = -1.0; }},
    {"cost.demonstration_weight", tiller_status_bad_cost, [](C& c) { c.cost.demonstration_weight = kNan; }},
    {"cost.demonstration_weight", tiller_status_bad_cost, [](C& c) { c.cost.demonstration_weight = 1.0; }},
    {"cost.own_weight", tiller_status_bad_cost, [](C& c) { c.cost.own_weight = -1.0; }},
    {"cost.own_weight", tiller_status_bad_cost, [](C& c) { c.cost.own_weight = kNan; }},
    {"cost.own_weight", tiller_status_bad_cost, [](C& c) { c.cost.own_weight = 1.0; }},  // of no cost
    {"cost.own.size", tiller_status_version_mismatch, [](C& c) { own(c).size = 8; }},
    {"cost.own.version", tiller_status_version_mismatch, [](C& c) { own(c).version = 1; }},
    {"cost.own.stage", tiller_status_null_argument, [](C& c) { own(c).stage = nullptr; }},
    {"safety.input_low[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_low[0] = -kInf; }},
    {"safety.input_high[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_high[0] = -4.0; }},
    {"safety.input_high[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_high[0] = kNan; }},
    {"safety.input_rate_per_s[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_rate_per_s[0] = 0.0; }},
    {"safety.safe_command[0]", tiller_status_bad_limit, [](C& c) { c.safety.safe_command[0] = 4.0; }},
    {"safety.cone_count", tiller_status_bad_limit, [](C& c) { c.safety.cone_count = TILLER_MAX_INPUT_CONES + 1; }},
    {"safety.cones", tiller_status_null_argument, [](C& c) { c.safety.cone_count = 1, c.safety.cones = nullptr; }},
    {"safety.cones[0]", tiller_status_bad_limit, [](C& c) { c.safety.cone_count = 1, c.cones[0] = {2, 0, 0.0, 1.0}; }},
    {"safety.cones[0]", tiller_status_bad_limit, [](C& c) { c.safety.cone_count = 1, c.cones[0] = {1, 0, 0.0, 0.0}; }},
    {"safety.hold_gain[0]", tiller_status_bad_limit, [](C& c) { c.hold_gain[1] = kNan; }},
    {"safety.measurement_low[0]", tiller_status_bad_limit, [](C& c) { c.measurement_low[0] = kNan; }},
    {"safety.measurement_high[0]", tiller_status_bad_limit, [](C& c) { c.measurement_high[0] = -60.0; }},
    {"safety.measurement_rate_per_s[0]", tiller_status_bad_limit, [](C& c) { c.measurement_rate_per_s[0] = -1.0; }},
    {"safety.sensor_timeout_s", tiller_status_bad_limit, [](C& c) { c.safety.sensor_timeout_s = 0.01; }},
    {"safety.sensor_timeout_s", tiller_status_bad_limit, [](C& c) { c.safety.sensor_timeout_s = kInf; }},
    {"safety.bad_ticks_to_safe", tiller_status_bad_limit, [](C& c) { c.safety.bad_ticks_to_safe = 0; }},
    {"record_ticks", tiller_status_bad_dimension, [](C& c) { c.record_ticks = 65537; }},
};

// Requirement: SR-13
TEST(ConfigCheck, NamesTheFieldThatIsWrong) {
  const C good = rig::pendulum_config();
  const char* field = nullptr;
  ASSERT_EQ(tiller_config_check(&good, &field), tiller_status_ok) << field;
  for (const Spoiled& s : kSpoiled) {
    C c = good;
    s.spoil(c);
    EXPECT_EQ(tiller_config_check(&c, &field), s.status) << s.field;
    EXPECT_STREQ(field, s.field);
    EXPECT_EQ(tiller_size(&c), 0u) << s.field;
  }
}

/// What is unusual and right: everything that a range ends with, each optional part given.
TEST(ConfigCheck, AcceptsTheEndsOfTheRanges) {
  C c = rig::pendulum_config();
  tiller_planner_config_t& p = c.planner;
  p.risk = tiller_risk_worst;
  p.interpolation = tiller_interpolation_cubic;
  p.adapt_covariance = p.predict_delay = 1;
  p.noise_colour = 4.0;
  p.filter = 1.0;
  p.closed_loop = 1;
  p.shared_steps = 512;
  p.predict_spread = p.noisy_rollouts = 1;
  p.anneal_iterations = p.anneal_horizon = 20.0;
  p.hypotheses = tiller_hypotheses_sigma_points;
  c.cost.demonstration_divergence = tiller_divergence_kl;
  c.cost.bound_risk = 0.5;
  p.qp_iterations = 10000;
  p.refine_iterations = 20;
  p.regularisation = p.exploration = 0.0;
  p.particles = 64;  // more than TILLER_MAX_SCENARIOS: gradient planners take the first ones
  p.levels = 16;
  p.nodes = 65536;
  c.cost.terminal = tiller_terminal_lqr;
  c.cost.input_weight[0] = 0.01;
  c.cost.saturating_weight = 1.0;
  c.cost.saturating_width[0] = kInf;
  c.state_low[0] = -1.0;
  c.cost.hard_bounds = 3;
  (void)obstacle(c);
  c.terms[0].weight = 0.0;
  c.cost.reference = kRows;
  c.cost.reference_steps = 4;
  demonstrate(c);
  (void)own(c);
  const char* field = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << field;
}

// The children of the root must fit into the pool, a choice into the horizon: where the planner is the tree search.
TEST(ConfigCheck, TreeSearchSettingsGoTogether) {
  std::uint32_t kind = 0;
  while (kind < tiller_planner_kind_count && std::string(tiller::find_planner(kind)->name) != "mcts") ++kind;
  C c = rig::pendulum_config();
  const char* field = nullptr;
  c.planner.levels = c.planner.nodes = 16;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << "of no interest to mppi: " << field;
  if (kind == tiller_planner_kind_count) GTEST_SKIP() << "built without a tree search";
  c.planner.kind = kind;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_planner);
  EXPECT_STREQ(field, "planner.levels");
  c.planner.levels = 15;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << field;
  c.planner.hold_steps = c.planner.horizon + 1;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_planner);
  EXPECT_STREQ(field, "planner.hold_steps");
}

/// A model table of the test's own; one member is spoiled at a time.
// Requirement: SR-13
TEST(ConfigCheck, NamesWhatTheModelLacks) {
  const tiller_model_t* built_in = tiller_find_model("cart_pole");
  ASSERT_NE(built_in, nullptr);
  static const char* const no_names[TILLER_MAX_STATES] = {};
  static tiller_joint_t outside[2];
  outside[0] = outside[1] = built_in->joints[0];
  outside[1].velocity = 4;
  using M = tiller_model_t;
  const struct {
    const char* field;
    tiller_status_t status;
    void (*spoil)(M&);
  } cases[] = {
      {"model.size", tiller_status_version_mismatch, [](M& m) { m.size = 1; }},
      {"model.version", tiller_status_version_mismatch, [](M& m) { m.version = 9; }},
      {"model.name", tiller_status_bad_model, [](M& m) { m.name = nullptr; }},
      {"model.state_count", tiller_status_bad_model, [](M& m) { m.state_count = 0; }},
      {"model.state_count", tiller_status_bad_model, [](M& m) { m.state_count = TILLER_MAX_STATES + 1; }},
      {"model.input_count", tiller_status_bad_model, [](M& m) { m.input_count = TILLER_MAX_INPUTS + 1; }},
      {"model.param_count", tiller_status_bad_model, [](M& m) { m.param_count = TILLER_MAX_PARAMS + 1; }},
      {"model.joint_count", tiller_status_bad_model, [](M& m) { m.joint_count = TILLER_MAX_JOINTS + 1; }},
      {"model.state_names", tiller_status_bad_model, [](M& m) { m.state_names = no_names; }},
      {"model.input_names", tiller_status_bad_model, [](M& m) { m.input_names = nullptr; }},
      {"model.param_names", tiller_status_bad_model, [](M& m) { m.param_names = no_names; }},
      {"model.force_names", tiller_status_bad_model, [](M& m) { m.force_names = no_names; }},
      {"model.joints", tiller_status_bad_model, [](M& m) { m.joints = outside; }},
      {"model.angle_mask", tiller_status_bad_model, [](M& m) { m.angle_mask = 1u << 4; }},
      {"model.dynamics", tiller_status_bad_model,
       [](M& m) {
         m.dynamics = nullptr;
         m.kernels = nullptr;
       }},
  };
  C config = rig::cart_pole_config();
  for (const auto& c : cases) {
    M model = *built_in;
    c.spoil(model);
    config.model = &model;
    const char* field = nullptr;
    EXPECT_EQ(tiller_config_check(&config, &field), c.status) << c.field;
    EXPECT_STREQ(field, c.field);
    tiller::Config unused;
    EXPECT_EQ(tiller_config_default(&unused, &model), c.status);
  }
}

TEST(ConfigDefault, LacksOnlyThePriors) {
  std::uint32_t models = 0;
  while (const tiller_model_t* model = tiller_builtin_model(models)) {
    ++models;
    C c;
    ASSERT_EQ(tiller_config_default(&c, model), tiller_status_ok);
    const char* field = nullptr;
    EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_prior) << model->name;
    EXPECT_STREQ(field, "priors[0]");
    for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.5, 0, 0, 0};
    EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << model->name << ": " << field;
    EXPECT_EQ(tiller_find_model(model->name), model);
  }
  EXPECT_GE(models, 2u);
  EXPECT_EQ(tiller_find_model("no such model"), nullptr);
}

TEST(Status, EveryCodeHasANameAndAText) {
  const int codes[] = {
#define TILLER_STATUS(code, name, band, text) code,
#include "tiller/status.def"
#undef TILLER_STATUS
  };
  std::set<std::string> names;
  std::set<int> unique;
  for (int code : codes) {
    names.insert(tiller_status_name(static_cast<tiller_status_t>(code)));
    unique.insert(code);
    EXPECT_GT(std::string(tiller_status_text(static_cast<tiller_status_t>(code))).size(), 5u);
  }
  EXPECT_EQ(names.size(), sizeof codes / sizeof *codes);
  EXPECT_EQ(unique.size(), names.size());
  EXPECT_STREQ(tiller_status_name(static_cast<tiller_status_t>(99)), "unknown");
}

}  // namespace
