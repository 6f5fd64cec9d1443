#include "planners/sqp_tree.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace tiller {
namespace {

constexpr double kRelaxed = 100.0;     // tolerances of the program: what a bound may be exceeded by unreported
constexpr double kLeastWeight = 1e-3;  // of a branch in the trunk, in shares of an equal weight

std::size_t margins_of_branch(const PathPlan& p) { return (std::size_t{p.horizon} + 1) * p.nx; }
double* margin_of(const SqpTree& s, std::size_t j) {
  return s.margin ? s.margin + j * margins_of_branch(s.tree->branch[0]) : nullptr;
}

// ---- the program --------------------------------------------------------------------------------

void weigh_branches(SqpTree& s) {
  const ScenarioTree& t = *s.tree;
  const double least = s.bounds.of_states ? kLeastWeight / t.count : 0.0;
  for (std::uint32_t j = 0; j < t.count; ++j) s.weight[j] = std::fmax(t.risk.weight()[j], least);
}

PartPath trunk_path(const SqpTree& s) {
  const ScenarioTree& t = *s.tree;
  const PathPlan& first = t.branch[0];
  PartPath path;
  for (std::uint32_t j = 0; j < t.count; ++j) {
    path.state[j] = t.branch[j].state;
    path.margin[j] = margin_of(s, j);
  }
  path.state_stride = first.nz;
  path.margin_stride = first.nx;
  path.control = first.control;
  path.before = first.last_input;
  return path;
}

PartPath branch_path(const SqpTree& s, std::uint32_t j) {
  const ScenarioTree& t = *s.tree;
  const PathPlan& p = t.branch[j];
  const std::size_t r = t.shared, last = (r - 1) * p.nu;
  const double* margin = margin_of(s, j);
  PartPath path;
  path.state[0] = p.state + r * p.nz;
  path.margin[0] = margin ? margin + r * p.nx : nullptr;
  path.state_stride = p.nz;
  path.margin_stride = p.nx;
  path.control = p.control + r * p.nu;
  path.before = p.control + last;
  path.change_before = s.part[0].plain.solution.u + last;
  return path;
}

PartPath path_of(const SqpTree& s, std::uint32_t part) { return part == 0 ? trunk_path(s) : branch_path(s, part - 1); }

/// The same bounds cost the same anywhere in the tree: a branch's own cost enters under its weight.
void take_bounds(SqpTree& s, bool lifted) {
  const ScenarioTree& t = *s.tree;
  double largest = 1.0;
  for (std::uint32_t j = 0; j < t.count; ++j) largest = std::fmax(largest, s.weight[j] * largest_gradient(t.branch[j]));
  const BoundPenalty penalty = exact_penalty(largest);
  s.exact_weight = penalty.linear;
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    const double share = i == 0 ? 1.0 : s.weight[i - 1];
    const BoundPenalty own = {penalty.linear / share, penalty.quadratic / share};
    SqpProgram& program = lifted ? s.part[i].lifted : s.part[i].plain;
    take_state_bounds(t.branch[0], s.bounds, path_of(s, i), own, program, lifted);
  }
}

/// The trunk and the branches as they stand around the paths; active sets go on from the plan before.
void take_plain(SqpTree& s) {
  ScenarioTree& t = *s.tree;
  const std::size_t n = t.branch[0].n, nu = t.branch[0].nu, r = t.shared, m = t.count;
  stack_trunk(t, s.weight);
  SqpPart& trunk = s.part[0];
  trunk.plain.qp.lq = t.trunk;
  trunk.set.factor = t.trunk_factor;
  trunk.set.kernel = t.lq;
  std::memset(trunk.plain.solution.x, 0, m * n * sizeof(double));
  std::memcpy(trunk.set.held, t.trunk_factor.held, r * nu);
  for (std::uint32_t j = 0; j < t.count; ++j) {
    SqpPart& part = s.part[1 + j];
    part.plain.qp.lq = problem_behind(t, j);
    part.plain.qp.start = trunk.plain.solution.x + (r * m + j) * n;
    part.set.factor = factor_behind(t, j);
    part.set.kernel = t.branch[j].lq;
    std::memcpy(part.set.held, part.set.factor.held, (t.branch[j].horizon - r) * nu);
    t.branch[j].cone_curvature = nullptr;
  }
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    s.part[i].plain.qp.cones = part_cones(t.branch[0], path_of(s, i), false);
    s.part[i].set.stands = false;
  }
  if (s.bounds.of_states) take_bounds(s, false);
}

