#include "planners/sampler.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/rng.hpp"
#include "planners/flush_to_zero.hpp"

namespace tiller {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kWider = 8.0;  // samples for a first plan than those around a plan

// ---- before the rollouts ------------------------------------------------------------------------

/// The old plan, as many periods later as ticks went by (one that pauses in HOLD does not come back stale; one that
/// is asked again in its tick goes on from where it stands).
void shift_plan(Sampler& s, std::uint64_t tick) {
  if (!s.cold && tick > s.last_tick) {
    const std::uint64_t ticks = tick - s.last_tick;
    // two horizons later every knot is the last one
    const std::uint64_t most = 2 * s.clock.horizon;
    const std::uint32_t gone = advance_clock(s.clock, static_cast<std::uint32_t>(ticks < most ? ticks : most));
    for (std::uint32_t i = 0; i < s.inputs; ++i) {
      double* row = s.mean + i * s.grid.knots;
      if (gone > 0) s.knot_before[i] = row[gone < s.grid.knots ? gone - 1 : s.grid.knots - 1];
      shift_knots(row, s.grid.knots, gone);
    }
    s.gone += gone;
    if (s.settings->adapt_covariance) shift_spread(s, gone);
    fill_grid(s.clock, s.first_step, s.fraction);
  }
  s.last_tick = tick;
}

/// Copies rows of M to a splat per particle and to padded lanes (the padding repeats particle 0).
void pack_rows(const float* rows, std::uint32_t count, std::uint32_t m, std::uint32_t stride, std::uint32_t padded,
               float* splats, float* lanes) {
  for (std::uint32_t r = 0; r < count; ++r)
    for (std::uint32_t j = 0; j < padded; ++j) {
      const float x = rows[r * stride + (j < m ? j : 0)];
      lanes[r * padded + j] = x;
      if (j < m) splats[j * count + r] = x;
    }
}

/// False if there is nothing to plan over.
bool take_belief(Sampler& s, const Belief* belief) {
  if (!belief || belief->count == 0) return false;
  s.particles = hypotheses_within(*belief, s.most_particles);
  s.padded = pad_lanes(s.particles);
  s.weighted = belief->weight != nullptr;
  fill_relative_weights(*belief, s.particles, s.particle_weight);
  for (std::uint32_t m = 0; m < s.particles; ++m) s.particle_weight[m] /= static_cast<float>(s.particles);
  pack_rows(belief->state, s.states, s.particles, belief->count, s.padded, s.particle_state, s.lane_state);
  pack_rows(belief->params, s.params, s.particles, belief->count, s.padded, s.particle_params, s.lane_params);
  pack_rows(belief->effect_state, s.effect_states, s.particles, belief->count, s.padded, s.particle_effects,
            s.lane_effects);
  if (s.loop) take_mean_hypothesis(s);
  if (s.noise) draw_rollout_noise(s);
  return true;
}

float risk_tail(const Sampler& s) {
  if (s.settings->risk == tiller_risk_worst) return 1.0f;
  if (s.settings->risk != tiller_risk_cvar) return static_cast<float>(s.particles);
  return static_cast<float>((1.0 - s.settings->cvar_alpha) * s.particles);
}

float risk_share(const Sampler& s) {
  if (s.settings->risk == tiller_risk_worst) return 0.0f;
  return s.settings->risk == tiller_risk_cvar ? static_cast<float>(1.0 - s.settings->cvar_alpha) : 1.0f;
}

/// Of costs (M x lanes).
RiskJob risk_job(const Sampler& s, std::uint32_t lanes, const float* cost, float* risk) {
  RiskJob job;
  job.particles = s.particles;
  job.lanes = lanes;
  job.tail = risk_tail(s);
  job.weight = s.weighted ? s.particle_weight : nullptr;
  job.share = risk_share(s);
  job.cost = cost;
  job.risk = risk;
  return job;
}

/// Where samples reach the limits anyway, a first plan of one input is the cheapest of very wide ones until its last
/// iteration: a mean is drawn to the valley that the first few good samples lie in. With several inputs the cheapest
/// sample is a rough beginning, and the mean leads to better plans; so does the gradient of `hybrid`.
bool explores(const Sampler& s) {
  const bool hybrid = planning_kind(*s.settings) == tiller_planner_hybrid;
  const bool wide = s.noise_sd[0] >= kWidths * (s.limits[0].high - s.limits[0].low);
  return s.cold && wide && s.inputs == 1 && !s.method->draw && !hybrid && s.iteration + 1 < s.settings->iterations;
}

/// False if the deadline passed on the way.
bool prepare_iteration(Sampler& s) {
  for (std::uint32_t i = 0; i < s.inputs; ++i) s.before_lanes[i] = lane_number(s.knot_before[i]);
  for (std::uint32_t pair = 0; 2 * pair < s.rows; ++pair) {
    const std::uint64_t high = (std::uint64_t{kRngPlanner} << 32) | (s.iteration << 16) | pair;
    const Philox::Words words = Philox::draw(s.seed, s.request->tick, high);
    for (int i = 0; i < 4; ++i) s.keys[pair].word[i] = words.w[i];
  }
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    s.row_mean[r] = lane_number(s.mean[r]);
    s.row_spread[r] = lane_number((explores(s) ? kWider : 1.0) * anneal_of_row(s, r) * s.spread[r]);
  }
  return !s.method->draw || s.method->draw(s);
}

