// Runs of a shipped robot with any planner, in lockstep with its simulated plant: one JSON line a seed. What
// `./dev bench shipped` runs for all robots and planners.
//
//   bench_shipped ROBOT PLANNER SECONDS [--horizon N] [--particles M] SEED...
//
// How far a robot is from its task is told by its own cost: the weighted squares of what its states and outputs are off
// by, over the last quarter of the run, as a share of what they would be off by if the robot had stayed where it
// started. A gait oscillates about what it is asked for, so the hopper is judged by its mean speed and by whether it
// fell.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <string>
#include <vector>

#include "bench/table/arguments.hpp"
#include "harness/episode/episode.hpp"
#include "planners/planner.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/stage_cost.hpp"

namespace {

using namespace tiller;

/// Centres of the priors: outputs depend on lengths, which are known.
std::vector<double> known_parameters(const tiller_config_t& c) {
  std::vector<double> params(TILLER_MAX_PARAMS);
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    params[i] = c.priors[i].kind == tiller_prior_uniform ? 0.5 * (c.priors[i].low + c.priors[i].high) : c.priors[i].a;
  return params;
}

class Judge {
 public:
  Judge(const tools::RobotFile& robot, double seconds)
      : robot_(robot),
        params_(known_parameters(robot.config)),
        from_(static_cast<std::uint64_t>(0.75 * seconds / robot.config.period_s)) {}

  void see(std::uint64_t tick, const double* x) {
    const std::size_t nx = robot_.names.states.size();
    if (start_.empty()) start_.assign(x, x + nx);
    if (hops() && (x[1] < 0.3 || std::fabs(x[2]) > 1.0)) fallen_ = true;
    if (tick < from_) return;
    const double no_input[TILLER_MAX_INPUTS] = {};
    off_ += tools::stage_cost(robot_.config, tick, x, no_input, params_.data());
    rest_ += tools::stage_cost(robot_.config, tick, start_.data(), no_input, params_.data());
    if (first_m_s_.empty()) first_m_s_ = {x[0], static_cast<double>(tick)};
    last_m_s_ = {x[0], static_cast<double>(tick)};
  }
  /// RMS off the task over RMS off it at rest; the hopper: error of its mean speed as a share of the speed.
  double share() const {
    if (!hops()) return std::sqrt(off_ / rest_);
    const double speed = (last_m_s_[0] - first_m_s_[0]) / ((last_m_s_[1] - first_m_s_[1]) * robot_.config.period_s);
    return fallen_ ? INFINITY : std::fabs(speed / robot_.config.cost.target[5] - 1.0);
  }

 private:
  bool hops() const { return !std::strcmp(robot_.config.model->name, "hopper"); }

  const tools::RobotFile& robot_;
  std::vector<double> params_, start_, first_m_s_, last_m_s_;
  std::uint64_t from_;
  double off_ = 0.0, rest_ = 0.0;
  bool fallen_ = false;
};

double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::uint32_t planner_kind(const char* name) {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind)
    if (find_planner(kind) && !std::strcmp(find_planner(kind)->name, name)) return kind;
  std::fprintf(stderr, "bench_shipped: no planner '%s'\n", name);
  std::exit(2);
}

bool print_run(const tools::RobotFile& robot, const std::string& name, const char* planner, double seconds,
               std::uint64_t seed) {
  Judge judge(robot, seconds);
  bench::EpisodeOptions options;
  options.seed = seed;
  options.planner = static_cast<tiller_planner_kind_t>(planner_kind(planner));
  options.seconds = seconds;
  options.watch = [&](std::uint64_t tick, const double* x) { judge.see(tick, x); };
  const double begin = cpu_s();
  const bench::EpisodeResult run = run_episode(robot, options);
  if (!run.error.empty()) {  // no run, so that it says nothing of the planner
    std::fprintf(stderr, "%s\n", run.error.c_str());
    return false;
  }
  const double share = run.state == tiller_state_active ? judge.share() : INFINITY;
  std::printf("{\"robot\": \"%s\", \"planner\": \"%s\", \"seed\": %llu, \"share\": ", name.c_str(), planner,
              static_cast<unsigned long long>(seed));
  if (std::isfinite(share))
    std::printf("%.6g", share);
  else
    std::printf("null");
  std::printf(", \"state\": %d, \"cpu_s\": %.3g, \"commands\": \"%016llx\"}\n", run.state, cpu_s() - begin,
              static_cast<unsigned long long>(run.command_hash));
  std::fflush(stdout);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fprintf(stderr, "bench_shipped ROBOT PLANNER SECONDS [--horizon N] [--particles M] SEED...\n");
    return 2;
  }
  std::string errors;
  const auto robot = tools::read_robot_file(std::string(TILLER_ROBOTS "/") + argv[1] + ".toml", errors);
  if (!robot) {
    std::fprintf(stderr, "%s\n", errors.c_str());
    return 2;
  }
  for (int i = 4; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--horizon") && i + 1 < argc)
      robot->config.planner.horizon = static_cast<std::uint32_t>(bench::whole_number(argv[++i]));
    else if (!std::strcmp(argv[i], "--particles") && i + 1 < argc)
      robot->config.planner.particles = static_cast<std::uint32_t>(bench::whole_number(argv[++i]));
    else if (!print_run(*robot, argv[1], argv[2], bench::real_number(argv[3]), std::strtoull(argv[i], nullptr, 10)))
      return 1;
  }
  return 0;
}
