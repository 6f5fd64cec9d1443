// Sampling finds the valley, the gradient its floor: the first iteration of a plan is one of MPPI, the others are
// iterations of iLQR from whichever costs less, what sampling settled on or the shifted old plan. The sampler keeps a
// mean of its own: drawn to the refined plan, it would search the valley that is known already.
//
// A scout beside it begins far from the plan and is refined as often, for one hypothesis alone (scout.hpp). Where its
// motion costs less on all of them, the plan goes on from it: the cheapest sample seldom lies in the best valley.
//
// A refinement from samples is one of multiple shooting, over as many plans as it takes to close the path's defects.
// Then single shooting goes on: to keep shooting multiple finds cheaper plans that hop between valleys, and costs more
// in closed loop (docs/evidence/planners.md).

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "planners/flush_to_zero.hpp"
#include "planners/line_search.hpp"
#include "planners/scout.hpp"

namespace tiller {

extern const PlannerTable mppi_planner;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kClosed = 1e-6;   // share of its cost that a motion may cost more than the path that it replaces
constexpr double kCheaper = 1e-3;  // share of its cost that the scout has to save: equal ones take no turns
constexpr double kOpenLoop[kCandidates] = {};

struct Hybrid {
  Sampler* sampler = nullptr;
  Ilqr* gradient = nullptr;
  Scout scout;
  double* other = nullptr;  // (N x nu) inputs of the motion that a refinement begins from
  double start_cost = 0.0;  // and their cost
  double path_merit = 0.0;  // of the last plan's path with its defects; infinity: it is a motion
};

std::size_t input_bytes(const PathPlan& p) { return std::size_t{p.horizon} * p.nu * sizeof(double); }

/// What the shifted old plan costs; its inputs, those of a motion, become h.other.
double weigh_old_plan(Hybrid& h) {
  Ilqr& s = *h.gradient;
  PathPlan& p = s.plan;
  s.cost = kInfinity;
  const bool kept = !s.single && p.has_path && p.has_gain;
  if (kept)
    settle_multiple(s);
  else
    roll_again(s);
  std::memcpy(h.other, kept && s.settled ? p.settled : p.control, input_bytes(p));
  return s.cost;
}

/// What the sampled sequence costs. Its inputs become h.other where they cost less than the old plan's, and its motion
/// the path where that costs less than `most`.
double weigh_samples(Hybrid& h, double old, double most) {
  PathPlan& p = h.gradient->plan;
  const float* sampled = mppi_planner.sequence(h.sampler);
  double* control = p.settled;  // free until the refinement's end
  std::memcpy(control, p.control, input_bytes(p));
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) p.control[i] = static_cast<double>(sampled[i]);
  roll_candidates(p, kOpenLoop, kOpenLoop);
  const double cost = candidate_risk(p, kWarm);
  if (cost < old)
    for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i)
      h.other[i] = p.candidate_control[i * kCandidates + kWarm];
  if (cost < most) {
    take_candidate(p, kWarm);
    p.has_gain = false;
  } else {
    std::memcpy(p.control, control, input_bytes(p));
  }
  return cost;
}

/// For several hypotheses a trial step of multiple shooting, which linearises, is dear.
bool refines_multiple(const PathPlan& p) {
  return p.scenarios == 1 && p.settings->shooting == tiller_shooting_multiple;
}

/// The path becomes the cheaper of the shifted old plan and the sampled sequence; false where neither is finite. A path
/// with defects is judged by its merit: what its inputs cost from the present start says little of where it leads.
bool choose_start(Hybrid& h) {
  Ilqr& s = *h.gradient;
  s.standing = s.solved = s.converged = false;
  s.shooting.penalty = 0.0;
  const bool cold = !s.plan.has_path;
  const bool open = !s.single && !cold;
  const double old = weigh_old_plan(h), worth = open ? std::fmin(old, h.path_merit) : old;
  const double sampled = weigh_samples(h, old, worth);
  if (cold || sampled < worth) s.single = !refines_multiple(s.plan);
  s.cost = h.start_cost = sampled < old ? sampled : old;
  return std::isfinite(s.cost);
}

/// What a path of multiple shooting sends: its motion, or the one that it began from, whichever costs less. The path
/// ends where its own motion is as cheap as it is, and where the motion that it began from is cheaper than the path
/// with its defects.
void settle(Hybrid& h) {
  Ilqr& s = *h.gradient;
  if (s.single) return;
  PathPlan& p = s.plan;
  const double path = s.standing ? p.risk.value(p.path_cost) : kInfinity;
  h.path_merit = path + s.shooting.penalty * path_defects(p);
  const std::uint32_t chosen = settle_multiple(s);
  if (s.settled && s.cost <= h.start_cost) {
    if (s.cost > path + kClosed * std::fabs(path)) return;
    take_candidate(p, chosen);
    s.single = true;
    s.settled = s.standing = false;
  } else if (h.path_merit < h.start_cost) {
    std::memcpy(p.settled, h.other, input_bytes(p));
    s.cost = h.start_cost;
    s.settled = true;
  } else {
    (void)restart_path(s, h.other);
  }
}

