// ./dev bench planners: what a plan of each sampling planner costs, and where the time goes.
//
// Goals: MPPI with K=1536, N=50 and fresh noise in 90 us (AVX-512) and 140 us (AVX2); CVaR over 32 particles, K=1024,
// N=30, in 1.5 ms. One thread.

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/problems/planning_problem.hpp"
#include "bench/table/bench_table.hpp"
#include "planners/sampler.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;

/// The cart-pole with a rate limit, swinging, with a plan in progress.
tiller::Config planner_config(std::uint32_t planner, std::uint32_t rollouts, std::uint32_t horizon,
                              std::uint32_t particles) {
  tiller::Config c = bench::cart_pole_config(planner, horizon);
  const double swinging[4] = {0.0, 3.0, 0.1, 0.5};
  std::copy(swinging, swinging + 4, c.initial_state);
  c.planner.rollouts = rollouts;
  c.planner.particles = particles;
  c.safety.input_rate_per_s[0] = 400.0;
  return c;
}

constexpr double kSpread = 0.1;  // of the hypotheses' parameters

void plan(bench::Planning& p) {
  p.plan();
  if (p.result.status != tiller_status_ok) std::abort();
}

std::vector<Isa> isas() {
  std::vector<Isa> all;
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) all.push_back(static_cast<Isa>(i));
  return all;
}

struct Case {
  std::string name;
  tiller::Config config;
  double avx512_us, avx2_us;  // goals; 0: none
};

std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"mppi K=1536 N=50 M=1", planner_config(tiller_planner_mppi, 1536, 50, 1), 90, 140});
  all.push_back({"cem K=1536 N=50 M=1", planner_config(tiller_planner_cem, 1536, 50, 1), 0, 0});
  all.push_back({"random_shooting K=1536 N=50 M=1", planner_config(tiller_planner_random_shooting, 1536, 50, 1), 0, 0});
  all.push_back({"mppi K=512 N=50 M=1", planner_config(tiller_planner_mppi, 512, 50, 1), 0, 0});
  all.push_back({"mppi K=512 N=50 M=8", planner_config(tiller_planner_mppi, 512, 50, 8), 0, 0});
  all.push_back({"cem K=512 N=50 M=8", planner_config(tiller_planner_cem, 512, 50, 8), 0, 0});
  Case risky = {"mppi CVaR.9 K=1024 N=30 M=32", planner_config(tiller_planner_mppi, 1024, 30, 32), 1500, 0};
  risky.config.planner.risk = tiller_risk_cvar;
  risky.config.planner.cvar_alpha = 0.9;
  all.push_back(risky);
  return all;
}

/// The parts of one iteration, each over all K rollouts; their sum is the plan, but for the Philox keys, lambda's
/// further passes and the final evaluation of the mean.
void add_parts(bench::Table& table, const std::shared_ptr<bench::Planning>& p) {
  plan(*p);
  const Sampler& s = *static_cast<const Sampler*>(p->self);
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
      auto planning = std::make_shared<bench::Planning>(c.config, kSpread, isa);
      table.add(c.name + "/" + isa_name(isa), [planning](benchmark::State& state) {
        for (auto _ : state) plan(*planning);
      });
    }
  auto parts = std::make_shared<bench::Planning>(all[0].config, kSpread);
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
