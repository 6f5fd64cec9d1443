#include "planners/closed_loop.hpp"

#include <cmath>
#include <cstring>

#include "planners/line_search.hpp"
#include "planners/sampler.hpp"
#include "rollout/attitude.hpp"

namespace tiller {
namespace {

constexpr int kMostRaises = 8;  // of the regularisation, until the sweep finds a positive definite curvature

/// A hypothesis' share of a mean, times M; 1 where all are alike.
double weight_of(const Sampler& s, std::uint32_t j) {
  return s.weighted ? static_cast<double>(s.particle_weight[j]) * s.particles : 1.0;
}

/// Mean over the M hypotheses of row `i` of a splat array (M x count).
double mean_of(const Sampler& s, const float* splats, std::uint32_t count, std::uint32_t i) {
  double sum = 0.0;
  for (std::uint32_t j = 0; j < s.particles; ++j) sum += weight_of(s, j) * static_cast<double>(splats[j * count + i]);
  return sum / s.particles;
}

/// An angle's mean is that of the differences from the first hypothesis.
double mean_state(const Sampler& s, std::uint32_t i) {
  if (((s.model->angle_mask >> i) & 1u) == 0) return mean_of(s, s.particle_state, s.states, i);
  const double first = static_cast<double>(s.particle_state[i]);
  double sum = 0.0;
  for (std::uint32_t j = 0; j < s.particles; ++j)
    sum +=
        weight_of(s, j) * state_difference(*s.model, i, static_cast<double>(s.particle_state[j * s.states + i]), first);
  return first + sum / s.particles;
}

void set_state(Sampler& s, std::uint32_t j, std::uint32_t i, double x) {
  s.particle_state[j * s.states + i] = s.lane_state[i * s.padded + j] = static_cast<float>(x);
}

/// q and -q are one attitude: every hypothesis takes the first one's sign, and the mean has length one.
void average_attitudes(Sampler& s, float* mean) {
  for_quaternions(s.model->quaternion_mask, [&](std::uint32_t q) {
    double sum[4] = {};
    for (std::uint32_t j = 0; j < s.particles; ++j) {
      const float* x = s.particle_state + j * s.states + q;
      const float* first = s.particle_state + q;
      const float along = x[0] * first[0] + x[1] * first[1] + x[2] * first[2] + x[3] * first[3];
      for (std::uint32_t i = 0; i < 4; ++i) {
        const double part = static_cast<double>(along < 0.0f ? -x[i] : x[i]);
        if (j > 0) set_state(s, j, q + i, part);
        sum[i] += weight_of(s, j) * part;
      }
    }
    const double length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2] + sum[3] * sum[3]);
    for (std::uint32_t i = 0; i < 4; ++i) mean[q + i] = static_cast<float>(length > 0.0 ? sum[i] / length : i == 0);
  });
}

/// Every input free: a sample that answers at a limit is cut there.
bool sweep(PathPlan& p) {
  std::memset(p.factor.held, 0, std::size_t{p.horizon} * p.nu);
  p.problem.regularisation = p.settings->regularisation;
  for (int i = 0; i <= kMostRaises; ++i) {
    if (p.lq->factorise(p.problem, p.factor)) return true;
    raise_regularisation(p);
  }
  return false;
}

/// The columns of the states, and those of the input before where the problem has them; effect states stay out.
void copy_gains(const PathPlan& p, MotionLaw& loop) {
  for (std::size_t row = 0; row < std::size_t{p.horizon} * p.nu; ++row) {
    const double* from = p.factor.gain + row * p.n;
    float* to = loop.gain + row * loop.law.columns;
    for (std::uint32_t c = 0; c < loop.law.columns; ++c) to[c] = lane_number(from[c < p.nx ? c : p.nz + (c - p.nx)]);
  }
}

}  // namespace

bool closes_loop(const tiller_config_t& config, const SamplingMethod& method) {
  return config.planner.closed_loop != 0 && !method.draw && planning_kind(config.planner) != tiller_planner_hybrid;
}

void lay_out_law(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                 MotionLaw& law) {
  lay_out_path_plan(arena, config, setup, table, law.path, 1);
  const PathPlan& p = law.path;
  law.law.columns = p.nx + (p.rate ? p.nu : 0);
  law.gain = arena.take<float>(std::size_t{p.horizon} * p.nu * law.law.columns);
  for (std::uint32_t i = 0; i < p.nu; ++i) {
    law.low[i] = lane_number(p.limits[i].low);
    law.high[i] = lane_number(p.limits[i].high);
    law.most_change[i] = lane_number(p.limits[i].step);
  }
  law.law.gain = law.gain;
  law.law.low = law.low;
  law.law.high = law.high;
  law.law.most_change = law.most_change;
  law.law.cones = p.cones.count > 0 ? &p.cones : nullptr;
}