// ---- the rollouts -------------------------------------------------------------------------------

RolloutJob<float> common_job(const Sampler& s) {
  RolloutJob<float> job;
  job.setup = s.setup;
  job.horizon = s.grid.horizon;
  job.history = s.request->belief->history;
  job.previous_input = s.start_lanes;
  job.cost = &s.cost_terms;
  job.task_step = s.request->task_step;
  return job;
}

/// One hypothesis alone goes where the mean goes, unless noise drives it: there is nothing to answer.
bool answers(const Sampler& s) { return s.loop && s.loop->has_gain && (s.particles > 1 || s.noise); }

void sample_chunk(Sampler& s, std::uint32_t first, std::uint32_t lanes) {
  SampleJob job;
  job.rows = s.rows;
  job.first_rollout = first;
  job.lanes = lanes;
  job.stride = s.rollouts;
  job.keys = s.keys;
  job.mean = s.row_mean;
  job.sd = s.row_spread;
  job.scale = s.scale;
  job.low = s.row_low;
  job.high = s.row_high;
  job.mix = s.mix;
  job.row_knots = s.grid.knots;
  job.knots = s.knots + first;
  if (!s.method->draw) s.lanes->sample(job);
  if (first != 0) return;
  // rollout 0 is the mean itself, rollout 1 the best sample so far: nothing found is lost again
  for (std::uint32_t r = 0; r < s.rows; ++r) s.knots[r * s.rollouts] = s.row_mean[r];
  if (s.best_cost < kInfinity)
    for (std::uint32_t r = 0; r < s.rows; ++r) s.knots[r * s.rollouts + 1] = static_cast<float>(s.best[r]);
}

/// Controls from knots whose rows are `stride` apart.
void expand_chunk(Sampler& s, const float* knots, std::uint32_t stride, std::uint32_t lanes, float* controls) {
  ExpandJob job;
  job.grid = s.grid;
  job.lanes = lanes;
  job.stride = stride;
  job.knots = knots;
  job.start = s.start_lanes;
  job.rate_step = s.rate_step;
  job.before = s.cubic ? s.before_lanes : nullptr;
  job.hold = s.method->holds;
  job.cones = s.cones.count > 0 ? &s.cones : nullptr;
  job.controls = controls;
  s.lanes->expand(job);
}

/// Where the costs of a chunk begin.
std::size_t chunk_place(const Sampler& s, std::uint32_t place) {
  return std::size_t{place} * s.most_particles * s.chunk_lanes;
}

/// The risk of a chunk's costs (M x lanes).
void reduce_chunk(Sampler& s, std::uint32_t chunk, const float* cost) {
  s.lanes->risk(risk_job(s, lanes_of_chunk(s, chunk), cost, s.cost + chunk * s.chunk_lanes));
}

/// The closed loop around the chunk's own motions of the mean hypothesis.
RolloutFeedback<float> chunk_law(Sampler& s, std::uint32_t slot, std::uint32_t lanes, const float* controls) {
  float* reference = s.loop->references + slot * s.loop->chunk_size;
  RolloutJob<float> job = mean_job(s);
  job.lanes = lanes;
  job.controls = {controls, lanes};
  job.trajectory = reference;
  s.table->rollout_f32(*s.model, job);
  RolloutFeedback<float> law = s.loop->law;
  law.reference = {reference, lanes};
  return law;
}

