// Real-time sequential quadratic programming (Diehl, Bock and Schloeder 2005): an iteration linearises the path, solves
// the quadratic program with its bounds, and steps.
//
//   single    rolls the model out under the program's step and gains for several step lengths at once; the cheapest
//             motion becomes the path
//   multiple  steps states and inputs along the solution (multiple_shooting.hpp) and leaves defects to the next program
//
// A cold start under one hypothesis is one of multiple shooting: far from the goal, motions of the model alone lead
// into poor local minima. Once a motion is as cheap as the path, single shooting goes on from it, and a warm tick rolls
// out once an iteration. Warm ticks do not turn back to multiple shooting, not even where single shooting steps short:
// that finds cheaper plans and hops between valleys, which cost more in closed loop
// (docs/theory/planners_constrained.md). Under several hypotheses all shooting is single: a path for each of them is
// dear.
//
// What bounds on states exceed counts with an exact penalty, the same in the program and in the choice of the step.
// `prepare` shifts the path and linearises it before the measurement is there; the program itself takes the deviation
// of the state, so what is left for the tick is its solution.

#include "planners/sqp.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "planners/escape.hpp"
#include "planners/flush_to_zero.hpp"
#include "planners/line_search.hpp"
#include "planners/sqp_tree.hpp"

namespace tiller {
namespace {

constexpr double kRelaxed = 100.0;  // tolerances of the program: what a bound may be exceeded by unreported
constexpr double kClosed = 1e-6;    // share of its cost that a motion may cost more than the path that it replaces
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNoStep[kCandidates] = {};

bool finite_start(const PathPlan& p) {
  double sum = 0.0;
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.nz; ++i) sum += std::fabs(p.start[i]);
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.np; ++i) sum += std::fabs(p.params[i]);
  return std::isfinite(sum);
}

double bounds_excess(const Sqp& s, std::uint32_t c) { return candidate_excess(s.plan, s.bounds, s.margin, c); }
double bounds_penalty(const Sqp& s, std::uint32_t c) { return s.exact_weight * bounds_excess(s, c); }

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

bool shoots_multiple(const Sqp& s) {
  return s.plan.scenarios == 1 && s.plan.settings->shooting == tiller_shooting_multiple;
}

/// Candidate `c` becomes the motion whose inputs are sent while a path is open.
void settle_on(Sqp& s, std::uint32_t c) {
  PathPlan& p = s.plan;
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i)
    p.settled[i] = p.candidate_control[i * kCandidates + c];
  s.settled_cost = candidate_risk(p, c);
  s.settled_excess = bounds_excess(s, c);
}

/// False, and the path stays, where its motion is not finite.
bool begin_path(Sqp& s) {
  PathPlan& p = s.plan;
  if (s.open) std::memcpy(p.control, p.settled, std::size_t{p.horizon} * p.nu * sizeof(double));
  s.open = false;
  s.multiple = shoots_multiple(s);
  const double cost = roll_open(p);
  if (!std::isfinite(cost)) return false;
  s.cost = cost;
  settle_on(s, kWarm);
  return true;
}

/// What the inputs that would be sent without another iteration cost from the present start.
void weigh_settled(Sqp& s) {
  PathPlan& p = s.plan;
  const std::size_t count = std::size_t{p.horizon} * p.nu;
  if (!s.open) std::copy(p.control, p.control + count, p.settled);
  std::swap_ranges(p.control, p.control + count, p.settled);
  roll_candidates(p, kNoStep, kNoStep);
  std::swap_ranges(p.control, p.control + count, p.settled);
  s.settled_cost = candidate_risk(p, kWarm);
  s.settled_excess = bounds_excess(s, kWarm);
}

void predict_path_margins(Sqp& s) {
  if (s.margin && s.bounds.of_states) predict_margins(s.plan, s.bounds, s.room, s.margin);
}

void linearise(Sqp& s) {
  linearise_path(s.plan);
  predict_path_margins(s);
  quadratise_path(s.plan);
  s.part.set.stands = false;
  s.prepared = true;
}

/// Rolls the program's candidates out; without a solution, the path's inputs alone.
void roll_program(Sqp& s, bool solved) {
  roll_candidates(s.plan, solved ? kStepAlpha : kNoStep, solved ? kStepBeta : kNoStep);
}

// ---- multiple shooting --------------------------------------------------------------------------

MeritBounds merit_bounds(const Sqp& s) {
  MeritBounds bounds;
  if (s.bounds.of_states) bounds = {s.bounds.low, s.bounds.high, s.margin, s.exact_weight};
  return bounds;
}

/// The path becomes the motion of the inputs that were sent last. Nothing of the path that is given up goes into it: a
/// rollout multiplies by its gains and states even where it takes no share of them.
bool fall_back(Sqp& s) {
  PathPlan& p = s.plan;
  std::memcpy(p.control, p.settled, std::size_t{p.horizon} * p.nu * sizeof(double));
  for (std::size_t k = 0; k <= p.horizon; ++k) std::memcpy(p.state + k * p.nz, p.start, p.nz * sizeof(double));
  drop_gains(p);
  p.problem.regularisation = p.settings->regularisation;
  s.open = p.has_path = false;
  const bool finite = begin_path(s);
  s.multiple = false;
  return finite;
}

