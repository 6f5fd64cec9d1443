// ./dev bench spread: predicted spreads against what then happens.
//
//   moments     mean and deviation of the state along a horizon, linearised, against 100,000 rollouts of the same model
//               that carry drawn start errors and process noise; and the expected saturating cost. Four models.
//   bands       closed loops under process noise, parameters off by up to 30 % and learnt: share of the true states
//               that fall into the 90 % band which was foreseen so many periods before. Goal: 87 to 93 %.
//   rail        a swing-up on a rail of +-0.8 m under process noise, parameters known, sqp: share of 300 runs that
//               leave the rail, with bounds held for the means, with a margin, and with chance constraints.
//
// Settings were chosen on seeds from 1001 on.
//
//   bench_spread [--only moments|bands|rail] [--seeds FIRST COUNT] [--threads N] [--set KEY VALUE]...

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <mutex>
#include <random>
#include <thread>

#include "bench/planning/uncertain_tasks.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "planners/predicted_spread.hpp"

namespace {

using namespace tiller;
using bench::Knowledge;
using bench::UncertainRun;
using bench::UncertainTask;

// ---- moments ------------------------------------------------------------------------------------

struct Motion {
  const char* model;
  std::vector<double> params, start, start_sd, process_sd, input_swing, input_level;
  std::uint32_t steps;
};

const std::vector<Motion> kMotions = {
    {"pendulum", {1.0, 0.5, 0.05}, {0.4, 0.0}, {0.01, 0.05}, {0.0, 0.3}, {1.0}, {0.0}, 50},
    {"cart_pole", {1.0, 0.1, 0.5}, {0.0, 0.2, 0.0, 0.0}, {0.01, 0.01, 0.02, 0.02}, {0, 0, 0.1, 0.2}, {4.0}, {0.0}, 40},
    {"planar_quadrotor",
     {0.5, 0.15, 0.005, 0.1},
     {-1.0, 0.5, 0.3, 0.5, 0.0, 0.0},
     {0.02, 0.02, 0.02, 0.05, 0.05, 0.05},
     {0, 0, 0, 0.1, 0.1, 0.3},
     {0.3, -0.3},
     {2.45, 2.45},
     40},
    {"two_link_arm", {}, {0.3, -0.8, 0.0, 0.0}, {0.01, 0.01, 0.03, 0.03}, {0, 0, 0.2, 0.2}, {0.5, 0.3}, {0, 0}, 50},
};

/// Deviations (N+1 x nx) and means, linearised or counted, and the saturating cost of the last state.
struct Moments {
  std::vector<double> mean, sd;
  double saturating = 0.0;
};

struct MotionSetup {
  const tiller_model_t* model;
  StepSetup setup;
  std::vector<double> params, controls, width;
  StateSpread spread;
  std::uint32_t nx, nu;
};

MotionSetup set_up(const Motion& motion) {
  MotionSetup s;
  s.model = tiller_find_model(motion.model);
  s.nx = s.model->state_count;
  s.nu = s.model->input_count;
  s.setup.period_s = 0.02;
  s.setup.integrator = tiller_integrator_rk4;
  s.params = motion.params;
  for (std::size_t i = s.params.size(); i < s.model->param_count; ++i) s.params.push_back(0.4);
  for (std::uint32_t k = 0; k < motion.steps; ++k)
    for (std::uint32_t i = 0; i < s.nu; ++i)
      s.controls.push_back(motion.input_level[i] + motion.input_swing[i] * std::sin(0.25 * k));
  s.spread.states = s.nx;
  for (std::uint32_t i = 0; i < s.nx; ++i) {
    s.spread.covariance[i * s.nx + i] = motion.start_sd[i] * motion.start_sd[i];
    s.spread.sensor_variance[i] = HUGE_VAL;
    s.width.push_back(0.3);
  }
  fill_process_covariance(*s.model, motion.process_sd.data(), s.setup.period_s, s.spread.process);
  return s;
}

Moments linearised(const Motion& motion, const MotionSetup& s) {
  const std::uint32_t nx = s.nx, lanes = kLanePadding;
  Moments m;
  std::vector<double> x(motion.start), a(nx * nx * lanes), b(nx * s.nu * lanes), next(nx * lanes);
  std::vector<double> error(nx * nx), estimate(nx * nx), work(spread_scratch_size(nx)), flat(nx * nx), input(nx * s.nu);
  begin_spread(s.spread, nx, error.data(), estimate.data());
  for (std::uint32_t k = 0; k <= motion.steps; ++k) {
    for (std::uint32_t i = 0; i < nx; ++i) {
      m.mean.push_back(x[i]);
      m.sd.push_back(std::sqrt(error[i * nx + i] + estimate[i * nx + i]));
    }
    if (k == motion.steps) break;
    LineariseJob job;
    job.setup = &s.setup;
    job.lanes = lanes;
    job.state = {x.data(), 0};
    job.params = {s.params.data(), 0};
    job.control = {s.controls.data() + k * s.nu, 0};
    job.next_state = next.data();
    job.a = a.data();
    job.b = b.data();
    select_rollout(*s.model).linearise(*s.model, job);
    for (std::uint32_t i = 0; i < nx * nx; ++i) flat[i] = a[i * lanes];
    for (std::uint32_t i = 0; i < nx * s.nu; ++i) input[i] = b[i * lanes];
    SpreadStage stage;
    stage.size = nx;
    stage.inputs = s.nu;
    stage.a = flat.data();
    stage.stride = nx;
    stage.b = input.data();
    step_spread(s.spread, stage, error.data(), estimate.data(), work.data());
    for (std::uint32_t i = 0; i < nx; ++i) x[i] = next[i * lanes];
  }
  std::vector<double> difference(nx);
  for (std::uint32_t i = 0; i < nx; ++i) {
    difference[i] = 0.5 * m.sd[motion.steps * nx + i];  // a target half a deviation beside the mean
    for (std::uint32_t j = 0; j < nx; ++j) flat[i * nx + j] = error[i * nx + j] + estimate[i * nx + j];
  }
  std::vector<double> width(nx);
  for (std::uint32_t i = 0; i < nx; ++i) width[i] = m.sd[motion.steps * nx + i];
  m.saturating = expected_saturating_cost(nx, difference.data(), flat.data(), width.data());
  return m;
}

Moments counted(const Motion& motion, const MotionSetup& s, const Moments& about, std::uint32_t rollouts) {
  constexpr std::uint32_t kLanes = 1024;
  const std::uint32_t nx = s.nx, rows = (motion.steps + 1) * nx;
  std::mt19937_64 engine(7);
  std::normal_distribution<double> normal;
  std::vector<double> state(nx * kLanes), noise(motion.steps * nx * kLanes), out(rows * kLanes), sum(rows),
      squares(rows);
  const double h = s.setup.period_s;
  double saturating = 0.0;
  std::uint32_t done = 0;
  for (; done < rollouts; done += kLanes) {
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      for (std::uint32_t i = 0; i < nx; ++i)
        state[i * kLanes + l] = motion.start[i] + motion.start_sd[i] * normal(engine);
      for (std::uint32_t k = 0; k < motion.steps; ++k) {
        for (std::uint32_t i = 0; i < nx; ++i) noise[(k * nx + i) * kLanes + l] = 0.0;
        for (std::uint32_t j = 0; j < s.model->joint_count; ++j) {
          const tiller_joint_t& joint = s.model->joints[j];
          const double sd = motion.process_sd[joint.velocity], a = normal(engine), b = normal(engine);
          noise[(k * nx + joint.velocity) * kLanes + l] += sd * std::sqrt(h) * a;
          noise[(k * nx + joint.position) * kLanes + l] += sd * h * std::sqrt(h) * (0.5 * a + b / std::sqrt(12.0));
        }
      }
    }
    RolloutJob<double> job;
    job.setup = &s.setup;
    job.lanes = kLanes;
    job.horizon = motion.steps;
    job.state = {state.data(), kLanes};
    job.params = {s.params.data(), 0};
    job.controls = {s.controls.data(), 0};
    job.noise = {noise.data(), kLanes};
    job.trajectory = out.data();
    select_rollout(*s.model).rollout_f64(*s.model, job);
    for (std::uint32_t r = 0; r < rows; ++r)
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        const double off = out[r * kLanes + l] - about.mean[r];
        sum[r] += off;
        squares[r] += off * off;
      }
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      double q = 0.0;
      for (std::uint32_t i = 0; i < nx; ++i) {
        const std::uint32_t r = motion.steps * nx + i;
        const double d = (out[r * kLanes + l] - about.mean[r]) / about.sd[r] + 0.5;
        q += d * d;
      }
      saturating += 1.0 - std::exp(-0.5 * q);
    }
  }
  Moments m;
  for (std::uint32_t r = 0; r < rows; ++r) {
    const double mean = sum[r] / done;
    m.mean.push_back(about.mean[r] + mean);
    m.sd.push_back(std::sqrt(squares[r] / done - mean * mean));
  }
  m.saturating = saturating / done;
  return m;
}