void compute_law(MotionLaw& law, const PlanRequest& request, const Belief& belief, const float* sequence) {
  PathPlan& p = law.path;
  law.has_gain = false;
  (void)take_goal(p, request);
  (void)take_origin(p, request.origin);
  take_command(p, request.last_command);
  p.task_step = request.task_step;
  p.has_path = false;  // the angles' turn is the belief's
  (void)take_belief(p, &belief);
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) p.control[i] = static_cast<double>(sequence[i]);
  std::memset(law.gain, 0, std::size_t{p.horizon} * p.nu * law.law.columns * sizeof(float));
  if (!std::isfinite(roll_open(p))) return;
  linearise_path(p);
  quadratise_path(p);
  clear_defects(p);
  if (!sweep(p)) return;
  copy_gains(p, law);
  law.has_gain = true;
}

ClosedLoop* lay_out_closed_loop(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                const RolloutTable& table, std::uint32_t slots, std::uint32_t chunk_lanes) {
  auto* placed = arena.take<ClosedLoop>(1);
  ClosedLoop nobody;
  ClosedLoop& loop = placed ? *placed : nobody;
  lay_out_law(arena, config, setup, table, loop);
  const PathPlan& p = loop.path;
  loop.chunk_size = (std::size_t{p.horizon} + 1) * p.nx * chunk_lanes;
  loop.state = arena.take<float>(p.nx);
  loop.params = arena.take<float>(p.np);
  loop.effects = arena.take<float>(p.ns);
  loop.references = arena.take<float>(slots * loop.chunk_size);
  loop.reference = arena.take<float>((std::size_t{p.horizon} + 1) * p.nx * kLanePadding);
  if (!placed || !arena.fits()) return nullptr;
  loop.law.from = config.planner.shared_steps > 0 ? config.planner.shared_steps : 1;
  reset_closed_loop(loop);
  return placed;
}

void reset_closed_loop(ClosedLoop& loop) {
  reset_path_plan(loop.path);
  loop.has_gain = false;
}

void take_mean_hypothesis(Sampler& s) {
  ClosedLoop& loop = *s.loop;
  for (std::uint32_t i = 0; i < s.params; ++i)
    loop.params[i] = static_cast<float>(mean_of(s, s.particle_params, s.params, i));
  for (std::uint32_t i = 0; i < s.effect_states; ++i)
    loop.effects[i] = static_cast<float>(mean_of(s, s.particle_effects, s.effect_states, i));
  for (std::uint32_t i = 0; i < s.states; ++i) loop.state[i] = static_cast<float>(mean_state(s, i));
  for (std::uint32_t i = 0; i < s.states; ++i) {
    if (((s.model->angle_mask >> i) & 1u) == 0) continue;
    const double mean = static_cast<double>(loop.state[i]);
    for (std::uint32_t j = 0; j < s.particles; ++j)
      set_state(s, j, i,
                mean + state_difference(*s.model, i, static_cast<double>(s.particle_state[j * s.states + i]), mean));
  }
  average_attitudes(s, loop.state);
}

void compute_gains(Sampler& s) {
  ClosedLoop& loop = *s.loop;
  compute_law(loop, *s.request, {1, loop.params, loop.state, loop.effects, nullptr}, s.sequence);
}

void roll_reference(Sampler& s) {
  ClosedLoop& loop = *s.loop;
  RolloutJob<float> job = mean_job(s);
  job.lanes = kLanePadding;
  job.controls = {s.sequence, 0};
  job.trajectory = loop.reference;
  s.table->rollout_f32(*s.model, job);
  const std::size_t rows = (std::size_t{s.grid.horizon} + 1) * s.states;
  for (std::size_t i = 0; i < rows; ++i) loop.reference[i] = loop.reference[i * kLanePadding];
}

bool sampled_feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input) {
  const Sampler& s = *static_cast<const Sampler*>(self);
  if (!s.loop || !s.loop->has_gain || step >= s.grid.horizon) return false;
  const ClosedLoop& loop = *s.loop;
  for (std::uint32_t i = 0; gain && i < s.inputs; ++i)
    for (std::uint32_t c = 0; c < s.states; ++c)
      gain[i * s.states + c] =
          static_cast<double>(loop.gain[(std::size_t{step} * s.inputs + i) * loop.law.columns + c]);
  for (std::uint32_t c = 0; state && c < s.states; ++c)
    state[c] = static_cast<double>(loop.reference[std::size_t{step} * s.states + c]);
  for (std::uint32_t i = 0; input && i < s.inputs; ++i)
    input[i] = static_cast<double>(s.sequence[std::size_t{step} * s.inputs + i]);
  return true;
}

}  // namespace tiller
