#include <cmath>
#include <initializer_list>

#include "planners/sampler.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kMostSlots = 8;
// Scales of the noise run geometrically from 1 down to this, over every 16 rollouts. One scale cannot serve both a
// swing-up, which wants the whole range of the input, and an unstable upright, where coarse noise fells every sample
// within a second and their mean with them: with a single scale, cart-pole at horizon 75 is never held (0 of 20
// seeds), with the mixture it is in 20 of 20, and noise_sd may be off by a factor of two.
constexpr double kFinestScale = 1.0 / 64.0;
constexpr std::uint32_t kControlBytes = 32 * 1024;  // of a chunk: two thirds of a 48 kB first-level cache

/// What the busiest of kMostSlots slots works off, in rollouts.
std::uint32_t longest_slot(std::uint32_t rollouts, std::uint32_t lanes) {
  const std::uint32_t chunks = (rollouts + lanes - 1) / lanes;
  return (chunks + kMostSlots - 1) / kMostSlots * lanes;
}

/// Lanes of a chunk: 64 are four AVX-512 vectors in flight; 128 halve the cost of a call where the controls still fit
/// the cache and no slot gets more to do, as of 1536 rollouts four would: eight threads then wait for those.
std::uint32_t choose_chunk_lanes(const tiller_planner_config_t& p, std::uint32_t inputs) {
  const bool fits = p.horizon * inputs * 128 * sizeof(float) <= kControlBytes;
  const bool shares = p.rollouts >= 1024 && longest_slot(p.rollouts, 128) <= longest_slot(p.rollouts, 64);
  const std::uint32_t lanes = fits && shares ? 128 : 64;
  return lanes < p.rollouts ? lanes : p.rollouts;
}

std::uint32_t hold_of(const tiller_planner_config_t& p) { return p.hold_steps > 0 ? p.hold_steps : 1; }

/// Numbers that both passes of the layout need.
struct Sizes {
  std::uint32_t rows, horizon, knots, rollouts, chunk_lanes, chunks, slots, particles, padded, states, params, effects;
  bool mixed, penalised, closed, branching, noisy;
};

constexpr std::uint32_t kPenalties = kCostBounds | kCostPenaltyTerms | kCostOutputBounds;

Sizes measure(const tiller_config_t& config, const StepSetup& setup, const SamplingMethod& method) {
  const tiller_planner_config_t& p = config.planner;
  Sizes z{};
  z.horizon = p.horizon;
  z.knots = method.holds ? held_knots(p.horizon, hold_of(p)) : p.knots;
  z.rows = config.model->input_count * z.knots;
  z.rollouts = p.rollouts;
  z.chunk_lanes = choose_chunk_lanes(p, config.model->input_count);
  z.chunks = (p.rollouts + z.chunk_lanes - 1) / z.chunk_lanes;
  z.slots = z.chunks < kMostSlots ? z.chunks : kMostSlots;
  z.particles = p.particles;
  z.padded = pad_lanes(p.particles);
  z.states = config.model->state_count;
  z.params = param_rows(config, setup);
  z.effects = setup.effect_state_count;
  z.penalised = (make_cost_terms<float>(config.cost, config.model->state_count).extra & kPenalties) != 0;
  z.branching = method.branches && method.branches(config);
  z.mixed = !method.draw && mixes_noise(p);
  z.closed = closes_loop(config, method);
  z.noisy = p.noisy_rollouts != 0 && !method.draw && p.kind != tiller_planner_hybrid;
  return z;
}

/// Takes every array; into a Sampler of nobody while the arena measures.
void take_arrays(Arena& arena, const Sizes& z, std::uint32_t inputs, Sampler& s) {
  s.first_step = arena.take<std::uint32_t>(z.knots);
  s.fraction = arena.take<float>(z.horizon);
  s.grid = {z.horizon, inputs, z.knots, s.first_step, s.fraction};
  for (float** row : {&s.row_low, &s.row_high, &s.row_mean, &s.row_spread, &s.row_sum, &s.row_squares})
    *row = arena.take<float>(z.rows);
  for (double** row : {&s.mean, &s.spread, &s.best, &s.before}) *row = arena.take<double>(z.rows);
  s.sequence = arena.take<float>(z.horizon * inputs);
  s.particle_state = arena.take<float>(z.particles * z.states);
  s.particle_params = arena.take<float>(z.particles * z.params);
  s.particle_effects = arena.take<float>(z.particles * z.effects);
  s.lane_state = arena.take<float>(z.padded * z.states);
  s.lane_params = arena.take<float>(z.padded * z.params);
  s.lane_effects = arena.take<float>(z.padded * z.effects);
  s.lane_cost = arena.take<float>(z.padded);
  s.keys = arena.take<NoiseKey>((z.rows + 1) / 2);
  if (z.noisy) {
    s.noise = arena.take<float>(std::size_t{z.particles} * z.horizon * z.states);
    s.lane_noise = arena.take<float>(std::size_t{z.padded} * z.horizon * z.states);
  }
  if (z.mixed) s.mix = arena.take<float>(std::size_t{z.knots} * z.knots);
  s.knots = arena.take<float>(std::size_t{z.rows} * z.rollouts);
  s.cost = arena.take<float>(z.rollouts);
  s.weight = arena.take<float>(z.rollouts);
  s.controls = arena.take<float>(std::size_t{z.slots} * z.horizon * inputs * z.chunk_lanes);
  // penalties are compared over all samples before they are added to anything; outcomes are told apart after a batch
  s.keeps_costs = z.penalised || z.branching;
  const std::size_t places = s.keeps_costs ? z.chunks : z.slots;
  s.particle_cost = arena.take<float>(places * z.particles * z.chunk_lanes);
  if (z.branching) {
    s.own_knots = arena.take<float>(std::size_t{z.slots} * z.rows * z.chunk_lanes);
    s.trajectory = arena.take<float>(std::size_t{z.slots} * (z.horizon + 1) * z.states * z.chunk_lanes);
  }
  if (!z.penalised) return;
  s.lane_penalty = arena.take<float>(z.padded);
  s.least_penalty = arena.take<float>(z.particles);
  s.particle_penalty = arena.take<float>(places * z.particles * z.chunk_lanes);
}

