// ./dev bench learned step: what a network costs in a rollout, in single precision on one core: cart-pole, RK4, one
// substep, 256 lanes over 50 periods.

#include <vector>

#include "bench/table/bench_table.hpp"
#include "networks/network_check.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;

constexpr std::uint32_t kLanes = 256, kHorizon = 50;

struct Shape {
  const char* name;
  tiller_network_kind_t kind;
  std::uint32_t members, hidden[2];
};
constexpr Shape kShapes[] = {{"none", tiller_network_tanh, 0, {0, 0}},
                             {"tanh_2x16", tiller_network_tanh, 5, {16, 16}},
                             {"tanh_2x32", tiller_network_tanh, 5, {32, 32}},
                             {"gaussian_48_64", tiller_network_gaussian, 8, {48, 64}}};

/// A batch whose lanes of one register share a member, as a planner's do, or take the members in turn.
struct Work {
  tiller::Config config;
  tiller_network_t network = {};
  std::vector<float> weights, state, params, controls, cost;
  StepSetup setup;
  CostTerms<float> terms{};
  RolloutJob<float> job;

  Work(const Shape& shape, bool mixed) {
    const tiller_model_t* model = tiller_find_model("cart_pole");
    (void)tiller_config_default(&config, model);
    for (std::uint32_t p = 0; p < model->param_count; ++p) config.priors[p] = {tiller_prior_uniform, 0, 0, 0, 0.5, 1.0};
    if (shape.members > 0) add_network(shape);
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    state.assign(model->state_count * kLanes, 0.1f);
    params.assign(config.param_count * kLanes, 0.7f);
    for (std::uint32_t l = 0; l < kLanes && shape.members > 0; ++l)
      params[(config.param_count - 1) * kLanes + l] =
          static_cast<float>((mixed ? l : l / kLanePadding) % shape.members) + 0.5f;
    controls.assign(kHorizon * kLanes, 0.5f);
    cost.resize(kLanes);
    terms.state[0] = 1.0f;
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = kHorizon;
    job.state = {state.data(), kLanes};
    job.params = {params.data(), kLanes};
    job.controls = {controls.data(), kLanes};
    job.cost = &terms;
    job.cost_out = cost.data();
  }
  void add_network(const Shape& shape) {
    network.size = sizeof network;
    network.version = TILLER_CONFIG_VERSION;
    network.kind = shape.kind;
    network.inputs = network_input_count(*config.model);
    network.outputs = config.model->joint_count;
    network.members = shape.members;
    network.hidden[0] = shape.hidden[0];
    network.hidden[1] = shape.hidden[1];
    weights.assign(network_weight_count(network), 0.01f);
    network.weights = weights.data();
    network.weight_count = static_cast<std::uint32_t>(weights.size());
    config.network = &network;
    const bool tanh = shape.kind == tiller_network_tanh;
    config.effects[config.effect_count++] = {
        static_cast<std::uint32_t>(tanh ? tiller_effect_network : tiller_effect_gaussian_process), 0};
    config.priors[config.param_count++] = {tiller_prior_uniform, 0, 0, 0, 0.0, static_cast<double>(shape.members)};
  }
  void run() const { select_rollout(*config.model).rollout_f32(*config.model, job); }
};

}  // namespace

int main(int argc, char** argv) {
  tiller::bench::Table table;
  for (const Shape& shape : kShapes)
    for (const bool mixed : {false, true}) {
      if (mixed && shape.members == 0) continue;
      table.add(std::string(shape.name) + (mixed ? "/mixed" : "/alike"), [shape, mixed](benchmark::State& state) {
        const Work work(shape, mixed);
        for (auto _ : state) work.run();
      });
    }
  table.run(argc, argv);
  table.heading(std::string("a step of a lane, f32, ") + tiller_instruction_set());
  const auto ns = [&](const std::string& name) { return table.seconds(name) / (kLanes * kHorizon) * 1e9; };
  table.row("cart-pole without a network", ns("none/alike"), "ns");
  table.row("with a network of 2 x 16, lanes of a register alike", ns("tanh_2x16/alike"), "ns",
            tiller::bench::at_most(8));
  table.row("the same, members mixed in a register", ns("tanh_2x16/mixed"), "ns");
  table.row("with a network of 2 x 32", ns("tanh_2x32/alike"), "ns");
  table.row("with a Gaussian process of 48 points and 64 waves", ns("gaussian_48_64/alike"), "ns");
  return table.finish();
}