void report_moments(bench::Table& table) {
  table.heading("moments along a horizon of 0.8 to 1 s against 102,400 rollouts, the worst state and step");
  for (const Motion& motion : kMotions) {
    const MotionSetup s = set_up(motion);
    const Moments linear = linearised(motion, s), truth = counted(motion, s, linear, 100000);
    double worst_sd = 0.0, worst_mean = 0.0;
    for (std::size_t r = 0; r < linear.sd.size(); ++r) {
      worst_sd = std::max(worst_sd, std::abs(linear.sd[r] / truth.sd[r] - 1.0));
      worst_mean = std::max(worst_mean, std::abs(linear.mean[r] - truth.mean[r]) / truth.sd[r]);
    }
    const std::string name = motion.model;
    table.row(name + ": deviation off by", 100.0 * worst_sd, "%", bench::at_most(5.0));
    table.row(name + ": mean off by", worst_mean, "deviations", bench::at_most(0.1));
    table.row(name + ": expected saturating cost off by", 100.0 * std::abs(linear.saturating / truth.saturating - 1.0),
              "%", bench::at_most(2.0));
  }
}

// ---- bands --------------------------------------------------------------------------------------

constexpr std::uint32_t kAhead[] = {1, 5, 10, 20};
constexpr std::size_t kAheads = sizeof kAhead / sizeof kAhead[0];
constexpr double kBand = 1.6448536269514722;

