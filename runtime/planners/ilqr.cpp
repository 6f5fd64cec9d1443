// Iterative LQR (Li and Todorov 2004; Tassa, Mansard and Todorov 2014 for inputs in a box) and its multiple-shooting
// sister (Giftthaler et al. 2018), one linear-quadratic problem an iteration:
//
//   single    linearise around a motion of the model, solve, roll the model out under the gains for several step
//             lengths at once, keep the cheapest
//   multiple  states are variables too: linearise around any path, solve with its defects, step. One iteration a tick
//             is the real-time iteration of Diehl et al. 2005. Once its motion costs no more than the path, single
//             shooting goes on
//
// Differences from the papers, and why:
//   - the box holds for the whole sequence: which inputs are at a limit is found by an active set over Riccati sweeps
//     (solve_lq_box), not stage by stage around the old path, so a problem that is linear takes one iteration;
//   - curvature of the dynamics is left out (Gauss-Newton): Hessians stay positive semi-definite and nothing needs a
//     repair; the least addition to the inputs' curvature is a setting.

#include <cmath>
#include <cstring>
#include <limits>

#include "planners/escape.hpp"
#include "planners/flush_to_zero.hpp"
#include "planners/line_search.hpp"
#include "planners/sqp_tree.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kSweeps = 6;  // of the active set, an iteration; the next one goes on from its set
constexpr double kClosed = 1e-6;      // share of its cost that a motion may cost more than the path that it replaces
constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::uint32_t cheapest(const PathPlan& p, double& cost) {
  std::uint32_t best = 0;
  cost = kInfinity;
  for (std::uint32_t i = 0; i < kCandidates; ++i) {
    const double c = candidate_risk(p, i);
    if (c < cost) {
      cost = c;
      best = i;
    }
  }
  return best;
}

/// The linear-quadratic problem around the present path.
void stand(Ilqr& s) {
  if (s.standing) return;
  linearise_path(s.plan);
  quadratise_path(s.plan);
  s.standing = true;
  s.solved = false;
}

bool solve(Ilqr& s) {
  PathPlan& p = s.plan;
  if (s.single)
    clear_defects(p);
  else
    take_defects(p);
  if (take_box(p)) s.solved = false;
  s.solved = solve_path(p, kSweeps, s.solved);
  if (s.solved && !path_within_cones(p, p.du)) {
    p.exact = false;  // the factor is that of the problem with its cones
    s.solved = solve_with_cones(p, s.cones, s.deadline);
  }
  if (!s.solved) raise_regularisation(p);
  return s.solved;
}

}  // namespace

// ---- single shooting ----------------------------------------------------------------------------

bool roll_open(Ilqr& s) {
  const double cost = roll_open(s.plan);
  if (std::isfinite(cost)) s.cost = cost;
  return std::isfinite(cost);
}

bool roll_again(Ilqr& s) {
  if (!s.plan.has_path || !s.plan.has_gain) return roll_open(s);
  std::uint32_t chosen = kWarm;
  const double cost = roll_warm(s.plan, chosen);
  if (std::isfinite(cost)) s.cost = cost;
  return std::isfinite(cost);
}

bool restart_path(Ilqr& s, const double* inputs) {
  PathPlan& p = s.plan;
  const std::size_t row = std::size_t{p.scenarios} * p.nz;
  for (std::size_t k = 0; k <= p.horizon; ++k) std::memcpy(p.state + k * row, p.start, row * sizeof(double));
  std::memcpy(p.control, inputs, std::size_t{p.horizon} * p.nu * sizeof(double));
  s.single = true;
  s.settled = s.standing = p.has_gain = false;
  return roll_open(s);
}

bool iterate_single(Ilqr& s) {
  PathPlan& p = s.plan;
  stand(s);
  if (!solve(s)) return std::isfinite(s.cost);
  s.solved = false;
  roll_candidates(p, kStepAlpha, kStepBeta);
  double cost = kInfinity;
  const std::uint32_t best = cheapest(p, cost);
  // weights that moved make another problem of the same path
  const bool moved = weigh_full_step(p) > kWeightsStand;
  if (moved) s.standing = false;
  if (!(cost < s.cost)) {
    // the full step costs the same: nothing is left to gain, and a raise would only blunt the gains
    const bool flat = candidate_risk(p, 0) <= s.cost + kFlat * std::fabs(s.cost);
    if (!moved && !flat) raise_regularisation(p);
    s.converged = (!moved && flat) || p.problem.regularisation > kMostRaised;
    return std::isfinite(s.cost);
  }
  s.converged = !moved && s.cost - cost <= kConverged * std::fabs(cost);
  take_candidate(p, best);
  s.cost = cost;
  s.standing = false;
  if (best < 2)
    lower_regularisation(p);
  else if (best > 3)
    raise_regularisation(p);
  return true;
}