/// False if the deadline passed on the way. The clock is read once a rollout call.
bool evaluate_chunk(Sampler& s, std::uint32_t slot, std::uint32_t chunk) {
  const std::uint32_t first = first_of_chunk(s, chunk);
  const std::uint32_t lanes = lanes_of_chunk(s, chunk);
  float* controls = s.controls + std::size_t{slot} * s.grid.horizon * s.inputs * s.chunk_lanes;
  const std::size_t place = chunk_place(s, s.keeps_costs ? chunk : slot);
  float* cost = s.particle_cost + place;
  float* penalty = s.penalised ? s.particle_penalty + place : nullptr;
  sample_chunk(s, first, lanes);
  expand_chunk(s, s.knots + first, s.rollouts, lanes, controls);
  RolloutJob<float> job = common_job(s);
  job.lanes = lanes;
  job.controls = {controls, lanes};
  RolloutFeedback<float> law;
  if (answers(s)) {
    if (s.request->deadline.passed()) return false;
    law = chunk_law(s, slot, lanes, controls);
    job.feedback = &law;
  }
  for (std::uint32_t m = 0; m < s.particles; ++m) {
    if (s.request->deadline.passed()) return false;
    if (s.trajectory && s.method->aim(s, slot, chunk, m))
      expand_chunk(s, own_knots_of(s, slot), lanes, lanes, controls);
    job.state = {s.particle_state + m * s.states, 0};
    job.params = {s.particle_params + m * s.params, 0};
    job.effect_state = {s.particle_effects + m * s.effect_states, 0};
    if (s.noise) job.noise = {s.noise + std::size_t{m} * s.grid.horizon * s.states, 0};
    job.cost_out = cost + m * lanes;
    if (penalty) job.penalty_out = penalty + m * lanes;
    if (s.trajectory) job.trajectory = trajectory_of(s, slot);
    s.table->rollout_f32(*s.model, job);
    if (s.trajectory) s.method->observe(s, slot, chunk, m);
  }
  if (!penalty) reduce_chunk(s, chunk, cost);
  return true;
}

/// Takes chunk after chunk, in a scratch of its own: a thread that is late leaves more to the others.
void evaluate_slot(void* self, std::uint32_t slot) {
  Sampler& s = *static_cast<Sampler*>(self);
  const FlushToZero flush;
  for (std::uint32_t chunk; (chunk = s.next_chunk.fetch_add(1, std::memory_order_relaxed)) < s.chunks;)
    if (!evaluate_chunk(s, slot, chunk)) {
      s.aborted.store(true, std::memory_order_relaxed);
      return;
    }
}

/// All K rollouts; false if the deadline passed on the way, and then nothing of the iteration counts.
bool evaluate(Sampler& s) {
  s.next_chunk.store(0, std::memory_order_relaxed);
  s.aborted.store(false, std::memory_order_relaxed);
  if (s.hooks && s.hooks->parallel_for)
    s.hooks->parallel_for(s.hooks->context, s.slots, evaluate_slot, &s);
  else
    evaluate_slot(&s, 0);  // one scratch, which stays in the cache
  return !s.aborted.load(std::memory_order_relaxed);
}

// ---- penalties ----------------------------------------------------------------------------------

/// Calls visit(particle, its costs, its penalties, how many) for every particle in every chunk.
template <class Visit>
void for_particles(const Sampler& s, const Visit& visit) {
  for (std::uint32_t chunk = 0; chunk < s.chunks; ++chunk) {
    const std::uint32_t lanes = lanes_of_chunk(s, chunk);
    for (std::uint32_t m = 0; m < s.particles; ++m) {
      const std::size_t at = chunk_place(s, chunk) + std::size_t{m} * lanes;
      visit(m, s.particle_cost + at, s.particle_penalty + at, lanes);
    }
  }
}

