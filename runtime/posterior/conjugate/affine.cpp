// For which configurations the closed form holds.

#include <cmath>

#include "core/bits.hpp"
#include "core/rng.hpp"
#include "posterior/conjugate/conjugate_posterior.hpp"
#include "rollout/measurement.hpp"

namespace tiller {

namespace {

constexpr int kStates = 12;     // random states and inputs at which the step is tried
constexpr double kSteps = 2.0;  // prior deviations of a trial step
constexpr double kBent = 1e-7;  // second differences over first ones: far above rounding, far below what data can tell
constexpr double kNoise = 1e-13;  // rounding of a step
constexpr std::uint32_t kLanes = 16;

bool unbounded_normal(const tiller_prior_t& p) {
  return p.kind == tiller_prior_normal && std::isinf(p.low) && std::isinf(p.high);
}

bool every_state_measured(const tiller_config_t& config) {
  std::uint32_t seen = 0;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) seen |= 1u << config.measured_state[k];
  return config.measurement_count == config.model->state_count && seen == low_bits(config.model->state_count);
}

/// One random state, input and past.
struct Trial {
  double state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS];
  double history[(TILLER_MAX_DELAY_STEPS + 2) * TILLER_MAX_INPUTS];

  Trial(const tiller_config_t& c, Rng& rng) {
    const auto draw = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
    for (std::uint32_t i = 0; i < c.model->state_count; ++i) state[i] = c.initial_state[i] + draw(-2.0, 2.0);
    const auto command = [&](std::uint32_t j) {
      const double low = c.safety.input_low[j], high = c.safety.input_high[j];
      return low < high ? draw(low, high) : draw(-1.0, 1.0);
    };
    for (std::uint32_t j = 0; j < c.model->input_count; ++j) input[j] = command(j);
    for (std::uint32_t i = 0; i < TILLER_MAX_DELAY_STEPS + 2; ++i)
      for (std::uint32_t j = 0; j < c.model->input_count; ++j) history[i * c.model->input_count + j] = command(j);
  }
};

}  // namespace

/// f(m + a + b) - f(m + a) - f(m + b) + f(m) = 0 for random steps a and b, and for a = b: then no second derivative is
/// left in any direction.
bool ConjugatePosterior::is_affine(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table) {
  const PriorDistribution prior(config);
  const Whitening white(prior, config);
  const std::uint32_t d = prior.dimension(), nx = config.model->state_count;
  Rng rng(config.seed, kRngPrior, kPriorExtra);
  for (int trial = 0; trial < kStates; ++trial) {
    const Trial at(config, rng);
    // lanes: m, m + a, m + b, m + a + b, m + 2 a
    double params[TILLER_MAX_PARAMS * kLanes], next[TILLER_MAX_STATES * kLanes];
    double a[TILLER_MAX_PARAMS] = {}, b[TILLER_MAX_PARAMS] = {};
    for (std::uint32_t j = 0; j < d; ++j) {
      const double za = kSteps * (2.0 * rng.uniform() - 1.0), zb = kSteps * (2.0 * rng.uniform() - 1.0);
      for (std::uint32_t i = j; i < d; ++i) {
        a[i] += white.root[i][j] * za;
        b[i] += white.root[i][j] * zb;
      }
    }
    for (std::uint32_t i = 0, j = 0; i < config.param_count; ++i) {
      const bool inferred = config.priors[i].kind != tiller_prior_fixed;
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        double& value = params[i * kLanes + l] = inferred ? white.mean[j] : config.priors[i].a;
        if (!inferred) continue;
        if (l == 1 || l == 3) value += a[j];
        if (l == 2 || l == 3) value += b[j];
        if (l == 4) value += 2.0 * a[j];
      }
      j += inferred ? 1u : 0u;
    }
    LineariseJob job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.period_s = config.period_s;
    job.state = {at.state, 0};
    job.params = {params, kLanes};
    job.control = {at.input, 0};
    job.history = at.history;
    job.next_state = next;
    table.linearise(*config.model, job);
    for (std::uint32_t i = 0; i < nx; ++i) {
      const double* f = next + i * kLanes;
      const double da = f[1] - f[0], db = f[2] - f[0], both = f[3] - f[0], twice = f[4] - f[0];
      const double allowed = kBent * (std::fabs(da) + std::fabs(db)) + kNoise * (1.0 + std::fabs(f[0]));
      if (!(std::fabs(both - da - db) <= allowed && std::fabs(twice - 2.0 * da) <= allowed)) return false;
    }
  }
  return true;
}

tiller_status_t ConjugatePosterior::check(const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const char** field) {
  const auto refuse = [&](const char* name) {
    *field = name;
    return tiller_status_bad_posterior;
  };
  if (has_sensor_effects(config)) {
    *field = "effects";
    return tiller_status_bad_effect;
  }
  if (setup.effect_state_count != 0) return refuse("effects");
  if (!every_state_measured(config)) return refuse("measured_state");
  double noise = 0.0;
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) noise = std::fmax(noise, config.process_sd[i]);
  if (!(noise > 0.0)) return refuse("process_sd");
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed && !unbounded_normal(config.priors[i])) return refuse("priors");
  if (config.prior_mixture && config.prior_mixture->components != 1) return refuse("prior_mixture");
  if (!is_affine(config, setup, table)) return refuse("posterior.kind");
  return tiller_status_ok;
}

}  // namespace tiller