struct Coverage {
  std::array<std::uint64_t, kAheads> inside{}, all{};
};

Coverage run_bands(const UncertainTask& task, std::uint64_t seed) {
  Coverage coverage;
  const std::uint32_t nx = task.config.model->state_count;
  struct Seen {
    bool made = false;
    std::vector<double> mean, sd;
  };
  std::vector<std::array<Seen, kAheads>> seen(task.ticks + 64);
  (void)run_uncertain(task, Knowledge::closed_expected, seed,
                      [&](const tiller_t* t, std::uint32_t tick, const double* state) {
                        for (std::size_t a = 0; a < kAheads; ++a) {
                          const Seen& was = seen[tick][a];
                          for (std::uint32_t i = 0; was.made && i < nx; ++i) {
                            const double off = state_difference(*task.config.model, i, state[i], was.mean[i]);
                            coverage.inside[a] += std::abs(off) <= kBand * was.sd[i];
                            ++coverage.all[a];
                          }
                          Seen& next = seen[tick + kAhead[a]][a];
                          next.mean.resize(nx);
                          next.sd.resize(nx);
                          next.made = tiller_get_prediction(t, kAhead[a], next.mean.data(), next.sd.data()) == 0;
                        }
                      });
  return coverage;
}

void report_bands(bench::Table& table, const std::vector<UncertainTask>& tasks, std::uint64_t first,
                  std::uint64_t seeds, unsigned threads) {
  for (const UncertainTask& task : tasks) {
    Coverage sum;
    std::mutex mutex;
    std::atomic<std::uint64_t> next{0};
    const auto work = [&] {
      for (std::uint64_t i = next++; i < seeds; i = next++) {
        const Coverage one = run_bands(task, first + i);
        const std::lock_guard<std::mutex> lock(mutex);
        for (std::size_t a = 0; a < kAheads; ++a) sum.inside[a] += one.inside[a], sum.all[a] += one.all[a];
      }
    };
    std::vector<std::thread> pool;
    for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
    work();
    for (std::thread& t : pool) t.join();
    table.heading(task.name + ", " + std::to_string(seeds) + " seeds: true states in the 90 % band foreseen");
    for (std::size_t a = 0; a < kAheads; ++a) {
      const double share =
          100.0 * static_cast<double>(sum.inside[a]) / static_cast<double>(std::max<std::uint64_t>(sum.all[a], 1));
      char text[100];
      std::snprintf(text, sizeof text, "%u periods before: %.1f %% of %llu, off 90 %% by", kAhead[a], share,
                    static_cast<unsigned long long>(sum.all[a]));
      table.row(text, std::abs(share - 90.0), "%", bench::at_most(3.0));
    }
  }
}