void find_least_penalties(Sampler& s) {
  std::fill(s.least_penalty, s.least_penalty + s.particles, kInfinity);
  for_particles(s, [&](std::uint32_t m, const float* cost, const float* penalty, std::uint32_t lanes) {
    for (std::uint32_t l = 0; l < lanes; ++l)
      if (cost[l] < kInfinity && penalty[l] < s.least_penalty[m]) s.least_penalty[m] = penalty[l];
  });
  for (std::uint32_t m = 0; m < s.particles; ++m)
    if (!(s.least_penalty[m] < kInfinity)) s.least_penalty[m] = 0.0f;
}

/// The penalty's share of particle m's cost. The mean over particles does not care which of them a constant was
/// taken from; a tail does.
float counted_penalty(const Sampler& s, std::uint32_t m, float penalty) {
  const float own = penalty - s.least_penalty[m];
  if (s.settings->risk == tiller_risk_mean) return own;
  return own + (s.least_penalty[m] - static_cast<float>(s.reference));
}

/// The part of the penalties that is the same for all samples.
double shared_penalty(const Sampler& s) {
  double least = static_cast<double>(s.least_penalty[0]), sum = 0.0;
  for (std::uint32_t m = 0; m < s.particles; ++m) {
    least = std::fmin(least, static_cast<double>(s.least_penalty[m]));
    const double weight = s.weighted ? static_cast<double>(s.particle_weight[m]) * s.particles : 1.0;
    sum += weight * static_cast<double>(s.least_penalty[m]);
  }
  return s.settings->risk == tiller_risk_mean ? sum / s.particles : least;
}

/// Costs of this iteration, less what all samples share. What was told of this plan before is told again.
void add_penalties(Sampler& s) {
  find_least_penalties(s);
  const double before = s.reference;
  s.reference = shared_penalty(s);
  for_particles(s, [&](std::uint32_t m, float* cost, const float* penalty, std::uint32_t lanes) {
    for (std::uint32_t l = 0; l < lanes; ++l) cost[l] += counted_penalty(s, m, penalty[l]);
  });
  for (std::uint32_t chunk = 0; chunk < s.chunks; ++chunk)
    reduce_chunk(s, chunk, s.particle_cost + chunk_place(s, chunk));
  if (s.iteration == 0) return;
  s.best_cost += before - s.reference;
  s.warm_cost += before - s.reference;
  if (s.method->rebase) s.method->rebase(s, before - s.reference);
}

/// Iterations until the cap, the deadline, or no finite sample; the number completed.
std::uint32_t iterate(Sampler& s, PlanResult& result) {
  const Deadline& deadline = s.request->deadline;
  for (s.iteration = 0; s.iteration < deadline.iterations; ++s.iteration) {
    if (deadline.passed()) break;
    if (!prepare_iteration(s) || !evaluate(s)) {
      if (s.method->cancel) s.method->cancel(s);
      break;
    }
    if (s.penalised) add_penalties(s);
    s.range = s.lanes->range(s.cost, s.rollouts);
    if (s.range.finite == 0) {
      if (s.method->cancel) s.method->cancel(s);
      result.status = tiller_status_plan_not_finite;
      result.refused = true;
      return s.iteration;
    }
    if (s.method->keep)
      s.method->keep(s);
    else
      keep_rollout(s, cheapest_rollout(s));
    s.mean_cost_before = static_cast<double>(s.cost[0]);
    if (s.iteration == 0) s.warm_cost = s.mean_cost_before;
    for (std::uint32_t r = 0; r < s.rows; ++r) s.before[r] = s.mean[r];
    if (explores(s))
      std::copy(s.best, s.best + s.rows, s.mean);
    else
      s.method->update(s);
  }
  if (s.iteration < deadline.iterations) result.status = tiller_status_iteration_capped;
  return s.iteration;
}

/// Gains for a plan that will have an iteration.
void begin_loop(Sampler& s) {
  if (s.request->deadline.iterations == 0 || s.request->deadline.passed()) return;
  expand_mean(s, nullptr);
  compute_gains(s);
}

}  // namespace

RolloutJob<float> mean_job(const Sampler& s) {
  RolloutJob<float> job = common_job(s);
  job.cost = nullptr;
  job.state = {s.loop->state, 0};
  job.params = {s.loop->params, 0};
  job.effect_state = {s.loop->effects, 0};
  return job;
}

