// Which engine, and what none of them takes in.

#include "posterior/posterior.hpp"

#include <cmath>

#include "posterior/bank.hpp"
#include "posterior/conjugate/conjugate_posterior.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "posterior/transition/transition_posterior.hpp"

namespace tiller {

namespace {

/// Longest transition, in nominal periods: the integrator's step grows with it.
constexpr double kLongestTransition = 10.0;

}  // namespace

Posterior* Posterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                              const RolloutTable& table, const tiller_hooks_t* hooks) {
#if TILLER_BUILT_POSTERIOR_transition
  if (BankPosterior::wanted(config)) return BankPosterior::lay_out(arena, config, setup, table, hooks);
#endif
  switch (config.posterior.kind) {
#if TILLER_BUILT_POSTERIOR_transition
    case tiller_posterior_transition: return TransitionPosterior::lay_out(arena, config, setup, table, hooks);
#endif
#if TILLER_BUILT_POSTERIOR_conjugate
    case tiller_posterior_conjugate: return ConjugatePosterior::lay_out(arena, config, setup, table);
#endif
#if TILLER_BUILT_POSTERIOR_filter
    case tiller_posterior_filter: return FilterPosterior::lay_out(arena, config, setup, table, hooks);
#endif
    default: return nullptr;  // check() refuses it
  }
}

tiller_status_t Posterior::check(const tiller_config_t& config, [[maybe_unused]] const StepSetup& setup,
                                 [[maybe_unused]] const RolloutTable& table, const char** field) {
  const tiller_posterior_config_t& p = config.posterior;
  if (p.kind != tiller_posterior_transition && p.delay_hypotheses > 1) {
    *field = "posterior.delay_hypotheses";
    return tiller_status_bad_posterior;
  }
  if (p.kind != tiller_posterior_transition && p.forgetting_count > 1) {
    *field = "posterior.forgetting";
    return tiller_status_bad_posterior;
  }
  switch (config.posterior.kind) {
#if TILLER_BUILT_POSTERIOR_filter
    case tiller_posterior_filter: return tiller_status_ok;
#endif
#if TILLER_BUILT_POSTERIOR_transition
    case tiller_posterior_transition: return TransitionPosterior::check(config, setup, table, field);
#endif
#if TILLER_BUILT_POSTERIOR_conjugate
    case tiller_posterior_conjugate: return ConjugatePosterior::check(config, setup, table, field);
#endif
    default: *field = "posterior.kind"; return tiller_status_bad_posterior;
  }
}

tiller_status_t check_transition(const tiller_config_t& config, const Transition& t) {
  if (std::isnan(t.period_s)) return tiller_status_bad_period;
  if (!(t.period_s > 0.0)) return tiller_status_time_backwards;
  if (t.period_s > kLongestTransition * config.period_s) return tiller_status_bad_period;
  for (std::uint32_t j = 0; j < config.model->input_count; ++j)
    if (!std::isfinite(t.input[j])) return tiller_status_command_not_finite;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (std::isinf(t.measured[k])) return tiller_status_sensor_not_finite;
  return tiller_status_ok;
}

}  // namespace tiller