double settled_merit(const Sqp& s) { return s.settled_cost + s.exact_weight * s.settled_excess; }
bool beats_settled(const Sqp& s, double merit) { return std::isfinite(merit) && merit <= settled_merit(s); }

/// The path becomes a motion of the model again, with as much of the program's step as is good for it.
bool close_path(Sqp& s, bool solved) {
  PathPlan& p = s.plan;
  roll_program(s, solved);
  const std::uint32_t best = best_candidate(s, s.cost, s.merit);
  if (!beats_settled(s, s.merit)) return fall_back(s);
  take_candidate(p, best);
  s.open = s.multiple = false;
  raise_regularisation(p);
  s.converged = solved && p.problem.regularisation > kMostRaised;
  return true;
}

/// One iteration of multiple shooting; false where nothing finite came of it.
bool iterate_multiple(Sqp& s, const Deadline& deadline) {
  if (!s.prepared) linearise(s);
  s.prepared = false;
  const bool solved = solve_program(s, deadline);
  const PathStep step = {s.part.plain.solution.x, s.part.plain.solution.u};
  if (!solved || !step_by_merit(s.plan, step, merit_bounds(s), s.shooting)) return close_path(s, solved);
  predict_path_margins(s);
  s.part.set.stands = false;
  s.prepared = s.open = true;
  s.converged = -s.shooting.expected <= kConverged * std::fabs(s.shooting.merit);
  lower_regularisation(s.plan);
  return true;
}

/// What an open path sends: its inputs from the present start, as they are or under the gains, or those sent before,
/// whichever cost least. The path ends where its own motion is as cheap as it is, and where the motion sent before is
/// cheaper than the path with its defects.
bool settle(Sqp& s) {
  PathPlan& p = s.plan;
  const double path = p.risk.value(p.path_cost) + s.exact_weight * path_excess(p, merit_bounds(s));
  roll_candidates(p, kNoStep, kStepBeta);
  const std::uint32_t best = best_candidate(s, s.cost, s.merit);
  if (!beats_settled(s, s.merit)) {
    s.cost = s.settled_cost;
    s.merit = settled_merit(s);
    return path + s.shooting.penalty * path_defects(p) < s.merit || fall_back(s);
  }
  settle_on(s, best);
  if (s.merit > path + kClosed * std::fabs(path)) return true;
  take_candidate(p, best);
  s.open = s.multiple = false;
  return true;
}

// ---- single shooting ----------------------------------------------------------------------------

