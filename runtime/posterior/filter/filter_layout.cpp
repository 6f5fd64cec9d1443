// Where a filter posterior's parts are in its block, and what it is asked before.

#include "core/bits.hpp"
#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

FilterPosterior* FilterPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  const std::uint32_t ns = setup.effect_state_count;
  auto* const p = arena.take<FilterPosterior>(1);
  const DisturbanceStates disturbances(config, setup, table, config.posterior.drift);
  const DisturbanceStates* const at = p ? &p->disturbances_ : nullptr;
  const FilterParticles particles = FilterParticles::lay_out(arena, config, setup, disturbances, at);
  const std::uint32_t d = particles.cloud.d, nf = particles.nf;
  const FilterStart start = FilterStart::lay_out(arena, config, nf, ns);
  const FilterWindow window = FilterWindow::lay_out(arena, config, setup);
  const FilterPast past = FilterPast::lay_out(arena, config, d, nf, ns);
  const FilterMoves moves = FilterMoves::lay_out(arena, particles.cloud, disturbances);
  const InputHistory inputs = InputHistory::lay_out(arena, config);
  auto* const chunks = FilterChunk::lay_out(arena, particles.chunks(), config, setup, disturbances, at, d);
  auto* const adequacy = FilterAdequacy::lay_out(arena, config, disturbances);
  auto* const sudden = SuddenForces::lay_out(arena, config, setup, disturbances, at, d);
  auto* const jumps = JumpBanks::lay_out(arena, config, setup, table, disturbances, d);
  if (arena.measuring() || !arena.fits()) return nullptr;

  p->config_ = &config;
  p->hooks_ = hooks;
  p->filter_ = LaneFilter(config, setup, table, particles.has_ratio);
  p->particles_ = particles;
  p->evidence_ = ScaleEvidence(config);
  p->disturbances_ = disturbances;
  p->start_ = start;
  p->window_ = window;
  p->past_ = past;
  p->moves_ = moves;
  p->rest_ = RestGuard(config);
  p->inputs_ = inputs;
  p->adequacy_ = adequacy;
  p->sudden_ = sudden;
  p->jumps_ = jumps;
  p->chunks_ = chunks;
  p->reset();
  return p;
}

namespace {
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  return FilterPosterior::lay_out(arena, config, setup, table, hooks);
}

tiller_status_t check_drift(const tiller_config_t& config, const StepSetup& /*setup*/, const RolloutTable& /*table*/,
                            const char** field) {
  std::uint64_t may = 0;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) may |= std::uint64_t{1} << i;
  may &= ~sensor_rows(config);
  if ((config.posterior.drift & ~may) == 0 && bit_count(config.posterior.drift) <= TILLER_MAX_DRIFTS)
    return tiller_status_ok;
  *field = "posterior.drift";
  return tiller_status_bad_posterior;
}
}  // namespace

extern const PosteriorTable filter_posterior;
const PosteriorTable filter_posterior = {lay_out_engine, check_drift, DisturbanceStates::joints_of, false, false,
                                         true,           true,        DisturbanceStates::slips_of};

}  // namespace tiller
