// Sampling finds the valley, the gradient its floor: the first iteration of a plan is one of MPPI, the others are
// iterations of iLQR (single shooting) from whichever costs less, what sampling settled on or the shifted old plan. The
// sampler keeps a mean of its own: drawn to the refined plan, it would search the valley that is known already.

#include <cmath>
#include <limits>

#include "planners/flush_to_zero.hpp"
#include "planners/ilqr.hpp"
#include "planners/sampler.hpp"

namespace tiller {

extern const PlannerTable mppi_planner;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Hybrid {
  Sampler* sampler = nullptr;
  Ilqr* gradient = nullptr;
  double* other = nullptr;  // (N x nu) inputs that were not taken
};

/// The path becomes the cheaper of the shifted old plan and the sampled sequence; false where neither is finite.
bool choose_start(Hybrid& h) {
  Ilqr& s = *h.gradient;
  PathPlan& p = s.plan;
  const std::size_t count = std::size_t{p.horizon} * p.nu;
  s.cost = kInfinity;
  s.standing = s.solved = s.converged = false;
  const bool old_is_finite = roll_open(s);
  const double old_cost = s.cost;
  const float* sampled = mppi_planner.sequence(h.sampler);
  for (std::size_t i = 0; i < count; ++i) {
    h.other[i] = p.control[i];
    p.control[i] = static_cast<double>(sampled[i]);
  }
  s.cost = kInfinity;
  if (roll_open(s) && s.cost < old_cost) return true;
  for (std::size_t i = 0; i < count; ++i) p.control[i] = h.other[i];
  return old_is_finite && roll_open(s);
}

/// Iterations within `request`'s cap; the number completed.
std::uint32_t iterate(Hybrid& h, const PlanRequest& request, PlanResult& result) {
  PlanRequest first = request;
  first.deadline.iterations = 1;
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
  const std::uint32_t cap = request.deadline.iterations < most ? request.deadline.iterations : most;
  std::uint32_t done = 1;
  for (; done < cap && !s.converged; ++done) {
    if (request.deadline.passed()) {
      result.status = tiller_status_iteration_capped;
      break;
    }
    if (!iterate_single(s)) s.converged = true;
  }
  if (!s.converged && done < most && done < s.plan.settings->iterations) result.status = tiller_status_iteration_capped;
  return done;
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  Hybrid& h = *static_cast<Hybrid*>(self);
  PlanResult result;
  result.cost = kInfinity;
  if (!take_request(*h.gradient, request))
    result.status = tiller_status_plan_not_finite;
  else if (request.deadline.iterations > 0)
    result.iterations = iterate(h, request, result);
  if (result.iterations > 0) result.cost = h.gradient->cost;
  h.gradient->standing = h.gradient->solved = false;
  write_sequence(h.gradient->plan, h.gradient->plan.control, command);
  return result;
}

void reset(void* self) {
  Hybrid& h = *static_cast<Hybrid*>(self);
  mppi_planner.reset(h.sampler);
  reset_ilqr(*h.gradient);
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  auto* h = arena.take<Hybrid>(1);
  double* other = arena.take<double>(std::size_t{config.planner.horizon} * config.model->input_count);
  void* sampler = mppi_planner.lay_out(arena, config, setup, table, hooks);
  Ilqr* gradient = lay_out_ilqr(arena, config, setup, table, true);
  if (!h || !arena.fits()) return nullptr;
  *h = {static_cast<Sampler*>(sampler), gradient, other};
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