/// Starts and ends of the lifted parts are in each other's arrays.
void build_lifted(SqpTree& s) {
  const ScenarioTree& t = *s.tree;
  const PathPlan& first = t.branch[0];
  const std::size_t large = first.nz + first.nu;
  double end_of_trunk[TILLER_MAX_INPUTS], last[TILLER_MAX_INPUTS];
  std::copy(first.last_input, first.last_input + first.nu, end_of_trunk);
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    const PartPath path = path_of(s, i);
    build_lifted(first, path, s.part[i]);
    std::copy(end_of_trunk, end_of_trunk + first.nu, last);
    start_lifted(first, path, i == 0 ? end_of_trunk : last, s.part[i]);
    if (i > 0)
      s.part[i].lifted.qp.start = s.part[0].lifted.solution.x + (std::size_t{t.shared} * t.count + i - 1) * large;
  }
  take_bounds(s, true);
}

QpTree tree_of(SqpTree& s, bool lifted) {
  ScenarioTree& t = *s.tree;
  QpTree tree;
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    SqpProgram& program = lifted ? s.part[i].lifted : s.part[i].plain;
    tree.part[i] = &program.qp;
    tree.solution[i] = &program.solution;
  }
  tree.branches = t.count;
  tree.weight = s.weight;
  const std::size_t n = tree.part[0]->lq.states, row = std::size_t{t.shared} * t.count * n;
  tree.end_hessian = (lifted ? s.part[0].lift.qxx : t.qxx) + row * n;
  tree.end_gradient = (lifted ? s.part[0].lift.qx : t.qx) + row;
  return tree;
}

// ---- its solution -------------------------------------------------------------------------------

bool within_bounds(const SqpTree& s) {
  const ScenarioTree& t = *s.tree;
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    const SqpPart& part = s.part[i];
    if (!states_within(part.plain.qp, part.plain.solution)) return false;
    if (!cones_within(part.plain.qp.cones, part.plain.qp.lq, part.plain.solution.u)) return false;
    if (s.bounds.of_rates && !changes_within(t.branch[0], path_of(s, i), part)) return false;
  }
  return true;
}

/// False where no solution came of it.
bool solve_whole(SqpTree& s, const QpLimits& limits) {
  ScenarioTree& t = *s.tree;
  const PathPlan& first = t.branch[0];
  const bool lifted = s.bounds.of_rates;
  if (lifted) build_lifted(s);
  const QpTree tree = tree_of(s, lifted);
  InteriorPoint* work[1 + TILLER_MAX_SCENARIOS] = {};
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    const LqProblem& q = tree.part[i]->lq;
    work[i] = &s.part[i].whole.interior;
    work[i]->kernel = &select_lq(*first.table, q.states, q.inputs, q.scenarios);
  }
  const QpReport report = solve_interior_point(work, tree, limits);
  s.unsolved = report.status != QpStatus::solved;
  if (report.status == QpStatus::broken || report.status == QpStatus::infeasible) return false;
  for (std::uint32_t i = 0; i <= t.count; ++i)
    if (!finite_inputs(lifted ? s.part[i].lifted : s.part[i].plain)) return false;
  for (std::uint32_t i = 0; i <= t.count; ++i) {
    const SqpProgram& program = lifted ? s.part[i].lifted : s.part[i].plain;
    if (s.bounds.of_states) s.violation = std::fmax(s.violation, largest_violation(first, program));
    if (lifted) take_lifted_solution(first, s.part[i]);
  }
  return true;
}

