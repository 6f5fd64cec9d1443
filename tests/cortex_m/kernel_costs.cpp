// Cost of a model's step on a Cortex-M7, in instructions: a row for every built-in model of this build, integrator,
// with and without an effect. The rows stand in tools/doctor/instruction_costs.def, where `tiller size` reads them.

#include "board.hpp"
#include "kernel_calls.hpp"

namespace {

using namespace tiller;
using test::KernelCalls;

KernelCalls calls;

void number(std::uint64_t value) {
  board::print(", ");
  board::print_number(value);
}

/// Instructions of a step: of the second call, since the first computes what is kept.
void count(std::uint32_t steps, void (KernelCalls::*call)(const tiller_model_t&, const StepSetup&),
           const tiller_model_t& model, const StepSetup& setup) {
  (calls.*call)(model, setup);
  const std::uint32_t before = board::timer();
  (calls.*call)(model, setup);
  const std::uint32_t counts = before - board::timer();
  number((std::uint64_t{counts} * 40 / 128 + steps / 2) / steps);
}

void row(const tiller_model_t& model, const StepSetup& setup) {
  board::print("TILLER_STEP_COST(");
  board::print(model.name);
  number(model.state_count);
  number(setup.integrator);
  number(setup.effect_count);
  count(KernelCalls::kSteps, &KernelCalls::rollout_f32, model, setup);
  count(KernelCalls::kSteps, &KernelCalls::rollout_f64, model, setup);
  count(KernelCalls::kLanes, &KernelCalls::linearise, model, setup);
  count(KernelCalls::kSteps, &KernelCalls::residual, model, setup);
  count(KernelCalls::kHorizon, &KernelCalls::path_linearise, model, setup);
  count(KernelCalls::kHorizon * kCandidates, &KernelCalls::path_feedback, model, setup);
  board::print(")\n");
}

}  // namespace

int main() {
  board::start_timer();
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i)
    for (std::uint32_t effects = 0; effects < 2; ++effects)
      for (int integrator = 0; integrator < 3; ++integrator) {
        StepSetup setup;
        setup.integrator = static_cast<tiller_integrator_t>(integrator);
        if (effects > 0) test::add_one_effect(*model, setup);
        row(*model, setup);
      }
  return 0;
}
