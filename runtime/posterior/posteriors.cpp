// The engines, and which of them a configuration asks for.

#include "posterior/posterior.hpp"

namespace tiller {

#define TILLER_POSTERIOR(name, help) extern const PosteriorTable name##_posterior;
#include "tiller/posteriors.def"

namespace {

// null: left out of this build (TILLER_POSTERIORS); the linker then needs nothing of it
const PosteriorTable* const kEngines[] = {
#define TILLER_POSTERIOR(name, help) TILLER_BUILT_POSTERIOR_##name ? &name##_posterior : nullptr,
#include "tiller/posteriors.def"
};

struct Text {
  const char *name, *help;
};
const Text kTexts[] = {
#define TILLER_POSTERIOR(name, help) {#name, help},
#include "tiller/posteriors.def"
};

}  // namespace

const PosteriorTable* find_posterior(std::uint32_t kind) {
  return kind < tiller_posterior_kind_count ? kEngines[kind] : nullptr;
}

const char* posterior_name(std::uint32_t kind) {
  return kind < tiller_posterior_kind_count ? kTexts[kind].name : nullptr;
}
const char* posterior_help(std::uint32_t kind) {
  return kind < tiller_posterior_kind_count ? kTexts[kind].help : nullptr;
}

Posterior* Posterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                              const RolloutTable& table, const tiller_hooks_t* hooks) {
  const PosteriorTable* const engine = find_posterior(config.posterior.kind);
  return engine ? engine->lay_out(arena, config, setup, table, hooks) : nullptr;  // check() refuses it
}

std::uint32_t Posterior::force_joints(const tiller_config_t& config) {
  const PosteriorTable* const engine = find_posterior(config.posterior.kind);
  return engine && engine->force_joints ? engine->force_joints(config) : 0;
}

std::uint32_t Posterior::slip_states(const tiller_config_t& config) {
  const PosteriorTable* const engine = find_posterior(config.posterior.kind);
  return engine && engine->slip_states ? engine->slip_states(config) : 0;
}

tiller_status_t Posterior::check(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                                 const char** field) {
  const tiller_posterior_config_t& p = config.posterior;
  const PosteriorTable* const engine = find_posterior(p.kind);
  if (!engine) {
    *field = "posterior.kind";
    return tiller_status_bad_posterior;
  }
  if (!engine->hypotheses && p.delay_hypotheses > 1) {
    *field = "posterior.delay_hypotheses";
    return tiller_status_bad_posterior;
  }
  if (!engine->hypotheses && p.forgetting_count > 1) {
    *field = "posterior.forgetting";
    return tiller_status_bad_posterior;
  }
  if (!engine->disturbances && p.disturbance != 0) {
    *field = "posterior.disturbance";
    return tiller_status_bad_posterior;
  }
  if (!engine->drifts && p.drift != 0) {
    *field = "posterior.drift";
    return tiller_status_bad_posterior;
  }
  // only the filter takes differences on the tangent plane
  if (config.model->quaternion_mask != 0 && p.kind != tiller_posterior_filter) {
    *field = "posterior.kind";
    return tiller_status_bad_posterior;
  }
  return engine->check ? engine->check(config, setup, table, field) : tiller_status_ok;
}

}  // namespace tiller