/// The part's plain problem with the curvature that its cones have in the solution. It is written where the branches'
/// paths have room for theirs; over the shared periods the first one's is the trunk's.
LqProblem with_cones(SqpTree& s, std::uint32_t i) {
  ScenarioTree& t = *s.tree;
  LqProblem q = s.part[i].plain.qp.lq;
  PathPlan& p = t.branch[i > 0 ? i - 1 : 0];
  if (p.cones.count == 0) return q;
  const std::size_t block = std::size_t{p.nu} * p.nu;
  const double* curvature = s.part[i].whole.interior.cone_curvature;
  double* quu = p.cone_quu + (i > 0 ? t.shared * block : 0);
  for (std::size_t at = 0; at < q.horizon * block; ++at) quu[at] = q.quu[at] + curvature[at];
  if (i > 0) p.cone_curvature = curvature;
  q.quu = quu;
  return q;
}

/// Gains around the solution: one sweep of the tree with the inputs at their bounds held, and the cones' curvature.
bool factorise_held(SqpTree& s) {
  ScenarioTree& t = *s.tree;
  const QpTree tree = tree_of(s, false);
  bool good = true;
  for (std::uint32_t i = t.count + 1; i-- > 0;) {
    const SqpPart& part = s.part[i];
    const LqProblem q = with_cones(s, i);
    for (std::size_t at = 0; at < std::size_t{q.horizon} * q.inputs; ++at)
      part.set.factor.held[at] = bound_of(part.plain, at);
    good = good && part.set.kernel->factorise(q, part.set.factor);
    if (i > 0) end_trunk(tree, i - 1, part.set.factor.value, part.set.factor.slope);
  }
  return good;
}

/// Steps of a branch that end at its solution, whatever its gains are.
void step_to_solution(const SqpPart& part, std::size_t n, bool has_gain) {
  const LqProblem& q = part.plain.qp.lq;
  for (std::size_t at = 0; at < std::size_t{q.horizon} * q.inputs; ++at) {
    double* gain = part.set.factor.gain + at * n;
    const double* x = part.plain.solution.x + at / q.inputs * n;
    double step = part.plain.solution.u[at];
    for (std::size_t c = 0; c < n; ++c) {
      if (!has_gain) gain[c] = 0.0;
      step -= gain[c] * x[c];
    }
    part.set.factor.step[at] = step;
  }
}

/// Rollouts add the trunk's steps in the shared periods and answer deviations behind them.
void write_trunk_steps(SqpTree& s) {
  ScenarioTree& t = *s.tree;
  for (std::uint32_t j = 0; j < t.count; ++j) {
    PathPlan& p = t.branch[j];
    const std::size_t rows = std::size_t{t.shared} * p.nu;
    std::memset(p.factor.gain, 0, rows * p.n * sizeof(double));
    std::memcpy(p.factor.step, s.part[0].plain.solution.u, rows * sizeof(double));
    p.has_gain = t.has_gain;
  }
}

bool solve(void* self, ScenarioTree& t, const Deadline& deadline) {
  SqpTree& s = *static_cast<SqpTree*>(self);
  const tiller_planner_config_t& settings = *t.branch[0].settings;
  QpLimits limits;
  limits.iterations = settings.qp_iterations;
  limits.tolerance = settings.qp_tolerance;
  limits.deadline = deadline;
  s.violation = 0.0;
  s.unsolved = false;
  for (std::uint32_t j = 0; s.margin && s.bounds.of_states && j < t.count; ++j)
    predict_branch_margins(t, j, s.bounds, s.room, margin_of(s, j));
  weigh_branches(s);
  take_plain(s);
  ActiveSetQp* set[1 + TILLER_MAX_SCENARIOS] = {};
  for (std::uint32_t i = 0; i <= t.count; ++i) set[i] = &s.part[i].set;
  const QpReport report = solve_active_set(set, tree_of(s, false), limits);
  t.has_gain = report.status != QpStatus::broken;
  if (!t.has_gain) {
    s.unsolved = true;
    for (std::uint32_t j = 0; j < t.count; ++j) drop_gains(t.branch[j]);
    return false;
  }
  if (!(report.status == QpStatus::solved && within_bounds(s))) {
    if (solve_whole(s, limits)) {
      t.has_gain = factorise_held(s);
      for (std::uint32_t j = 0; j < t.count; ++j) step_to_solution(s.part[1 + j], t.branch[j].n, t.has_gain);
    } else {
      s.unsolved = true;  // what the active set left is within the inputs' limits; the line search weighs it
    }
  }
  write_trunk_steps(s);
  return true;
}