// ---- multiple shooting --------------------------------------------------------------------------

bool iterate_multiple(Ilqr& s) {
  PathPlan& p = s.plan;
  stand(s);
  if (!std::isfinite(p.risk.value(p.path_cost)) || !std::isfinite(path_defects(p))) return false;
  if (!solve(s)) return true;
  if (p.rate_limited || p.cones.count > 0) limit_solution(p);
  s.solved = false;
  if (step_by_merit(p, {p.dx, p.du}, {}, s.shooting)) {
    const bool moved = p.risk.update(p.path_cost) > kWeightsStand;
    s.standing = !moved;
    s.converged = !moved && -s.shooting.expected <= kConverged * std::fabs(s.shooting.merit);
    lower_regularisation(p);
    return true;
  }
  // no step along the linear solution is good: the path becomes a motion of the model from the start again
  s.standing = false;
  raise_regularisation(p);
  s.converged = p.problem.regularisation > kMostRaised;
  double rolled = kInfinity;
  roll_candidates(p, kStepAlpha, kStepBeta);
  const std::uint32_t best = cheapest(p, rolled);
  if (std::isfinite(rolled)) take_candidate(p, best);
  s.shooting.penalty = 0.0;
  return true;
}

std::uint32_t settle_multiple(Ilqr& s) {
  PathPlan& p = s.plan;
  roll_candidates(p, kStepAlpha, kStepBeta);
  const double plain = candidate_risk(p, kWarm), gains = candidate_risk(p, kWarmUnderGains);
  const std::uint32_t chosen = gains < plain ? kWarmUnderGains : kWarm;
  s.cost = gains < plain ? gains : plain;
  s.settled = std::isfinite(s.cost);
  for (std::size_t i = 0; s.settled && i < std::size_t{p.horizon} * p.nu; ++i)
    p.settled[i] = p.candidate_control[i * kCandidates + chosen];
  return chosen;
}

void close_path(Ilqr& s) {
  PathPlan& p = s.plan;
  const double path = s.standing ? p.risk.value(p.path_cost) : kInfinity;
  const std::uint32_t chosen = settle_multiple(s);
  if (!s.settled || s.cost > path + kClosed * std::fabs(path)) return;
  take_candidate(p, chosen);
  s.single = true;
  s.settled = s.standing = false;
}