void start_from_command(Sampler& s, const double* last_command) {
  admit_commands(s.limits, s.cones, s.inputs, last_command, s.fallback, s.start);
  for (std::uint32_t i = 0; i < s.inputs; ++i) s.start_lanes[i] = lane_number(s.start[i]);
}

PlanResult plan_by_sampling(void* self, const PlanRequest& request, double* command) {
  Sampler& s = *static_cast<Sampler*>(self);
  PlanResult result;
  s.request = &request;
  (void)s.frame.take_goal(request, s.cost_terms);
  (void)s.frame.move_to(request.origin, s.cost_terms);
  start_from_command(s, request.last_command);
  shift_plan(s, request.tick);
  result.cost = std::numeric_limits<double>::infinity();
  s.best_cost = std::numeric_limits<double>::infinity();
  s.reference = 0.0;
  if (s.loop) s.loop->has_gain = false;
  if (take_belief(s, request.belief)) {
    const FlushToZero flush;  // not around the limits: a denormal command in force is a number like any other
    if (s.loop) begin_loop(s);
    s.method->begin(s);
    result.iterations = iterate(s, result);
    if (result.iterations > 0) {
      result.cost = s.method->choose(s) + s.reference;
      s.cold = false;  // a tick without time leaves the first plan to the next
    }
  } else {
    result.status = tiller_status_plan_not_finite;
  }
  expand_mean(s, command);
  if (s.loop && s.loop->has_gain) roll_reference(s);
  s.request = nullptr;
  return result;
}

const float* sampled_sequence(const void* self) { return static_cast<const Sampler*>(self)->sequence; }

void expand_mean(Sampler& s, double* command) {
  expand_sequence(s.grid, s.limits, s.cones, s.mean, s.start, s.sequence, command, s.cubic ? s.knot_before : nullptr,
                  s.method->holds);
}

double evaluate_mean(Sampler& s) {
  expand_mean(s, nullptr);
  RolloutJob<float> job = common_job(s);
  job.lanes = s.padded;
  job.state = {s.lane_state, s.padded};
  job.params = {s.lane_params, s.padded};
  job.effect_state = {s.lane_effects, s.padded};
  job.controls = {s.sequence, 0};
  if (s.noise) job.noise = {s.lane_noise, s.padded};
  job.cost_out = s.lane_cost;
  job.penalty_out = s.lane_penalty;
  RolloutFeedback<float> law;
  if (answers(s)) {
    roll_reference(s);
    law = s.loop->law;
    law.reference = {s.loop->reference, 0};
    job.feedback = &law;
  }
  s.table->rollout_f32(*s.model, job);
  for (std::uint32_t m = 0; s.penalised && m < s.particles; ++m)
    s.lane_cost[m] += counted_penalty(s, m, s.lane_penalty[m]);
  // the same reduction as the samples': particle costs become a column of one lane, here the first of 16
  float column[kLanePadding * 64];
  for (std::uint32_t m = 0; m < s.particles; ++m)
    for (std::uint32_t l = 0; l < kLanePadding; ++l) column[m * kLanePadding + l] = s.lane_cost[m];
  float risk_lanes[kLanePadding];
  s.lanes->risk(risk_job(s, kLanePadding, column, risk_lanes));
  return static_cast<double>(risk_lanes[0]);
}

float particle_cost(const Sampler& s, std::uint32_t rollout, std::uint32_t m) {
  const std::uint32_t chunk = rollout / s.chunk_lanes, lanes = lanes_of_chunk(s, chunk);
  return s.particle_cost[chunk_place(s, chunk) + std::size_t{m} * lanes + rollout % s.chunk_lanes];
}

void keep_rollout(Sampler& s, std::uint32_t rollout) {
  if (!(static_cast<double>(s.cost[rollout]) < s.best_cost)) return;
  s.best_cost = static_cast<double>(s.cost[rollout]);
  for (std::uint32_t r = 0; r < s.rows; ++r) s.best[r] = static_cast<double>(s.knots[r * s.rollouts + rollout]);
}

float lane_number(double x) {
  constexpr double kBound = 1e15;
  return static_cast<float>(std::fmin(std::fmax(x, -kBound), kBound));
}

std::uint32_t cheapest_rollout(const Sampler& s) {
  std::uint32_t k = 0;
  while (k + 1 < s.rollouts && s.cost[k] != s.range.low) ++k;
  return k;
}

}  // namespace tiller
