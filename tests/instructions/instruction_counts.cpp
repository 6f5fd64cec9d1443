// Instructions of fixed work, counted by callgrind: kernels of two models with and without effects, and ticks of every
// planner and posterior engine. Each piece runs once before it is counted. instructions_test.py runs this and compares.

#include <valgrind/callgrind.h>

#include <cstdio>
#include <string>

#include "kernel_calls.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using test::KernelCalls;

template <class F>
void count(const std::string& name, const F& work) {
  work();
  CALLGRIND_START_INSTRUMENTATION;
  CALLGRIND_ZERO_STATS;
  work();
  CALLGRIND_DUMP_STATS_AT(name.c_str());
  CALLGRIND_STOP_INSTRUMENTATION;
  std::printf("%s\n", name.c_str());
}

struct Kernel {
  const char* name;
  void (KernelCalls::*call)(const tiller_model_t&, const StepSetup&);
};
const Kernel kKernels[] = {
    {"rollout_f32", &KernelCalls::rollout_f32},       {"rollout_f64", &KernelCalls::rollout_f64},
    {"linearise", &KernelCalls::linearise},           {"residual", &KernelCalls::residual},
    {"path_linearise", &KernelCalls::path_linearise}, {"path_feedback", &KernelCalls::path_feedback}};

void count_kernels(const char* model_name) {
  static KernelCalls calls;
  const tiller_model_t& model = *tiller_find_model(model_name);
  const struct {
    const char* name;
    tiller_integrator_t integrator;
  } integrators[] = {{"semi-implicit", tiller_integrator_semi_implicit_euler}, {"rk4", tiller_integrator_rk4}};
  for (const auto& integrator : integrators)
    for (const bool friction : {false, true})
      for (const Kernel& kernel : kKernels) {
        StepSetup setup;
        setup.integrator = integrator.integrator;
        if (friction) test::add_one_effect(model, setup);
        count(std::string(model_name) + "/" + integrator.name + (friction ? "/friction/" : "/bare/") + kernel.name,
              [&] { (calls.*kernel.call)(model, setup); });
      }
}

/// Ten ticks after thirty: the posterior has its window, the planner its warm start.
void count_ticks(const std::string& name, const tiller_config_t& config, rig::Plant& plant) {
  rig::Loop loop(config, plant);
  if (!loop.ready()) {
    std::printf("%s: refused\n", name.c_str());
    return;
  }
  loop.activate();
  loop.run(20);
  count(name, [&] { loop.run(10); });
}

void count_planners() {
  const struct {
    const char* name;
    tiller_planner_kind_t kind;
  } planners[] = {{"mppi", tiller_planner_mppi},
                  {"cem", tiller_planner_cem},
                  {"random_shooting", tiller_planner_random_shooting},
                  {"mcts", tiller_planner_mcts},
                  {"ilqr", tiller_planner_ilqr},
                  {"sqp", tiller_planner_sqp},
                  {"hybrid", tiller_planner_hybrid}};
  for (const auto& planner : planners) {
    tiller::Config config = rig::cart_pole_config();
    config.planner.kind = planner.kind;
    config.posterior.enabled = 0;
    config.posterior.particles = 32;  // so that the state filters do not hide the planner
    rig::CartPolePlant plant;
    count_ticks(std::string("cart_pole/tick/") + planner.name, config, plant);
  }
}

/// The engine of transitions wants every state measured.
class BothMeasured : public rig::PendulumPlant {
 public:
  void measure(double* value) const override {
    value[0] = angle_rad;
    value[1] = rate_rad_s;
  }
};

void count_posteriors() {
  tiller::Config config = rig::pendulum_config();
  config.planner.rollouts = 32;  // the posterior's share is what counts here
  rig::PendulumPlant angle;
  count_ticks("pendulum/tick/filter", config, angle);
  config.posterior.kind = tiller_posterior_transition;
  config.posterior.particles = 256;
  config.measurement_count = 2;
  config.measured_state[1] = 1;
  config.measurement_sd[1] = 0.01;
  config.measurement_low[1] = -100.0;
  config.measurement_high[1] = 100.0;
  BothMeasured both;
  count_ticks("pendulum/tick/transition", config, both);
}

}  // namespace

int main() {
  count_kernels("pendulum");
  count_kernels("cart_pole");
  count_planners();
  count_posteriors();
  return 0;
}