std::vector<UncertainTask> band_tasks() {
  UncertainTask cart = bench::cart_pole_task(), quadrotor = bench::planar_quadrotor_task();
  for (UncertainTask* task : {&cart, &quadrotor}) {
    task->noisy_plant = true;
    task->config.planner.predict_spread = 1;
  }
  cart.config.process_sd[2] = 0.05;
  cart.config.process_sd[3] = 0.1;
  UncertainTask gradient = cart;
  gradient.name = "cart-pole, ilqr";
  gradient.config.planner.kind = tiller_planner_ilqr;
  gradient.config.planner.iterations = 5;
  gradient.hypotheses = 8;
  cart.name = "cart-pole, mppi";
  quadrotor.name = "planar quadrotor, ilqr";
  quadrotor.config.process_sd[3] = quadrotor.config.process_sd[4] = 0.1;
  quadrotor.config.process_sd[5] = 0.2;
  return {cart, gradient, quadrotor};
}

// ---- the rail -----------------------------------------------------------------------------------

UncertainTask chance_task() {
  UncertainTask t = bench::cart_pole_task();
  t.name = "cart-pole on a rail, process noise";
  t.rail_m = 0.8;
  t.noisy_plant = true;
  tiller::Config& c = t.config;
  c.process_sd[2] = 0.15;
  c.process_sd[3] = 0.15;
  c.state_low[0] = -t.rail_m;
  c.state_high[0] = t.rail_m;
  c.cost.hard_bounds = 1;
  c.planner.kind = tiller_planner_sqp;
  c.planner.iterations = 4;
  c.planner.horizon = 50;
  return t;
}

struct RailRuns {
  int left = 0;
  double cost = 0.0, farthest = 0.0;
};

RailRuns run_rail(const UncertainTask& task, std::uint64_t first, std::uint64_t seeds, unsigned threads) {
  std::vector<UncertainRun> runs(seeds);
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    for (std::uint64_t i = next++; i < seeds; i = next++) runs[i] = run_uncertain(task, Knowledge::oracle, first + i);
  };
  std::vector<std::thread> pool;
  for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
  RailRuns sum;
  for (const UncertainRun& r : runs) {
    sum.left += r.farthest > task.rail_m;
    sum.cost += r.cost / static_cast<double>(seeds);
    sum.farthest = std::max(sum.farthest, r.farthest);
  }
  return sum;
}

/// 95 % of how many of n runs leave the rail at a probability of p each.
std::pair<int, int> binomial_range(int n, double p) {
  double term = std::pow(1.0 - p, n), sum = 0.0;
  int low = 0, high = n;
  for (int k = 0; k <= n; ++k) {
    if (sum < 0.025 && sum + term >= 0.025) low = k;
    sum += term;
    if (sum >= 0.975) {
      high = k;
      break;
    }
    term *= (n - k) / (k + 1.0) * p / (1.0 - p);
  }
  return {low, high};
}

