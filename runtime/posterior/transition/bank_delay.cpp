#include "posterior/transition/bank_delay.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_roles.hpp"
#include "posterior/force_response.hpp"

namespace tiller {

namespace {

/// Standard deviation of a mixture's fraction, in periods. Within the bounds that cut it to one period its density
/// varies by an eighth, and four draws of ten lie within them.
constexpr double kMixtureSpread = 1.0;

bool has_input_delay(const tiller_config_t& config) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    if (has_role(config.effects[e].kind, kDelay)) return true;
  return false;
}

bool has_room(const tiller_config_t& config, const StepSetup& setup) {
  // the discrepancy's forces take the setup's next effects
  const std::uint32_t forces = discrepancy_joints(config) > 0 ? kDiscrepancyBasis : 0;
  const std::uint32_t strengths = config.param_count - config.model->param_count;
  return setup.effect_count + config.model->input_count + forces <= TILLER_MAX_EFFECTS &&
         strengths + 1 + forces <= TILLER_MAX_PARAMS && config.param_count + 1 <= TILLER_MAX_PARAMS;
}

}  // namespace

DelayHypotheses DelayHypotheses::of(const tiller_config_t& config, const StepSetup& setup) {
  const std::uint32_t hypotheses = config.posterior.delay_hypotheses;
  if (hypotheses <= 1) return {1, false};
  if (config.posterior.enabled == 0 || has_input_delay(config) || !has_room(config, setup)) return {hypotheses, false};
  return {hypotheses - 1, true};
}

void DelayHypotheses::add_fraction(tiller_config_t& config, tiller_prior_t* priors,
                                   const tiller_mixture_t* prior_mixture) const {
  if (!fractional) return;
  if (config.param_count > 0) std::copy(config.priors, config.priors + config.param_count, priors);
  priors[config.param_count++] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, config.period_s};
  config.priors = priors;
  config.prior_mixture = prior_mixture;
}

StepSetup DelayHypotheses::member_setup(const tiller_config_t& config, const StepSetup& setup) const {
  StepSetup delayed = setup;
  if (!fractional) return delayed;
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    delayed.effects[delayed.effect_count++] = {tiller_effect_input_delay, static_cast<std::uint16_t>(i),
                                               static_cast<std::uint16_t>(config.param_count), 0};
  delayed.delay_steps = 1;
  return delayed;
}

const tiller_mixture_t* lay_out_delayed_mixture(Arena& arena, const tiller_config_t& config) {
  if (!config.prior_mixture) return nullptr;
  const tiller_mixture_t& given = *config.prior_mixture;
  const std::uint32_t before = given.dimension, d = before + 1;
  auto* mixture = arena.take<tiller_mixture_t>(1);
  auto* mean = arena.take<double>(std::size_t{given.components} * d);
  auto* root = arena.take<double>(std::size_t{given.components} * d * d);
  if (arena.measuring() || !arena.fits()) return nullptr;
  for (std::uint32_t c = 0; c < given.components; ++c) {
    for (std::uint32_t j = 0; j < before; ++j) mean[c * d + j] = given.mean[c * before + j];
    mean[c * d + before] = 0.5 * config.period_s;
    double* square = root + std::size_t{c} * d * d;
    const double* from = given.root + std::size_t{c} * before * before;
    for (std::uint32_t r = 0; r < before; ++r)
      for (std::uint32_t s = 0; s < before; ++s) square[r * d + s] = from[r * before + s];
    square[before * d + before] = kMixtureSpread * config.period_s;
  }
  *mixture = given;
  mixture->dimension = d;
  mixture->mean = mean;
  mixture->root = root;
  return mixture;
}

}  // namespace tiller
