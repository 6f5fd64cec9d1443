#include "planners/scenario_tree.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "planners/belief_weights.hpp"
#include "planners/flush_to_zero.hpp"
#include "planners/line_search.hpp"
#include "planners/qp/qp.hpp"
#include "rollout/lq_held.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kSweeps = 6;  // of the active set, an iteration; the next one goes on from its set
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <class F>
void each_branch(ScenarioTree& t, F&& f) {
  for (std::uint32_t j = 0; j < t.count; ++j) f(t.branch[j], j);
}

// ---- the linear-quadratic problem ---------------------------------------------------------------

}  // namespace

LqProblem problem_behind(const ScenarioTree& t, std::uint32_t branch) {
  return stages_from(t.branch[branch].problem, t.shared);
}

LqFactor factor_behind(const ScenarioTree& t, std::uint32_t branch) {
  return stages_from(t.branch[branch].factor, t.branch[branch].problem, t.shared);
}

void stack_trunk(ScenarioTree& t, const double* weight) {
  const std::size_t m = t.count, n = t.branch[0].n, nu = t.branch[0].nu, s = m * n, r = t.shared;
  std::memset(t.quu, 0, r * nu * nu * sizeof(double));
  std::memset(t.qu, 0, r * nu * sizeof(double));
  each_branch(t, [&](PathPlan& p, std::size_t j) {
    const double w = weight[j];
    for (std::size_t k = 0; k < r; ++k) {
      std::memcpy(t.a + (k * m + j) * n * n, p.a + k * n * n, n * n * sizeof(double));
      std::memcpy(t.b + (k * m + j) * n * nu, p.b + k * n * nu, n * nu * sizeof(double));
      for (std::size_t i = 0; i < n * n; ++i) t.qxx[(k * m + j) * n * n + i] = w * p.qxx[k * n * n + i];
      for (std::size_t i = 0; i < n; ++i) t.qx[(k * m + j) * n + i] = w * p.qx[k * n + i];
      for (std::size_t i = 0; i < nu * nu; ++i) t.quu[k * nu * nu + i] += w * p.quu[k * nu * nu + i];
      for (std::size_t i = 0; i < nu; ++i) {
        t.qu[k * nu + i] += w * p.qu[k * nu + i];
        for (std::size_t c = 0; p.problem.qux && c < n; ++c)
          t.qux[(k * nu + i) * s + j * n + c] = w * p.problem.qux[(k * nu + i) * n + c];
      }
    }
  });
  t.trunk.scenarios = t.count;
  t.trunk.qux = t.branch[0].problem.qux ? t.qux : nullptr;
  t.trunk.regularisation = t.branch[0].problem.regularisation;
  t.trunk.low = t.branch[0].box_low;
  t.trunk.high = t.branch[0].box_high;
  t.trunk_factor.held = t.branch[0].factor.held;
  t.lq = &select_lq(*t.branch[0].table, t.branch[0].n, t.branch[0].nu, t.count);
}

void raise_regularisation(ScenarioTree& t) {
  double most = 0.0;
  each_branch(t, [&](PathPlan& p, std::size_t) {
    raise_regularisation(p);
    most = std::fmax(most, p.problem.regularisation);
  });
  each_branch(t, [&](PathPlan& p, std::size_t) { p.problem.regularisation = most; });
}