namespace {

// ---- a plan -------------------------------------------------------------------------------------

/// False where the path cannot be made a motion of the model.
bool begin(Ilqr& s) {
  PathPlan& p = s.plan;
  s.converged = false;
  s.shooting.penalty = 0.0;
  s.cost = kInfinity;
  if (!p.has_path) s.single = p.settings->shooting == tiller_shooting_single;
  // the inputs' motion from the present start: what single shooting linearises around; already known where prepared
  if (s.single && !s.standing) return roll_again(s);
  return p.has_path || roll_open(s);
}

/// The scout's motion becomes the path where it costs less on all hypotheses. A path with defects that promises more is
/// left to close them first.
void weigh_scout(Ilqr& s) {
  PathPlan& p = s.plan;
  if (!try_scout(*s.escape, p)) return;
  const double cost = candidate_risk(p, kWarm);
  const double promised = !s.single && s.standing ? p.risk.value(p.path_cost) : kInfinity;
  if (!saves(cost, std::fmin(s.cost, promised))) return take_back(*s.escape, p);
  follow_scout(*s.escape, p);
  s.single = true;
  s.settled = s.standing = s.solved = false;
  s.cost = cost;
}

void iterate(Ilqr& s, const PlanRequest& request, PlanResult& result) {
  const FlushToZero flush;
  if (!begin(s)) {
    result.status = tiller_status_plan_not_finite;
    return;
  }
  const IterationBudget budget = iteration_budget(request.deadline, *s.plan.settings);
  while (result.iterations < budget.cap && !s.converged) {
    if (request.deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    if (!(s.single ? iterate_single(s) : iterate_multiple(s))) {
      s.converged = true;  // as far as this path goes
      break;
    }
    ++result.iterations;
  }
  if (!s.converged && result.iterations < s.plan.settings->iterations) result.status = tiller_status_iteration_capped;
  if (result.iterations == 0) {
    if (s.converged) result.status = tiller_status_plan_not_finite;
    return;
  }
  if (!s.single) close_path(s);
  if (s.escape) {
    result.iterations += search_beside(*s.escape, s.plan, s.cost, request, budget.left(result.iterations));
    weigh_scout(s);
  }
  result.cost = s.cost;
  // the path's inputs lead beyond all numbers from the present start: whoever sent them would send what nobody weighed
  if (!std::isfinite(s.cost)) result.status = tiller_status_plan_not_finite;
}

/// The tree's own solver knows the inputs' limits alone: their cones are for the program of `sqp`. A build without it
/// cuts rollouts to the cones.
#ifdef TILLER_HAS_SQP
constexpr bool kConeTrees = true;
#else
constexpr bool kConeTrees = false;
#endif

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  Ilqr& s = *static_cast<Ilqr*>(self);
  if constexpr (kConeTrees)
    if (s.cone_tree) return plan_sqp_tree(*s.cone_tree, request, command);
  if (s.tree) return plan_tree(*s.tree, request, command);
  PathPlan& p = s.plan;
  PlanResult result;
  result.cost = kInfinity;
  if (!take_request(s, request)) {
    result.status = tiller_status_plan_not_finite;
  } else if (request.deadline.begins()) {
    if (!p.has_path) s.standing = s.solved = false;
    iterate(s, request, result);
  }
  s.standing = s.solved = false;
  write_sequence(p, s.settled ? p.settled : p.control, command);
  return result;
}

/// The next tick's path, problem and factor. What the measurement will bring is the start alone.
void prepare(void* self, const PlanRequest& expected) {
  Ilqr& s = *static_cast<Ilqr*>(self);
  if (s.tree) return;
  PathPlan& p = s.plan;
  s.deadline = {};
  take_command(p, expected.last_command);
  p.task_step = expected.task_step;
  shift_path(p, expected.tick);
  s.standing = s.solved = false;
  if (!p.has_path || p.scenarios == 0) return;
  const FlushToZero flush;
  std::memcpy(p.start, p.state, std::size_t{p.scenarios} * p.nz * sizeof(double));
  stand(s);
  s.solved = solve(s) && p.exact;
}

void reset(void* self) {
  Ilqr& s = *static_cast<Ilqr*>(self);
  if constexpr (kConeTrees)
    if (s.cone_tree) return reset_sqp_tree(*s.cone_tree);
  if (s.tree) return reset_tree(*s.tree);
  reset_ilqr(s);
  if (s.escape) reset_escape(*s.escape);
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t*) {
  if (!wants_tree(config)) {
    Ilqr* const plain = lay_out_ilqr(arena, config, setup, table, config.planner.shooting == tiller_shooting_single);
    Escape* const escape = lay_out_escape(arena, config, setup, table);
    if (!plain || !escape) return nullptr;
    plain->escape = escape;
    return plain;
  }
  auto* s = arena.take<Ilqr>(1);
  SqpTree* cone_tree = nullptr;
  ScenarioTree* tree = nullptr;
  if (kConeTrees && config.safety.cone_count > 0) {
    if constexpr (kConeTrees) cone_tree = lay_out_sqp_tree(arena, config, setup, table);
    if (cone_tree) tree = cone_tree->tree;
  } else {
    tree = lay_out_tree(arena, config, setup, table);
  }
  if (!s || !tree) return nullptr;
  s->tree = tree;
  s->cone_tree = cone_tree;
  return s;
}

const float* sequence(const void* self) {
  const Ilqr& s = *static_cast<const Ilqr*>(self);
  return s.tree ? tree_sequence(*s.tree) : s.plan.sequence;
}

bool feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input) {
  const Ilqr& s = *static_cast<const Ilqr*>(self);
  return s.tree ? tree_feedback(*s.tree, step, gain, state, input) : path_feedback(s.plan, step, gain, state, input);
}

}  // namespace

bool take_request(Ilqr& s, const PlanRequest& request) {
  PathPlan& p = s.plan;
  s.settled = false;
  s.deadline = request.deadline;
  take_command(p, request.last_command);
  p.task_step = request.task_step;
  if (request.tick != p.last_tick) s.standing = s.solved = false;  // nothing was prepared for this tick
  shift_path(p, request.tick);
  if (take_goal(p, request)) s.standing = s.solved = false;
  if (take_origin(p, request.origin)) s.standing = s.solved = false;
  return take_belief(p, request.belief);
}

void reset_ilqr(Ilqr& s) {
  reset_path_plan(s.plan);
  s.cost = kInfinity;
  s.standing = s.solved = s.converged = s.settled = false;
}

Ilqr* lay_out_ilqr(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                   bool single, std::uint32_t most_scenarios) {
  auto* s = arena.take<Ilqr>(1);
  Ilqr nobody;
  Ilqr& place = s ? *s : nobody;
  lay_out_path_plan(arena, config, setup, table, place.plan, most_scenarios);
  lay_out_cone_program(arena, table, place.plan, place.cones);
  if (!s || !arena.fits()) return nullptr;
  s->single = single;
  reset_ilqr(*s);
  return s;
}

extern const PlannerTable ilqr_planner;
const PlannerTable ilqr_planner = {"ilqr", lay_out, plan, reset, sequence, prepare, feedback, true, false, true};

}  // namespace tiller
