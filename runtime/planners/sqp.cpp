// Real-time sequential quadratic programming (Diehl, Bock and Schloeder 2005): an iteration linearises the path, solves
// the quadratic program with its bounds, and rolls the model out under the program's step and gains for several step
// lengths at once; the cheapest motion becomes the path. What bounds on states exceed counts with an exact penalty, the
// same in the program and in the choice of the step. `prepare` shifts the path and linearises it before the measurement
// is there; the program itself takes the deviation of the state, so what is left for the tick is its solution.

#include "planners/sqp.hpp"

#include <cmath>
#include <limits>

#include "planners/flush_to_zero.hpp"
#include "planners/line_search.hpp"

namespace tiller {
namespace {

constexpr double kRelaxed = 100.0;  // tolerances of the program: what a bound may be exceeded by unreported
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNoStep[kCandidates] = {};

bool finite_start(const PathPlan& p) {
  double sum = 0.0;
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.nz; ++i) sum += std::fabs(p.start[i]);
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.np; ++i) sum += std::fabs(p.params[i]);
  return std::isfinite(sum);
}

/// Penalty of what candidate `c` exceeds the bounds on states by.
double bounds_penalty(const Sqp& s, std::uint32_t c) {
  const PathPlan& p = s.plan;
  double sum = 0.0;
  for (std::size_t row = p.scenarios; s.state_bounds && row < (p.horizon + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nx; ++i) {
      const double x = p.candidate_state[(row * p.nz + i) * kCandidates + c];
      sum += std::fmax(0.0, margin_at(s, row, i) + std::fmax(x - s.state_high[i], s.state_low[i] - x));
    }
  return s.exact_weight * sum;
}

std::uint32_t best_candidate(const Sqp& s, double& cost, double& merit) {
  std::uint32_t best = kWarm;
  merit = kInfinity;
  for (std::uint32_t i = kCandidates; i-- > 0;) {
    const double risk = candidate_risk(s.plan, i), all = risk + bounds_penalty(s, i);
    if (!(all < merit)) continue;
    merit = all;
    cost = risk;
    best = i;
  }
  return best;
}

/// Where the path's own inputs are the best by no more than rounding, the full step is as good, and it answers the
/// state that was measured: a cost of 1e9 that nothing changes hides what the answer is worth.
bool prefer_full_step(const Sqp& s, double& cost, double& merit) {
  const double risk = candidate_risk(s.plan, 0), all = risk + bounds_penalty(s, 0);
  if (!(all <= merit + kFlat * std::fabs(merit))) return false;
  cost = risk;
  merit = all;
  return true;
}

/// False, and the path stays, where its motion is not finite.
bool begin_path(Sqp& s) {
  const double cost = roll_open(s.plan);
  if (std::isfinite(cost)) s.cost = cost;
  return std::isfinite(cost);
}

void linearise(Sqp& s) {
  linearise_path(s.plan);
  predict_margins(s);
  quadratise_path(s.plan);
  s.set.stands = false;
  s.prepared = true;
}

/// One iteration; false where nothing finite came of it.
bool iterate(Sqp& s, const Deadline& deadline) {
  PathPlan& p = s.plan;
  if (!s.prepared) linearise(s);
  s.prepared = false;
  const bool solved = solve_program(s, deadline);
  if (solved)
    roll_candidates(p, kStepAlpha, kStepBeta);
  else
    roll_candidates(p, kNoStep, kNoStep);
  double cost = kInfinity, merit = kInfinity;
  std::uint32_t best = best_candidate(s, cost, merit);
  if (!std::isfinite(cost)) return false;
  const bool flat = best == kWarm && solved && prefer_full_step(s, cost, merit);
  if (flat) best = 0;
  const double warm = candidate_risk(p, kWarm) + bounds_penalty(s, kWarm);
  const bool moved = solved && weigh_full_step(p) > kWeightsStand;
  if (moved) p.hessians_stand = false;
  take_candidate(p, best);
  s.cost = cost;
  s.merit = merit;
  if (best == kWarm) {
    if (!moved) raise_regularisation(p);
    s.converged = solved && p.problem.regularisation > kMostRaised;
  } else {
    s.converged = warm - merit <= kConverged * std::fabs(merit) && !moved;
    if (best < 2 && !flat) lower_regularisation(p);
    if (best > 3) raise_regularisation(p);
  }
  return true;
}

void run(Sqp& s, const PlanRequest& request, PlanResult& result) {
  PathPlan& p = s.plan;
  const FlushToZero flush;
  s.converged = false;
  s.cost = kInfinity;
  if (!finite_start(p) || (!p.has_path && !begin_path(s))) {
    result.status = tiller_status_plan_not_finite;
    return;
  }
  while (result.iterations < request.deadline.iterations && !s.converged) {
    if (request.deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    if (!iterate(s, request.deadline)) {
      result.status = tiller_status_plan_not_finite;
      break;
    }
    ++result.iterations;
  }
  const bool stopped = !s.converged && result.iterations < p.settings->iterations;
  if (stopped && result.status == tiller_status_ok) result.status = tiller_status_iteration_capped;
  if (result.iterations == 0) return;
  result.cost = s.cost;
  if (result.status != tiller_status_ok) return;
  if (s.violation > kRelaxed * p.settings->qp_tolerance) result.status = tiller_status_bounds_relaxed;
  if (s.unsolved) result.status = tiller_status_program_unsolved;
}

void shift(Sqp& s, std::uint64_t tick) {
  PathPlan& p = s.plan;
  const std::uint64_t ticks = p.has_sequence && tick > p.last_tick ? tick - p.last_tick : 0;
  if (ticks > 0) shift_active_set(s.set, p.problem, static_cast<std::uint32_t>(ticks < p.horizon ? ticks : p.horizon));
  shift_path(p, tick);
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  Sqp& s = *static_cast<Sqp*>(self);
  PathPlan& p = s.plan;
  PlanResult result;
  result.cost = kInfinity;
  s.prepared = s.prepared && s.prepared_tick == request.tick && p.has_path;
  take_command(p, request.last_command);
  p.task_step = request.task_step;
  shift(s, request.tick);
  if (take_goal(p, request.goal)) s.prepared = false;
  if (take_origin(p, request.origin)) place_hard_bounds(s);
  if (!take_belief(p, request.belief)) {
    result.status = tiller_status_plan_not_finite;
  } else if (request.deadline.iterations > 0) {
    s.prepared = s.prepared && p.has_path;
    run(s, request, result);
  }
  s.prepared = false;
  write_sequence(p, p.control, command);
  return result;
}

/// The path shifted and linearised, and the program's matrices factorised, for the tick after that of the last plan.
void prepare(void* self, const PlanRequest& expected) {
  Sqp& s = *static_cast<Sqp*>(self);
  PathPlan& p = s.plan;
  if (!p.has_path || expected.tick <= p.last_tick) return;
  const FlushToZero flush;
  take_command(p, expected.last_command);
  p.task_step = expected.task_step;
  shift(s, expected.tick);
  if (!p.has_path) return;
  linearise(s);
  s.prepared_tick = expected.tick;
  prefactorise(s);
}

void reset(void* self) {
  Sqp& s = *static_cast<Sqp*>(self);
  reset_path_plan(s.plan);
  s.prepared = s.converged = s.unsolved = s.set.stands = false;
  s.violation = 0.0;
  for (std::size_t i = 0; i < std::size_t{s.plan.horizon} * s.plan.nu; ++i) s.set.held[i] = 0;
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t*) {
  auto* s = arena.take<Sqp>(1);
  Sqp nobody;
  Sqp& place = s ? *s : nobody;
  lay_out_path_plan(arena, config, setup, table, place.plan);
  lay_out_programs(arena, config, table, place);
  if (!s || !arena.fits()) return nullptr;
  reset(s);
  return s;
}

const float* sequence(const void* self) { return static_cast<const Sqp*>(self)->plan.sequence; }

bool feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input) {
  return path_feedback(static_cast<const Sqp*>(self)->plan, step, gain, state, input);
}

}  // namespace

extern const PlannerTable sqp_planner;
const PlannerTable sqp_planner = {"sqp", lay_out, plan, reset, sequence, prepare, feedback, true, false, true};

}  // namespace tiller