namespace {

/// Sweeps behind the shared periods; their costs to go end the trunk.
bool factorise(ScenarioTree& t) {
  const std::size_t m = t.count, n = t.branch[0].n, r = t.shared;
  bool good = true;
  each_branch(t, [&](PathPlan& p, std::uint32_t j) {
    good = good && p.lq->factorise(problem_behind(t, j), factor_behind(t, j));
    const double w = t.risk.weight()[j];
    for (std::size_t i = 0; i < n * n; ++i) t.qxx[(r * m + j) * n * n + i] = w * p.factor.value[r * n * n + i];
    for (std::size_t i = 0; i < n; ++i) t.qx[(r * m + j) * n + i] = w * p.factor.slope[r * n + i];
  });
  return good && t.lq->factorise(t.trunk, t.trunk_factor);
}

/// The solution, first along the trunk, then along each branch.
void roll_solution(ScenarioTree& t) {
  const std::size_t m = t.count, n = t.branch[0].n, r = t.shared;
  std::memset(t.x, 0, m * n * sizeof(double));
  t.lq->roll(t.trunk, t.trunk_factor, t.x, t.u);
  each_branch(t, [&](PathPlan& p, std::uint32_t j) {
    std::memcpy(p.dx + r * n, t.x + (r * m + j) * n, n * sizeof(double));
    p.lq->roll(problem_behind(t, j), factor_behind(t, j), p.dx + r * n, p.du + r * p.nu);
  });
}

std::uint32_t update_held(ScenarioTree& t) {
  const std::size_t n = t.branch[0].n, r = t.shared;
  std::uint32_t changes = update_lq_held(t.trunk, t.trunk_factor, t.x, t.u);
  each_branch(t, [&](PathPlan& p, std::uint32_t j) {
    changes += update_lq_held(problem_behind(t, j), factor_behind(t, j), p.dx + r * n, p.du + r * p.nu);
  });
  return changes;
}

/// Rollouts add the solution's steps in the shared periods and answer deviations behind them. Without a solution:
/// nothing.
void write_steps(ScenarioTree& t, bool solved) {
  each_branch(t, [&](PathPlan& p, std::size_t) {
    const std::size_t nu = p.nu, n = p.n, rows = (solved ? t.shared : p.horizon) * nu;
    std::memset(p.factor.gain, 0, rows * n * sizeof(double));
    if (solved)
      std::memcpy(p.factor.step, t.u, rows * sizeof(double));
    else
      std::memset(p.factor.step, 0, rows * sizeof(double));
  });
}

void stand(ScenarioTree& t) {
  if (t.standing) return;
  each_branch(t, [](PathPlan& p, std::size_t) {
    linearise_path(p);
    quadratise_path(p);
  });
  t.standing = true;
}

void lower(ScenarioTree& t) {
  each_branch(t, [](PathPlan& p, std::size_t) { lower_regularisation(p); });
}

bool solve_in_box(ScenarioTree& t) {
  stack_trunk(t, t.risk.weight());
  t.has_gain = false;
  for (std::uint32_t sweep = 0; sweep < kSweeps; ++sweep) {
    t.has_gain = factorise(t);
    if (!t.has_gain) break;
    roll_solution(t);
    if (update_held(t) == 0) break;
  }
  write_steps(t, t.has_gain);
  return t.has_gain;
}

bool solve(ScenarioTree& t, const Deadline& deadline) {
  each_branch(t, [](PathPlan& p, std::size_t) {
    clear_defects(p);
    (void)take_box(p);
  });
  const bool solved = t.solver.self ? t.solver.solve(t.solver.self, t, deadline) : solve_in_box(t);
  if (!solved) raise_regularisation(t);
  return solved;
}

// ---- the line search ----------------------------------------------------------------------------

double risk_of(const ScenarioTree& t, std::uint32_t candidate) {
  double cost[TILLER_MAX_SCENARIOS];
  for (std::uint32_t j = 0; j < t.count; ++j) cost[j] = t.branch[j].candidate_cost[candidate];
  return t.risk.value(cost);
}

double penalty_of(const ScenarioTree& t, std::uint32_t j, std::uint32_t candidate) {
  return t.solver.self ? t.solver.penalty(t.solver.self, t, j, candidate) : 0.0;
}

double merit_of(const ScenarioTree& t, std::uint32_t candidate) {
  double sum = risk_of(t, candidate);
  for (std::uint32_t j = 0; j < t.count; ++j) sum += penalty_of(t, j, candidate);
  return sum;
}

/// The branch's path becomes its inputs' motion; what it is charged, as if it were the only one.
double roll_branch(ScenarioTree& t, std::uint32_t j, std::uint32_t& chosen) {
  PathPlan& p = t.branch[j];
  chosen = kWarm;
  // in the shared periods nobody answers yet
  if (t.has_gain) std::memset(p.factor.gain, 0, std::size_t{t.shared} * p.nu * p.n * sizeof(double));
  const double cost = t.has_gain ? roll_warm(p, chosen) : roll_open(p);
  return cost + t.count * penalty_of(t, j, chosen);
}

/// Mean of the branches' inputs of row `at` under the risk's weights.
double mean_input(const ScenarioTree& t, std::size_t at) {
  double sum = 0.0;
  for (std::uint32_t j = 0; j < t.count; ++j) sum += t.risk.weight()[j] * t.branch[j].control[at];
  return sum;
}

/// Of its old inputs and the mean of all branches', each branch takes what costs its present hypothesis less.
/// Hypotheses are drawn anew every tick, and while much is learnt they are not those that the branches were planned
/// for. False where neither leads to a finite motion.
bool begin_paths(ScenarioTree& t) {
  PathPlan& first = t.branch[0];
  const std::size_t rows = std::size_t{first.horizon} * first.nu;
  for (std::size_t at = 0; at < rows; ++at) first.settled[at] = mean_input(t, at);
  bool finite = true;
  double cost[TILLER_MAX_SCENARIOS];
  each_branch(t, [&](PathPlan& p, std::uint32_t j) {
    std::uint32_t chosen = kWarm;
    double* const own = t.own;
    const double of_own = roll_branch(t, j, chosen);
    cost[j] = p.candidate_cost[chosen];
    std::memcpy(own, p.control, rows * sizeof(double));
    std::memcpy(p.control, first.settled, rows * sizeof(double));
    if (roll_branch(t, j, chosen) < of_own) {
      cost[j] = p.candidate_cost[chosen];
    } else {
      std::memcpy(p.control, own, rows * sizeof(double));
      (void)roll_open(p);
    }
    finite = finite && std::isfinite(cost[j]);
  });
  t.standing = false;
  if (finite) t.cost = t.risk.value(cost);
  return finite;
}

std::uint32_t cheapest(const ScenarioTree& t, double& merit) {
  std::uint32_t best = 0;
  merit = kInfinity;
  for (std::uint32_t i = 0; i < kCandidates; ++i) {
    const double m = merit_of(t, i);
    if (!(m < merit)) continue;
    merit = m;
    best = i;
  }
  return best;
}

/// The proximal step of the risk's weights on the full step's costs; true where they moved.
bool weigh(ScenarioTree& t) {
  double full[TILLER_MAX_SCENARIOS];
  each_branch(t, [&](PathPlan& p, std::size_t j) { full[j] = p.candidate_cost[0]; });
  return t.risk.update(full) > kWeightsStand;
}

void iterate(ScenarioTree& t, const Deadline& deadline) {
  stand(t);
  if (!solve(t, deadline)) {
    t.converged = t.branch[0].problem.regularisation > kMostRaised;
    return;
  }
  each_branch(t, [](PathPlan& p, std::size_t) { roll_candidates(p, kStepAlpha, kStepBeta); });
  double merit = kInfinity;
  const std::uint32_t best = cheapest(t, merit);
  const double before = merit_of(t, kWarm);
  const bool moved = weigh(t);
  if (!(merit < before)) {
    const bool flat = merit_of(t, 0) <= before + kFlat * std::fabs(before);
    if (!moved && !flat) raise_regularisation(t);
    t.converged = (!moved && flat) || t.branch[0].problem.regularisation > kMostRaised;
    return;
  }
  t.converged = !moved && before - merit <= kConverged * std::fabs(merit);
  each_branch(t, [&](PathPlan& p, std::size_t) { take_candidate(p, best); });
  t.cost = risk_of(t, best);
  t.standing = false;
  if (best < 2)
    lower(t);
  else if (best > 3)
    raise_regularisation(t);
}

// ---- a plan -------------------------------------------------------------------------------------

/// The shared periods of a shifted plan take in one in which the branches differed.
void share_first_periods(ScenarioTree& t) {
  for (std::size_t at = 0; at < std::size_t{t.shared} * t.branch[0].nu; ++at) {
    const double u = mean_input(t, at);
    each_branch(t, [&](PathPlan& p, std::size_t) { p.control[at] = u; });
  }
}

/// Branches for another number of hypotheses begin with the mean of those that were.
void recount(ScenarioTree& t, std::uint32_t count) {
  const PathPlan& first = t.branch[0];
  for (std::size_t at = 0; at < std::size_t{first.horizon} * first.nu; ++at) {
    const double u = t.count > 0 ? mean_input(t, at) : first.control[at];
    for (std::uint32_t j = 0; j < t.most; ++j) t.branch[j].control[at] = u;
  }
  for (std::uint32_t j = 0; j < t.most; ++j) t.branch[j].has_path = false;
  t.count = count;
  t.has_gain = false;
  t.risk.begin(count);
}

/// False without a belief.
bool take_request(ScenarioTree& t, const PlanRequest& request) {
  for (std::uint32_t j = 0; j < t.most; ++j) {
    take_command(t.branch[j], request.last_command);
    t.branch[j].task_step = request.task_step;
    shift_path(t.branch[j], request.tick);
  }
  const Belief* belief = request.belief;
  if (!belief || belief->count == 0) return false;
  const std::uint32_t count = hypotheses_within(*belief, t.most);
  if (count != t.count) recount(t, count);
  double likelihood[TILLER_MAX_SCENARIOS];
  fill_relative_weights(*belief, count, likelihood);
  (void)t.risk.take_likelihoods(likelihood);
  bool moved = false;
  each_branch(t, [&](PathPlan& p, std::uint32_t j) {
    (void)take_goal(p, request);
    moved = take_origin(p, request.origin) || moved;
    const Belief one = one_hypothesis(p, *belief, j, t.hypothesis);
    (void)take_belief(p, &one);
  });
  if (moved && t.solver.self) t.solver.move_frame(t.solver.self, t);
  share_first_periods(t);
  return true;
}

void iterate(ScenarioTree& t, const Deadline& deadline, PlanResult& result) {
  const FlushToZero flush;
  t.converged = false;
  if (!begin_paths(t)) {
    result.status = tiller_status_plan_not_finite;
    return;
  }
  while (result.iterations < deadline.iterations && !t.converged) {
    if (deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    iterate(t, deadline);
    ++result.iterations;
  }
  if (!t.converged && result.iterations < t.branch[0].settings->iterations)
    result.status = tiller_status_iteration_capped;
  if (result.iterations > 0) result.cost = t.cost;
}

}  // namespace

bool wants_tree(const tiller_config_t& config) {
  const tiller_planner_config_t& p = config.planner;
  return p.closed_loop != 0 && p.particles > 1 && p.shared_steps < p.horizon;
}

ScenarioTree* lay_out_tree(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                           const RolloutTable& table) {
  const std::uint32_t particles = config.planner.particles;
  auto* placed = arena.take<ScenarioTree>(1);
  ScenarioTree nobody;
  ScenarioTree& t = placed ? *placed : nobody;
  t.most = particles < TILLER_MAX_SCENARIOS ? particles : TILLER_MAX_SCENARIOS;
  t.shared = config.planner.shared_steps > 0 ? config.planner.shared_steps : 1;
  t.branch = arena.take<PathPlan>(t.most);
  PathPlan sizes;
  for (std::uint32_t j = 0; j < t.most; ++j)
    lay_out_path_plan(arena, config, setup, table, placed ? t.branch[j] : sizes, 1);
  const PathPlan& p = placed ? t.branch[0] : sizes;
  const std::size_t r = t.shared, n = p.n, s = t.most * n, nu = p.nu;
  const auto take = [&](double*& array, std::size_t count) { array = arena.take<double>(count); };
  take(t.a, r * s * n);
  take(t.b, r * s * nu);
  take(t.qxx, (r + 1) * s * n);
  take(t.qux, r * nu * s);
  take(t.quu, r * nu * nu);
  take(t.qx, (r + 1) * s);
  take(t.qu, r * nu);
  take(t.x, (r + 1) * s);
  take(t.u, r * nu);
  take(t.own, std::size_t{p.horizon} * nu);
  t.hypothesis = arena.take<float>(p.np + p.nx + p.ns);
  t.trunk.states = p.n;
  t.trunk.inputs = p.nu;
  t.trunk.horizon = t.shared;
  t.trunk.scenarios = t.most;
  t.trunk_factor = lay_out_lq_factor(arena, t.trunk, false);
  if (!placed || !arena.fits()) return nullptr;
  t.trunk.a = t.a;
  t.trunk.b = t.b;
  t.trunk.qxx = t.qxx;
  t.trunk.quu = t.quu;
  t.trunk.qx = t.qx;
  t.trunk.qu = t.qu;
  t.risk.lay_out(config.planner);
  reset_tree(t);
  return placed;
}

void reset_tree(ScenarioTree& t) {
  for (std::uint32_t j = 0; j < t.most; ++j) reset_path_plan(t.branch[j]);
  t.count = 0;
  t.standing = t.converged = t.has_gain = false;
}

PlanResult plan_tree(ScenarioTree& t, const PlanRequest& request, double* command) {
  PathPlan& first = t.branch[0];
  PlanResult result;
  result.cost = kInfinity;
  if (!take_request(t, request))
    result.status = tiller_status_plan_not_finite;
  else if (request.deadline.begins())
    iterate(t, request.deadline, result);
  for (std::size_t at = 0; at < std::size_t{first.horizon} * first.nu; ++at)
    first.settled[at] = t.count > 0 ? mean_input(t, at) : first.control[at];
  write_sequence(first, first.settled, command);
  return result;
}

const float* tree_sequence(const ScenarioTree& t) { return t.branch[0].sequence; }

bool tree_feedback(const ScenarioTree& t, std::uint32_t step, double* gain, double* state, double* input) {
  const PathPlan& first = t.branch[0];
  if (step >= first.horizon || !t.has_gain || t.count == 0 || !first.has_path) return false;
  const std::size_t m = t.count, n = first.n, nx = first.nx, nu = first.nu;
  const bool shared = step < t.shared;
  if (gain) std::memset(gain, 0, nu * nx * sizeof(double));
  if (state) std::memset(state, 0, nx * sizeof(double));
  for (std::size_t j = 0; j < m; ++j) {
    const PathPlan& p = t.branch[j];
    const double w = t.risk.weight()[j];
    for (std::size_t i = 0; gain && i < nu; ++i)
      for (std::size_t c = 0; c < nx; ++c)
        gain[i * nx + c] += shared ? t.trunk_factor.gain[((step * nu + i) * m + j) * n + c]
                                   : w * p.factor.gain[(step * nu + i) * n + c];
    for (std::size_t c = 0; state && c < nx; ++c) state[c] += w * p.state[step * p.nz + c];
  }
  for (std::size_t i = 0; input && i < nu; ++i) input[i] = mean_input(t, step * nu + i);
  return true;
}

}  // namespace tiller
