#include "planners/sampler.hpp"

namespace tiller {
namespace {

// The mean of the next iteration is the cheapest sample of this one. Rollout 0 is the mean unperturbed, so the cost
// never rises within a plan. With one iteration this is predictive sampling (Howell et al., 2022).

void begin(Sampler&) {}

void update(Sampler& s) {
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.best[r];
}

double choose(Sampler& s) { return s.best_cost; }

constexpr SamplingMethod kMethod = {"random_shooting", begin, update, choose};

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  return lay_out_sampler(arena, config, setup, table, hooks, kMethod);
}

}  // namespace

extern const PlannerTable random_shooting_planner;
const PlannerTable random_shooting_planner = {
    kMethod.name, lay_out, plan_by_sampling, reset_sampler, sampled_sequence, nullptr, sampled_feedback, false, true};

}  // namespace tiller