/// One iteration of single shooting; false where nothing finite came of it.
bool iterate_single(Sqp& s, const Deadline& deadline) {
  PathPlan& p = s.plan;
  if (!s.prepared) linearise(s);
  s.prepared = false;
  const bool solved = solve_program(s, deadline);
  roll_program(s, solved);
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

// ---- a plan -------------------------------------------------------------------------------------

/// The scout's motion becomes the path where it costs less on all hypotheses, with what it exceeds the bounds by. A
/// path with defects that promises more is left to close them first.
void weigh_scout(Sqp& s) {
  PathPlan& p = s.plan;
  if (!try_scout(*s.escape, p)) return;
  const double cost = candidate_risk(p, kWarm), merit = cost + bounds_penalty(s, kWarm);
  const double promised = s.open ? p.risk.value(p.path_cost) : kInfinity;
  if (!saves(merit, std::fmin(s.merit, promised))) return take_back(*s.escape, p);
  follow_scout(*s.escape, p);
  s.open = s.multiple = s.prepared = s.part.set.stands = false;
  s.cost = cost;
  s.merit = merit;
}

void run(Sqp& s, const PlanRequest& request, PlanResult& result) {
  PathPlan& p = s.plan;
  const FlushToZero flush;
  s.converged = false;
  s.shooting.penalty = 0.0;
  s.cost = kInfinity;
  const bool cold = !p.has_path;
  if (!finite_start(p) || (cold && !begin_path(s))) {
    result.status = tiller_status_plan_not_finite;
    return;
  }
  if (s.multiple && !cold) weigh_settled(s);
  const IterationBudget budget = iteration_budget(request.deadline, *p.settings);
  while (result.iterations < budget.cap && !s.converged) {
    if (request.deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    if (!(s.multiple ? iterate_multiple(s, request.deadline) : iterate_single(s, request.deadline))) {
      result.status = tiller_status_plan_not_finite;
      result.refused = true;
      break;
    }
    ++result.iterations;
  }
  const bool tried = result.iterations > 0 || result.status == tiller_status_plan_not_finite;
  if (s.open && tried && !settle(s)) result.status = tiller_status_plan_not_finite;
  const bool stopped = !s.converged && result.iterations < p.settings->iterations;
  if (stopped && result.status == tiller_status_ok) result.status = tiller_status_iteration_capped;
  if (result.iterations == 0) return;
  if (result.status != tiller_status_plan_not_finite) {
    result.iterations += search_beside(*s.escape, p, s.cost, request, budget.left(result.iterations));
    weigh_scout(s);
  }
  result.cost = s.cost;
  if (result.status != tiller_status_ok) return;
  if (s.violation > kRelaxed * p.settings->qp_tolerance) result.status = tiller_status_bounds_relaxed;
  if (s.unsolved) result.status = tiller_status_program_unsolved;
}

/// The inputs of an open path, as many periods later.
void shift_settled(PathPlan& p, std::size_t gone) {
  for (std::size_t k = 0; k < p.horizon; ++k) {
    const std::size_t from = k + gone < p.horizon ? k + gone : p.horizon - 1;
    std::memmove(p.settled + k * p.nu, p.settled + from * p.nu, p.nu * sizeof(double));
  }
}

void shift(Sqp& s, std::uint64_t tick) {
  PathPlan& p = s.plan;
  const std::uint64_t ticks = p.has_sequence && tick > p.last_tick ? tick - p.last_tick : 0;
  const auto gone = static_cast<std::uint32_t>(ticks < p.horizon ? ticks : p.horizon);
  if (gone > 0) shift_active_set(s.part.set, p.problem, gone);
  if (gone > 0 && s.part.whole.dual.length > 0)
    shift_active_set(s.part.whole.dual, s.bounds.of_rates ? lifted_sizes(p, p.problem) : p.problem, gone);
  if (gone > 0 && s.open) shift_settled(p, gone);
  shift_path(p, tick);
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  Sqp& s = *static_cast<Sqp*>(self);
  if (s.tree) return plan_sqp_tree(*s.tree, request, command);
  PathPlan& p = s.plan;
  PlanResult result;
  result.cost = kInfinity;
  s.prepared = s.prepared && s.prepared_tick == request.tick && p.has_path;
  take_command(p, request.last_command);
  p.task_step = request.task_step;
  shift(s, request.tick);
  if (take_goal(p, request)) s.prepared = false;
  if (take_origin(p, request.origin)) place_hard_bounds(p, s.bounds);
  if (!take_belief(p, request.belief)) {
    result.status = tiller_status_plan_not_finite;
  } else if (request.deadline.begins()) {
    s.prepared = s.prepared && p.has_path;
    run(s, request, result);
  }
  s.prepared = false;
  write_sequence(p, s.open ? p.settled : p.control, command);
  return result;
}

/// The path shifted and linearised, and the program's matrices factorised, for the tick after that of the last plan.
void prepare(void* self, const PlanRequest& expected) {
  Sqp& s = *static_cast<Sqp*>(self);
  if (s.tree) return;
  PathPlan& p = s.plan;
  if (!p.has_path || expected.tick <= p.last_tick) return;
  const FlushToZero flush;
  take_command(p, expected.last_command);
  (void)take_goal(p, expected);
  p.task_step = expected.task_step;
  shift(s, expected.tick);
  if (!p.has_path) return;
  linearise(s);
  s.prepared_tick = expected.tick;
  prefactorise(s);
}

void reset(void* self) {
  Sqp& s = *static_cast<Sqp*>(self);
  if (s.tree) return reset_sqp_tree(*s.tree);
  reset_path_plan(s.plan);
  reset_escape(*s.escape);
  s.prepared = s.converged = s.unsolved = s.part.set.stands = s.multiple = s.open = false;
  s.part.whole.dual.sound = false;
  if (s.part.whole.dual.length > 0) forget_active_set(s.part.whole.dual);
  s.violation = 0.0;
  for (std::size_t i = 0; i < std::size_t{s.plan.horizon} * s.plan.nu; ++i) s.part.set.held[i] = 0;
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t*) {
  auto* s = arena.take<Sqp>(1);
  if (wants_tree(config)) {
    SqpTree* const tree = lay_out_sqp_tree(arena, config, setup, table);
    if (!s || !tree) return nullptr;
    s->tree = tree;
    return s;
  }
  Sqp nobody;
  Sqp& place = s ? *s : nobody;
  lay_out_path_plan(arena, config, setup, table, place.plan);
  lay_out_programs(arena, config, setup, table, place);
  Escape* const escape = lay_out_escape(arena, config, setup, table);
  if (!s || !escape || !arena.fits()) return nullptr;
  s->escape = escape;
  reset(s);
  return s;
}

const float* sequence(const void* self) {
  const Sqp& s = *static_cast<const Sqp*>(self);
  return s.tree ? tree_sequence(*s.tree->tree) : s.plan.sequence;
}

bool feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input) {
  const Sqp& s = *static_cast<const Sqp*>(self);
  return s.tree ? tree_feedback(*s.tree->tree, step, gain, state, input)
                : path_feedback(s.plan, step, gain, state, input);
}

}  // namespace

extern const PlannerTable sqp_planner;
const PlannerTable sqp_planner = {"sqp", lay_out, plan, reset, sequence, prepare, feedback, true, false, true};

}  // namespace tiller
