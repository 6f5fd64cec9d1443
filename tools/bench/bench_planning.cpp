// ./dev bench planning: what a plan of each sampling planner costs, and where the time goes.
//
// Goals: MPPI with K=1536, N=50 and fresh noise in 90 us (AVX-512) and 140 us (AVX2); CVaR over 32 particles, K=1024,
// N=30, in 1.5 ms. One thread.

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench_table.hpp"
#include "planners/planner.hpp"
#include "planners/sampler.hpp"

namespace {

using namespace tiller;

/// The cart-pole of the benchmarks, hanging, with a plan in progress.
tiller_config_t cart_pole_config(std::uint32_t planner, std::uint32_t rollouts, std::uint32_t horizon,
                                 std::uint32_t particles) {
  tiller_config_t c{};
  c.model = tiller_find_model("cart_pole");
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = 3;
  const double weight[4] = {0.1, 1.0, 0.01, 0.01}, terminal[4] = {100, 100, 10, 10};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = weight[i];
    c.cost.terminal_weight[i] = terminal[i];
  }
  c.cost.input_weight[0] = 0.001;
  c.planner.kind = planner;
  c.planner.horizon = horizon;
  c.planner.knots = 6;
  c.planner.rollouts = rollouts;
  c.planner.particles = particles;
  c.planner.iterations = 1;
  c.planner.noise_sd[0] = 8.0;
  c.planner.temperature = 0.02;
  c.planner.elite_fraction = 0.05;
  c.planner.smoothing = 0.1;
  c.safety.input_low[0] = -20.0;
  c.safety.input_high[0] = 20.0;
  c.safety.input_rate_per_s[0] = 400.0;
  return c;
}

/// A planner in a block of its own, and +-10 % of the pole's mass and length as its belief.
struct Planning {
  tiller_config_t config;
  StepSetup setup;
  const PlannerTable* planner;
  std::vector<unsigned char> block;
  void* self = nullptr;
  std::vector<float> params, state;
  Belief belief;
  PlanRequest request;
  double command[TILLER_MAX_INPUTS] = {};

  Planning(const tiller_config_t& c, Isa isa) : config(c), planner(find_planner(c.planner.kind)) {
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    const RolloutTable& table = select_rollout(*config.model, isa);
    Arena measure;
    planner->lay_out(measure, config, setup, table, nullptr);
    block.resize(measure.used() + Arena::kAlignment);
    void* base = block.data();
    std::size_t space = block.size();
    std::align(Arena::kAlignment, measure.used(), base, space);
    Arena arena(base, measure.used());
    self = planner->lay_out(arena, config, setup, table, nullptr);
    const std::uint32_t m = config.planner.particles;
    for (const float nominal : {1.0f, 0.1f, 0.5f})
      for (std::uint32_t j = 0; j < m; ++j)
        params.push_back(nominal * (0.9f + 0.2f * (static_cast<float>(j) + 0.5f) / static_cast<float>(m)));
    for (const float x : {0.0f, 3.0f, 0.1f, 0.5f}) state.insert(state.end(), m, x);
    belief.count = m;
    belief.params = params.data();
    belief.state = state.data();
    request.belief = &belief;
    request.last_command = command;
    request.deadline.iterations = config.planner.iterations;
  }
  void plan() {
    ++request.tick;
    if (planner->plan(self, request, command).status != tiller_status_ok) std::abort();
  }
  const Sampler& sampler() const { return *static_cast<const Sampler*>(self); }
};

std::vector<Isa> isas() {
  std::vector<Isa> all;
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) all.push_back(static_cast<Isa>(i));
  return all;
}

struct Case {
  std::string name;
  tiller_config_t config;
  double avx512_us, avx2_us;  // goals; 0: none
};

std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"mppi K=1536 N=50 M=1", cart_pole_config(tiller_planner_mppi, 1536, 50, 1), 90, 140});
  all.push_back({"cem K=1536 N=50 M=1", cart_pole_config(tiller_planner_cem, 1536, 50, 1), 0, 0});
  all.push_back(
      {"random_shooting K=1536 N=50 M=1", cart_pole_config(tiller_planner_random_shooting, 1536, 50, 1), 0, 0});
  all.push_back({"mppi K=512 N=50 M=1", cart_pole_config(tiller_planner_mppi, 512, 50, 1), 0, 0});
  all.push_back({"mppi K=512 N=50 M=8", cart_pole_config(tiller_planner_mppi, 512, 50, 8), 0, 0});
  all.push_back({"cem K=512 N=50 M=8", cart_pole_config(tiller_planner_cem, 512, 50, 8), 0, 0});
  Case risky = {"mppi CVaR.9 K=1024 N=30 M=32", cart_pole_config(tiller_planner_mppi, 1024, 30, 32), 1500, 0};
  risky.config.planner.risk = tiller_risk_cvar;
  risky.config.planner.cvar_alpha = 0.9;
  all.push_back(risky);
  return all;
}