void report_rail(bench::Table& table, const UncertainTask& base, std::uint64_t first, std::uint64_t seeds,
                 unsigned threads) {
  table.heading(base.name + ", " + std::to_string(seeds) + " seeds");
  struct Plain {
    double margin_m;
    RailRuns runs;
  };
  std::vector<Plain> plain;
  for (const double margin_m : {0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3}) {
    UncertainTask task = base;
    task.config.state_high[0] -= margin_m;
    task.config.state_low[0] += margin_m;
    plain.push_back({margin_m, run_rail(task, first, seeds, threads)});
    char text[100];
    std::snprintf(text, sizeof text, "margin of %.2f m: runs that leave it (mean cost %.1f, farthest %.3f m)", margin_m,
                  plain.back().runs.cost, plain.back().runs.farthest);
    table.row(text, 100.0 * plain.back().runs.left / static_cast<double>(seeds), "%", bench::Goal{});
  }
  for (const double risk : {0.01, 0.05, 0.2}) {
    UncertainTask task = base;
    task.config.cost.bound_risk = risk;
    const RailRuns runs = run_rail(task, first, seeds, threads);
    const auto [low, high] = binomial_range(static_cast<int>(seeds), risk);
    char text[160];
    std::snprintf(text, sizeof text,
                  "chance %.0f %%: runs that leave it (95 %%: %d to %d; mean cost %.1f, farthest %.3f m)", 100.0 * risk,
                  low, high, runs.cost, runs.farthest);
    table.row(text, runs.left, "runs", bench::at_most(high));
    double cheapest = HUGE_VAL;
    for (const Plain& p : plain)
      if (p.runs.left <= high) cheapest = std::min(cheapest, p.runs.cost);
    std::snprintf(text, sizeof text, "chance %.0f %%: cost over that of the best margin which meets it", 100.0 * risk);
    table.row(text, runs.cost / cheapest, "x", bench::at_most(1.05));
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t first = 1, seeds = 0;
  unsigned threads = 2;
  std::string only;
  std::vector<std::pair<std::string, double>> changes;
  for (int i = 1; i < argc; ++i) {
    const bool more = i + 1 < argc;
    if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      first = std::strtoull(argv[++i], nullptr, 10);
      seeds = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--threads") && more) {
      threads = static_cast<unsigned>(std::strtoul(argv[++i], nullptr, 10));
    } else if (!std::strcmp(argv[i], "--only") && more) {
      only = argv[++i];
    } else if (!std::strcmp(argv[i], "--set") && i + 2 < argc) {
      const std::string key = argv[++i];
      changes.emplace_back(key, bench::real_number(argv[++i]));
    } else {
      std::fprintf(stderr, "bench_spread: unknown argument '%s'\n", argv[i]);
      return 2;
    }
  }
  const auto wanted = [&](const char* part) { return only.empty() || only == part; };
  const auto change = [&](UncertainTask task) {
    for (const auto& [key, value] : changes)
      if (!override_setting(task, key, value)) {
        std::fprintf(stderr, "bench_spread: no setting '%s'\n", key.c_str());
        std::exit(2);
      }
    return task;
  };
  bench::Table table;
  std::printf("predicted spreads, seeds from %llu, lockstep, %s\n", static_cast<unsigned long long>(first),
              tiller_instruction_set());
  if (wanted("moments")) report_moments(table);
  if (wanted("bands")) {
    std::vector<UncertainTask> tasks = band_tasks();
    for (UncertainTask& task : tasks) task = change(task);
    report_bands(table, tasks, first, seeds > 0 ? seeds : 20, threads);
  }
  if (wanted("rail")) report_rail(table, change(chance_task()), first, seeds > 0 ? seeds : 300, threads);
  return table.finish();
}