void take_limits(Sampler& s, const tiller_config_t& config) {
  s.cones = make_input_cones(config.safety.cones, config.safety.cone_count);
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    InputLimit& limit = s.limits[i];
    limit.low = config.safety.input_low[i];
    limit.high = config.safety.input_high[i];
    limit.step = config.safety.input_rate_per_s[i] * config.period_s;
    const double configured = config.planner.noise_sd[i];
    s.noise_sd[i] = configured > 0.0 ? configured : kWidths * (limit.high - limit.low);
    s.fallback[i] = config.safety.safe_command[i];
    s.rate_step[i] = limit.step < limit.high - limit.low ? lane_number(limit.step) : -1.0f;
    for (std::uint32_t j = 0; j < s.grid.knots; ++j) {
      s.row_low[i * s.grid.knots + j] = lane_number(limit.low);
      s.row_high[i * s.grid.knots + j] = lane_number(limit.high);
    }
  }
}

}  // namespace

Sampler* lay_out_sampler(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                         const tiller_hooks_t* hooks, const SamplingMethod& method) {
  auto* s = arena.take<Sampler>(1);
  Sampler nobody;
  const Sizes z = measure(config, setup, method);
  take_arrays(arena, z, config.model->input_count, s ? *s : nobody);
  ClosedLoop* const loop =
      z.closed ? lay_out_closed_loop(arena, config, setup, table, z.slots, z.chunk_lanes) : nullptr;
  float* const cost_to_go =
      config.cost.terminal == tiller_terminal_lqr ? arena.take<float>(std::size_t{z.states} * z.states) : nullptr;
  if (!s || !arena.fits()) return nullptr;  // measuring, or a block that is too small
  s->method = &method;
  s->loop = loop;
  s->settings = &config.planner;
  s->model = config.model;
  s->setup = &setup;
  s->table = &table;
  s->lanes = &select_lanes(table.isa);
  s->hooks = hooks;
  s->seed = config.seed;
  s->cost_terms.cost_to_go = cost_to_go;
  if (lay_out_cost(config, setup, table, nullptr, &s->cost_terms) != tiller_status_ok) return nullptr;
  s->frame.lay_out(config);
  s->penalised = z.penalised;
  s->cost_terms.extra &= ~kPenalties;
  s->states = z.states;
  s->inputs = config.model->input_count;
  s->params = z.params;
  s->effect_states = z.effects;
  s->rollouts = z.rollouts;
  s->rows = z.rows;
  s->chunk_lanes = z.chunk_lanes;
  s->chunks = z.chunks;
  s->slots = z.slots;
  s->most_particles = z.particles;
  for (std::uint32_t i = 0; i < kScales; ++i)
    s->scale[i] = static_cast<float>(math::pow(kFinestScale, static_cast<double>(i) / (kScales - 1)));
  s->anneals = !method.draw && anneals(config.planner);
  s->cubic = !method.holds && config.planner.interpolation == tiller_interpolation_cubic;
  take_limits(*s, config);
  if (s->mix) fill_mix(config.planner, s->mix);
  reset_sampler(s);
  return s;
}

void reset_sampler(void* self) {
  Sampler& s = *static_cast<Sampler*>(self);
  s.cold = true;
  s.lambda = 0.0;
  s.gone = 0;
  if (s.loop) reset_closed_loop(*s.loop);
  s.clock = {s.grid.horizon, s.grid.knots, 0, s.method->holds ? hold_of(*s.settings) : 0};
  fill_grid(s.clock, s.first_step, s.fraction);
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    const std::uint32_t input = r / s.grid.knots;
    s.mean[r] = admit_command(s.limits[input], 0.0, 0.0);
    s.spread[r] = s.noise_sd[input];
  }
  for (std::uint32_t i = 0; i < s.inputs; ++i) s.knot_before[i] = s.mean[i * s.grid.knots];
  start_from_command(s, nullptr);
  expand_mean(s, nullptr);
}

}  // namespace tiller
