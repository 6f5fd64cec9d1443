#include "fakes.hpp"

namespace fakes {
Planner planner;
}  // namespace fakes

namespace tiller {
namespace {

struct Self {
  const tiller_config_t* config;
};

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup&, const RolloutTable&,
              const tiller_hooks_t*) {
  Self* self = arena.take<Self>(1);
  if (arena.measuring()) return nullptr;
  self->config = &config;
  return self;
}

PlanResult plan(void* pointer, const PlanRequest& request, double* command) {
  fakes::Planner& fake = fakes::planner;
  const tiller_config_t& config = *static_cast<Self*>(pointer)->config;
  ++fake.plans;
  fake.tick = request.tick;
  fake.task_step = request.task_step;
  fake.iterations_asked = request.deadline.iterations;
  fake.deadline_ns = request.deadline.deadline_ns;
  const std::size_t values = std::size_t{config.model->state_count} * request.belief->count;
  fake.belief_state.assign(request.belief->state, request.belief->state + values);
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) fake.last_command[i] = request.last_command[i];
  fake.steady = request.steady_state != nullptr;
  for (std::uint32_t i = 0; fake.steady && i < config.model->state_count; ++i)
    fake.steady_state[i] = request.steady_state[i];
  for (std::uint32_t i = 0; fake.steady && i < config.model->input_count; ++i)
    fake.steady_input[i] = request.steady_input[i];
  if (fake.before_answer) fake.before_answer();
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) command[i] = fake.command[i];
  fake.sequence.resize(std::size_t{config.planner.horizon} * config.model->input_count, 0.0f);
  return fake.result;
}

void reset(void*) { ++fakes::planner.resets; }
const float* sequence(const void*) { return fakes::planner.sequence.data(); }
void prepare(void*, const PlanRequest& expected) {
  ++fakes::planner.preparations;
  fakes::planner.expected_tick = expected.tick;
  fakes::planner.expected_task_step = expected.task_step;
}
bool feedback(const void*, std::uint32_t step, double*, double*, double*) { return step < 8; }
constexpr PlannerTable kFake = {"fake", lay_out, plan, reset, sequence, prepare, feedback};

}  // namespace

const PlannerTable* find_planner(std::uint32_t kind) { return kind < tiller_planner_kind_count ? &kFake : nullptr; }

}  // namespace tiller