/// The scout's motion becomes the path where it costs less on all hypotheses. A path with defects that promises more is
/// left to close them first.
void weigh_scout(Hybrid& h) {
  Ilqr& s = *h.gradient;
  PathPlan& p = s.plan;
  const double worth = s.single ? s.cost : std::fmin(s.cost, h.path_merit);
  if (!(h.scout.gradient->cost < p.path_cost[0])) return;
  std::memcpy(h.scout.inputs, p.control, input_bytes(p));
  std::memcpy(p.control, h.scout.gradient->plan.control, input_bytes(p));
  roll_candidates(p, kOpenLoop, kOpenLoop);
  const double cost = candidate_risk(p, kWarm);
  if (!(cost < worth - kCheaper * std::fabs(worth))) {
    std::memcpy(p.control, h.scout.inputs, input_bytes(p));
    return;
  }
  take_candidate(p, kWarm);
  s.single = true;
  s.settled = s.standing = p.has_gain = false;
  s.cost = cost;
  h.scout.plans = 0;
}

/// Iterations within `request`'s cap, of the plan and then of the scout; the number completed, from which a replay
/// tells where the clock cut either.
std::uint32_t iterate(Hybrid& h, const PlanRequest& request, PlanResult& result) {
  PlanRequest first = request;
  first.deadline.iterations = std::min(request.deadline.iterations, std::uint32_t{1});
  double unused[TILLER_MAX_INPUTS];
  const PlanResult sampled = mppi_planner.plan(h.sampler, first, unused);
  result.status = sampled.status;
  if (sampled.iterations == 0) return 0;
  Ilqr& s = *h.gradient;
  const FlushToZero flush;
  if (!choose_start(h)) {
    result.status = tiller_status_plan_not_finite;
    return 0;
  }
  const std::uint32_t most = 1 + s.plan.settings->refine_iterations;
  const Deadline& deadline = request.deadline;
  const std::uint32_t wanted = deadline.replayed ? s.plan.settings->iterations : deadline.iterations;
  const std::uint32_t cap = std::min(wanted, most);
  const std::uint32_t budget = deadline.replayed ? deadline.iterations : 2 * cap;  // with the scout's
  std::uint32_t done = 1;
  for (; done < cap && done < budget && !s.converged; ++done) {
    if (deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    if (!(s.single ? iterate_single(s) : iterate_multiple(s))) s.converged = true;
  }
  settle(h);
  if (!s.converged && done < most && done < s.plan.settings->iterations) result.status = tiller_status_iteration_capped;
  if (cap < 2) return done;
  const std::uint32_t searched = search_on(h.scout, *h.sampler, s.plan, request, std::min(cap - 1, budget - done));
  if (h.scout.motion) weigh_scout(h);
  return done + searched;
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  Hybrid& h = *static_cast<Hybrid*>(self);
  PlanResult result;
  result.cost = kInfinity;
  if (!take_request(*h.gradient, request))
    result.status = tiller_status_plan_not_finite;
  else if (request.deadline.begins())
    result.iterations = iterate(h, request, result);
  if (result.iterations > 0) result.cost = h.gradient->cost;
  h.gradient->standing = h.gradient->solved = false;
  PathPlan& p = h.gradient->plan;
  write_sequence(p, h.gradient->settled ? p.settled : p.control, command);
  return result;
}

void reset(void* self) {
  Hybrid& h = *static_cast<Hybrid*>(self);
  mppi_planner.reset(h.sampler);
  reset_ilqr(*h.gradient);
  reset_scout(h.scout);
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  auto* h = arena.take<Hybrid>(1);
  double* other = arena.take<double>(std::size_t{config.planner.horizon} * config.model->input_count);
  void* sampler = mppi_planner.lay_out(arena, config, setup, table, hooks);
  Ilqr* gradient = lay_out_ilqr(arena, config, setup, table, config.planner.shooting == tiller_shooting_single);
  Scout scout;
  lay_out_scout(arena, config, setup, table, scout);
  if (!h || !arena.fits()) return nullptr;
  *h = {static_cast<Sampler*>(sampler), gradient, scout, other, 0.0, kInfinity};
  reset_scout(h->scout);
  return h;
}

const float* sequence(const void* self) { return static_cast<const Hybrid*>(self)->gradient->plan.sequence; }

bool feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input) {
  return path_feedback(static_cast<const Hybrid*>(self)->gradient->plan, step, gain, state, input);
}

}  // namespace

extern const PlannerTable hybrid_planner;
const PlannerTable hybrid_planner = {"hybrid", lay_out, plan, reset, sequence, nullptr, feedback, true, false, true};

}  // namespace tiller
