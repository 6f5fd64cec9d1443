// What a model's step costs on a Cortex-M7, in instructions: a row for every built-in model of this build, integrator,
// with and without an effect. The rows stand in tools/instruction_costs.def, where `tiller size` reads them.

#include "board.hpp"
#include "effects/effect_info.hpp"
#include "rollout/path.hpp"
#include "rollout/residual.hpp"
#include "rollout/rollout.hpp"

namespace {

using namespace tiller;

constexpr std::uint32_t kLanes = kLanePadding, kHorizon = 8;
constexpr std::uint32_t kSteps = kLanes * kHorizon;

// every array at its largest
template <class T>
struct Arrays {
  T state[TILLER_MAX_STATES * kLanes], params[TILLER_MAX_PARAMS * kLanes], effects[TILLER_MAX_EFFECT_STATES * kLanes];
  T controls[kHorizon * TILLER_MAX_INPUTS * kLanes], cost[kLanes];
};
Arrays<float> f32;
Arrays<double> f64;
double next[TILLER_MAX_STATES * kLanes], a[TILLER_MAX_STATES * TILLER_MAX_STATES * kLanes],
    b[TILLER_MAX_STATES * TILLER_MAX_INPUTS * kLanes];
double path_state[(kHorizon + 1) * TILLER_MAX_STATES * kCandidates], path_a[kHorizon * 144], path_b[kHorizon * 48],
    path_control[kHorizon * TILLER_MAX_INPUTS * kCandidates], gain[kHorizon * 48], zero[kHorizon * TILLER_MAX_INPUTS],
    low[TILLER_MAX_INPUTS], high[TILLER_MAX_INPUTS], path_cost[kCandidates], alpha[kCandidates];
MeasuredStep measured[kHorizon];
double squared[TILLER_MAX_STATES * kLanes];
CostTerms<float> terms_f32;
CostTerms<double> terms_f64;

template <class T>
void fill(Arrays<T>& arrays) {
  for (T& x : arrays.state) x = T(0.1);
  for (T& p : arrays.params) p = T(1.0);
  for (T& u : arrays.controls) u = T(0.2);
}

template <class F>
std::uint64_t instructions_per(std::uint32_t steps, const F& work) {
  work();  // what is computed once
  const std::uint32_t before = board::timer();
  work();
  const std::uint32_t counts = before - board::timer();
  return (std::uint64_t{counts} * 40 / 128 + steps / 2) / steps;
}

template <class T>
RolloutJob<T> rollout_job(const StepSetup& setup, Arrays<T>& arrays, const CostTerms<T>& terms) {
  RolloutJob<T> job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.horizon = kHorizon;
  job.state = {arrays.state, 0};
  job.params = {arrays.params, 0};
  job.effect_state = {arrays.effects, 0};
  job.controls = {arrays.controls, kLanes};
  job.cost = &terms;
  job.cost_out = arrays.cost;
  return job;
}

std::uint64_t linearise(const tiller_model_t& model, const RolloutTable& table, const StepSetup& setup) {
  LineariseJob job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.state = {f64.state, kLanes};
  job.params = {f64.params, kLanes};
  job.effect_state = {f64.effects, kLanes};
  job.control = {f64.controls, 0};
  job.next_state = next;
  job.a = a;
  return instructions_per(kLanes, [&] { table.linearise(model, job); });
}

std::uint64_t residual(const tiller_model_t& model, const RolloutTable& table, const StepSetup& setup) {
  ResidualJob job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.count = kHorizon;
  job.steps = measured;
  job.params = {f32.params, kLanes};
  job.squared = squared;
  return instructions_per(kSteps, [&] { table.residual(model, job); });
}

std::uint64_t path_linearise(const tiller_model_t& model, const RolloutTable& table, const StepSetup& setup) {
  PathJob job;
  job.setup = &setup;
  job.horizon = kHorizon;
  job.state = path_state;
  job.control = zero;
  job.params = f64.params;
  job.param_count = TILLER_MAX_PARAMS;
  job.next = next;
  job.a = path_a;
  job.b = path_b;
  job.lq_states = model.state_count;
  return instructions_per(kHorizon, [&] { select_path(table).linearise(model, job); });
}

std::uint64_t path_feedback(const tiller_model_t& model, const RolloutTable& table, const StepSetup& setup) {
  FeedbackJob job;
  job.setup = &setup;
  job.horizon = kHorizon;
  job.start = f64.state;
  job.params = f64.params;
  job.param_count = TILLER_MAX_PARAMS;
  job.state = path_state;
  job.control = job.step = zero;
  job.gain = gain;
  job.lq_states = model.state_count;
  job.alpha = job.beta = alpha;
  job.low = low;
  job.high = high;
  job.most_change = high;
  job.previous_input = zero;
  job.cost = &terms_f64;
  job.cost_out = path_cost;
  static double states[(kHorizon + 1) * TILLER_MAX_STATES * kCandidates];
  job.state_out = states;
  job.control_out = path_control;
  return instructions_per(kHorizon * kCandidates, [&] { select_path(table).feedback(model, job); });
}

void number(std::uint64_t value) {
  board::print(", ");
  board::print_number(value);
}

void row(const tiller_model_t& model, const StepSetup& setup) {
  const RolloutTable& table = select_rollout(model);
  board::print("TILLER_STEP_COST(");
  board::print(model.name);
  number(model.state_count);
  number(setup.integrator);
  number(setup.effect_count);
  const auto job_f32 = rollout_job(setup, f32, terms_f32);
  number(instructions_per(kSteps, [&] { table.rollout_f32(model, job_f32); }));
  const auto job_f64 = rollout_job(setup, f64, terms_f64);
  number(instructions_per(kSteps, [&] { table.rollout_f64(model, job_f64); }));
  number(linearise(model, table, setup));
  number(residual(model, table, setup));
  number(path_linearise(model, table, setup));
  number(path_feedback(model, table, setup));
  board::print(")\n");
}

/// Dry friction at the first joint, or a gain at the first input where there is no joint that bears it.
void add_effect(const tiller_model_t& model, StepSetup& setup) {
  std::uint32_t kind = tiller_effect_coulomb_friction;
  if (!port_fits(effect_info(kind), 0, model)) kind = tiller_effect_actuator_gain;
  setup.effects[0] = {static_cast<std::uint16_t>(kind), 0, static_cast<std::uint16_t>(model.param_count), 0};
  setup.effect_count = 1;
}

}  // namespace

int main() {
  board::start_timer();
  fill(f32);
  fill(f64);
  for (double& h : high) h = 1.0;
  for (double& l : low) l = -1.0;
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i)
    for (std::uint32_t effects = 0; effects < 2; ++effects)
      for (int integrator = 0; integrator < 3; ++integrator) {
        StepSetup setup;
        setup.integrator = static_cast<tiller_integrator_t>(integrator);
        if (effects > 0) add_effect(*model, setup);
        row(*model, setup);
      }
  return 0;
}