double penalty(const void* self, const ScenarioTree& t, std::uint32_t j, std::uint32_t candidate) {
  const SqpTree& s = *static_cast<const SqpTree*>(self);
  return s.exact_weight * candidate_excess(t.branch[j], s.bounds, margin_of(s, j), candidate);
}

void move_frame(void* self, const ScenarioTree& t) {
  place_hard_bounds(t.branch[0], static_cast<SqpTree*>(self)->bounds);
}

void lay_out_parts(Arena& arena, const tiller_config_t& config, const RolloutTable& table, const PathPlan& sizes,
                   std::uint32_t most, SqpTree& s) {
  SqpPart nobody;
  const std::uint32_t shared = config.planner.shared_steps > 0 ? config.planner.shared_steps : 1;
  for (std::uint32_t i = 0; i <= most; ++i) {
    LqProblem plain = sizes.problem;
    plain.horizon = i == 0 ? shared : sizes.horizon - shared;
    plain.scenarios = i == 0 ? most : 1;
    SqpPart& part = s.part ? s.part[i] : nobody;
    lay_out_part(arena, sizes, s.bounds, plain, part);
    const LqProblem large = s.bounds.of_rates ? lifted_sizes(sizes, plain) : plain;
    const LqKernel& kernel = select_lq(table, large.states, large.inputs, large.scenarios);
    part.whole.interior = lay_out_interior_point(arena, large, kernel, part_cones(sizes, {}, s.bounds.of_rates));
  }
}

}  // namespace

SqpTree* lay_out_sqp_tree(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table) {
  Arena measure;
  PathPlan sizes;  // of a branch
  lay_out_path_plan(measure, config, setup, table, sizes, 1);
  const std::uint32_t particles = config.planner.particles;
  const std::uint32_t most = particles < TILLER_MAX_SCENARIOS ? particles : TILLER_MAX_SCENARIOS;
  auto* placed = arena.take<SqpTree>(1);
  SqpTree nobody;
  SqpTree& s = placed ? *placed : nobody;
  s.tree = lay_out_tree(arena, config, setup, table);
  lay_out_hard_bounds(config, sizes, s.bounds);
  if (wants_margins(config)) {
    s.margin = arena.take<double>(most * margins_of_branch(sizes));
    lay_out_spread_room(arena, config, setup, sizes, s.room);
  }
  s.part = arena.take<SqpPart>(std::size_t{most} + 1);
  lay_out_parts(arena, config, table, sizes, most, s);
  if (!placed || !arena.fits()) return nullptr;
  s.tree->solver = {placed, solve, penalty, move_frame};
  reset_sqp_tree(s);
  return placed;
}

void reset_sqp_tree(SqpTree& s) {
  reset_tree(*s.tree);
  s.exact_weight = s.violation = 0.0;
  s.unsolved = false;
  const std::size_t margins = s.margin ? s.tree->most * margins_of_branch(s.tree->branch[0]) : 0;
  for (std::size_t i = 0; i < margins; ++i) s.margin[i] = 0.0;
}

PlanResult plan_sqp_tree(SqpTree& s, const PlanRequest& request, double* command) {
  PlanResult result = plan_tree(*s.tree, request, command);
  if (result.status != tiller_status_ok || result.iterations == 0) return result;
  const double tolerance = s.tree->branch[0].settings->qp_tolerance;
  if (s.violation > kRelaxed * tolerance) result.status = tiller_status_bounds_relaxed;
  if (s.unsolved) result.status = tiller_status_program_unsolved;
  return result;
}

}  // namespace tiller