/// The parts of one iteration, each over all K rollouts; their sum is the plan, but for the Philox keys, lambda's
/// further passes and the final evaluation of the mean.
void add_parts(bench::Table& table, const std::shared_ptr<Planning>& p) {
  p->plan();
  const Sampler& s = p->sampler();
  table.add("part/noise", [p, &s](benchmark::State& state) {
    SampleJob job;
    job.rows = s.rows;
    job.lanes = job.stride = s.rollouts;
    job.keys = s.keys;
    job.mean = s.row_mean;
    job.sd = s.row_spread;
    job.scale = s.scale;
    job.low = s.row_low;
    job.high = s.row_high;
    job.knots = s.knots;
    for (auto _ : state) s.lanes->sample(job);
  });
  table.add("part/expand", [p, &s](benchmark::State& state) {
    ExpandJob job;
    job.grid = s.grid;
    job.lanes = s.chunk_lanes;
    job.stride = s.rollouts;
    job.start = s.start_lanes;
    job.rate_step = s.rate_step;
    job.controls = s.controls;
    for (auto _ : state)
      for (std::uint32_t chunk = 0; chunk < s.chunks; ++chunk) {
        job.knots = s.knots + chunk * s.chunk_lanes;
        s.lanes->expand(job);
      }
  });
  table.add("part/rollout", [p, &s](benchmark::State& state) {
    RolloutJob<float> job;
    job.setup = s.setup;
    job.horizon = s.grid.horizon;
    job.lanes = s.chunk_lanes;
    job.state = {s.particle_state, 0};
    job.params = {s.particle_params, 0};
    job.controls = {s.controls, s.chunk_lanes};
    job.previous_input = s.start_lanes;
    job.cost = &s.cost_terms;
    job.cost_out = s.particle_cost;
    for (auto _ : state)
      for (std::uint32_t chunk = 0; chunk < s.chunks; ++chunk) s.table->rollout_f32(*s.model, job);
  });
  table.add("part/weights", [p, &s](benchmark::State& state) {
    const float inverse = static_cast<float>(1.0 / s.lambda);
    for (auto _ : state) benchmark::DoNotOptimize(s.lanes->weigh(s.cost, s.rollouts, s.range.low, inverse, s.weight));
  });
  table.add("part/mean", [p, &s](benchmark::State& state) {
    for (auto _ : state)
      s.lanes->moments(s.knots, s.rows, s.rollouts, s.rollouts, s.weight, s.row_mean, s.row_sum, nullptr);
  });
}

}  // namespace

int main(int argc, char** argv) {
  bench::Table table;
  const std::vector<Case> all = cases();
  for (const Case& c : all)
    for (Isa isa : isas()) {
      auto planning = std::make_shared<Planning>(c.config, isa);
      table.add(c.name + "/" + isa_name(isa), [planning](benchmark::State& state) {
        for (auto _ : state) planning->plan();
      });
    }
  auto parts = std::make_shared<Planning>(all[0].config, best_isa());
  add_parts(table, parts);
  table.run(argc, argv);

  std::printf("cart-pole, 6 knots, 400 N/s, fresh noise, one iteration a plan, one thread\n");
  for (const Case& c : all) {
    table.heading(c.name);
    for (Isa isa : isas()) {
      const double t = table.seconds(c.name + "/" + isa_name(isa)) * 1e6;
      const double goal = isa == Isa::avx512 ? c.avx512_us : isa == Isa::avx2 ? c.avx2_us : 0.0;
      table.row(isa_name(isa), t, "us", goal > 0.0 ? bench::at_most(goal) : bench::Goal{});
    }
  }
  table.heading(all[0].name + " on " + isa_name(best_isa()) + ", its parts");
  for (const char* part : {"noise", "expand", "rollout", "weights", "mean"})
    table.row(part, table.seconds(std::string("part/") + part) * 1e6, "us");
  return table.finish();
}
