#include "harness/episode/episode.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <limits>
#include <memory>
#include <new>

#include "tiller/tiller.h"
#include "tools/base/thread_pool.hpp"
#include "tools/links/link.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/robot/stage_cost.hpp"
#include "tools/run/episodes.hpp"

namespace tiller::bench {
namespace {

constexpr double kUprightRad = 0.2;

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

double prior_sd(const tiller_prior_t& p) {
  switch (p.kind) {
    case tiller_prior_uniform: return (p.high - p.low) / std::sqrt(12.0);
    case tiller_prior_normal: return p.b;
    case tiller_prior_log_normal: return p.a * std::sqrt((std::exp(p.b * p.b) - 1.0) * std::exp(p.b * p.b));
    default: return 0.0;
  }
}

/// FNV-1a over the bits of the commands.
void hash_bits(std::uint64_t& hash, double value) {
  unsigned char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  for (unsigned char byte : bytes) hash = (hash ^ byte) * 1099511628211ull;
}

std::int64_t now_ns(void*) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t cpu_now_ns(void*) {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

double quantile(std::vector<double>& v, double q) {
  if (v.empty()) return 0.0;
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

/// Follows the true state: since when upright, and at what cost.
class Judge {
 public:
  explicit Judge(const tools::RobotFile& robot) : robot_(robot) {
    for (std::size_t i = 0; i < robot.names.states.size(); ++i) {
      if (robot.names.states[i] == "angle_rad") angle_ = static_cast<int>(i);
      if (robot.names.states[i] == "position_m") position_ = static_cast<int>(i);
    }
  }
  void see(double time_s, const double* x, const double* u, EpisodeResult& result) {
    const tiller_cost_config_t& cost = robot_.config.cost;
    const double sum = tools::stage_cost(robot_.config, seen_, x, u);
    result.cost += (sum - result.cost) / static_cast<double>(++seen_);
    if (position_ >= 0) result.worst_position_m = std::max(result.worst_position_m, std::abs(x[position_]));
    if (angle_ < 0) return;
    const bool up = std::abs(std::remainder(x[angle_] - cost.target[angle_], 2 * M_PI)) < kUprightRad;
    if (!up) result.upright_from_s = -1;
    if (up && result.upright_from_s < 0) result.upright_from_s = time_s;
  }

 private:
  const tools::RobotFile& robot_;
  int angle_ = -1, position_ = -1;
  std::uint64_t seen_ = 0;
};

tools::RobotFile vary(tools::RobotFile robot, const EpisodeOptions& options) {
  robot.sim.seed = options.seed;
  robot.config.seed = options.seed;
  if (options.episode > 0) tools::seed_episode(robot, options.episode);
  robot.config.planner.kind = options.planner;
  if (!options.clock) robot.config.planner.deadline_us = 0;
  if (options.frozen) robot.config.posterior.enabled = 0;
  return robot;
}

/// A controller in memory of its own.
class Controller {
 public:
  Controller(const tools::RobotFile& robot, const EpisodeOptions& options) : pool_(options.threads) {
    hooks_.size = sizeof hooks_;
    hooks_.version = TILLER_CONFIG_VERSION;
    hooks_.context = &pool_;
    hooks_.now_ns = !options.clock ? nullptr : options.cpu_clock ? &cpu_now_ns : &now_ns;
    hooks_.parallel_for = [](void* context, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
      static_cast<tools::ThreadPool*>(context)->run(n, work, arg);
    };
    const std::size_t size = tiller_size(&robot.config);
    memory_.reset(::operator new (std::max<std::size_t>(size, 1), std::align_val_t{TILLER_ALIGNMENT}));
    status_ = tiller_init(&t_, &robot.config, &hooks_, memory_.get(), size);
  }
  tiller_t* get() const { return t_; }
  tiller_status_t status() const { return status_; }

 private:
  tools::ThreadPool pool_;
  tiller_hooks_t hooks_{};
  std::unique_ptr<void, AlignedFree> memory_;
  tiller_t* t_ = nullptr;
  tiller_status_t status_;
};

/// Drives to the end; the controller's report after the last tick.
tiller_info_t run_ticks(tiller_t* t, const tools::RobotFile& robot, const EpisodeOptions& options, tools::Link& link,
                        EpisodeResult& result) {
  Judge judge(robot);
  result.rows.begin(robot);
  std::vector<double> tick_us, state(robot.names.states.size());
  const volatile std::sig_atomic_t go_on = 0;
  const auto ticks = static_cast<std::uint64_t>(std::llround(options.seconds / robot.config.period_s));
  result.command_hash = 1469598103934665603ull;
  tiller_info_t info{};
  for (std::uint64_t k = 0; k < ticks; ++k) {
    const tools::Sensed sensed = link.wait(go_on);
    tiller_command_t command{};
    tiller_tick(t, sensed.now_us, sensed.fresh ? &sensed.measurement : nullptr, &command);
    link.send(command);
    if (sensed.fresh) result.rows.add(static_cast<int>(k) + 1, sensed.measurement, command);
    link.truth(state.data());
    judge.see(static_cast<double>(k) * robot.config.period_s, state.data(), command.value, result);
    if (options.watch) options.watch(k, state.data());
    for (std::size_t i = 0; i < robot.names.inputs.size(); ++i) hash_bits(result.command_hash, command.value[i]);
    tiller_get_info(t, &info);
    if (info.tick_ns > 0) tick_us.push_back(static_cast<double>(info.tick_ns) * 1e-3);
  }
  result.tick_us_median = quantile(tick_us, 0.5);
  result.tick_us_p99 = quantile(tick_us, 0.99);
  result.tick_us_p999 = quantile(tick_us, 0.999);
  result.tick_us_worst = quantile(tick_us, 1.0);
  return info;
}

void take_counters(const tiller_info_t& info, EpisodeResult& result) {
  result.ticks = info.ticks;
  result.late_plans = info.late_plans;
  result.rejected = info.rejected_measurements;
  result.state = static_cast<int>(info.state);
  result.status = info.status;
  result.noise_scale = info.noise_scale;
  result.effective_samples = info.effective_samples;
  result.acceptance = info.acceptance;
}

void take_particles(const tiller_t* t, const tiller_config_t& config, EpisodeResult& result) {
  for (std::uint32_t k = 0; k < config.posterior.particles; ++k) {
    double params[TILLER_MAX_PARAMS], weight = 0.0;
    (void)tiller_get_particle(t, k, params, nullptr, &weight);
    result.particles.params.insert(result.particles.params.end(), params, params + config.param_count);
    result.particles.weight.push_back(weight);
  }
}

void take_parameters(const tiller_t* t, const tools::RobotFile& robot, const std::vector<double>& truth,
                     const tiller_info_t& info, EpisodeResult& result) {
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    ParameterResult p;
    p.name = robot.names.params[i];
    p.truth = truth[i];
    p.prior_sd = prior_sd(robot.config.priors[i]);
    p.mean = info.param_mean[i];
    p.sd = info.param_sd[i];
    tiller_get_quantile(t, i, 0.05, &p.q05);
    tiller_get_quantile(t, i, 0.95, &p.q95);
    result.parameters.push_back(p);
  }
}

}  // namespace

EpisodeResult run_episode(const tools::RobotFile& given, const EpisodeOptions& options) {
  EpisodeResult result;
  result.seed = options.seed;
  const tools::RobotFile robot = vary(given, options);
  const auto plant = tools::make_sim_plant(robot, result.error);
  if (!plant) return result;
  const auto link = tools::make_sim_link(robot, *plant, false);
  const Controller controller(robot, options);
  if (controller.status() != tiller_status_ok) {
    result.error = tiller_status_text(controller.status());
    return result;
  }
  tiller_arm(controller.get());
  const tiller_info_t info = run_ticks(controller.get(), robot, options, *link, result);
  take_counters(info, result);
  take_particles(controller.get(), robot.config, result);
  take_parameters(controller.get(), robot, plant->true_params, info, result);
  return result;
}

}  // namespace tiller::bench
