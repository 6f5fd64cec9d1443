// every_planner TICKS ROBOT.toml...: each robot file on its simulated plant, so many ticks with each planner in turn.
// What is run under valgrind: a read of memory that nobody wrote ends it there. Here it fails where a run does not stay
// ACTIVE.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "tools/links/model_plant.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/run/run_loop.hpp"

namespace {

using namespace tiller::tools;

constexpr const char* kPlanners[] = {
#define TILLER_PLANNER(name, help) #name,
#include "tiller/planners.def"
};

/// Fewer of what makes a tick long: no other memory is read then.
void shorten(tiller_config_t& config) {
  config.posterior.particles = 16;
  config.posterior.window = std::min(config.posterior.window, 16u);
  config.posterior.moves_per_tick = std::min(config.posterior.moves_per_tick, 8u);
  tiller_planner_config_t& p = config.planner;
  p.horizon = std::min(p.horizon, 12u);
  p.shared_steps = std::min(p.shared_steps, p.horizon);
  p.hold_steps = std::min(p.hold_steps, p.horizon);
  p.knots = std::min(p.knots, p.horizon);
  p.rollouts = std::min(p.rollouts, 32u);
  p.particles = std::min(p.particles, 4u);
  p.nodes = std::min(p.nodes, 256u);
  p.levels = 2;
  p.deadline_us = 0;
}

/// 1: ran, 0: not a planner for this robot, -1: failed.
int run(RobotFile& robot, std::uint32_t planner, unsigned ticks) {
  const char* path = robot.path.c_str();
  const bool own = robot.config.planner.kind == planner;
  robot.config.planner.kind = planner;
  const char* field = "";
  if (tiller_config_check(&robot.config, &field) != tiller_status_ok) {
    std::printf("%s: %s: not with this robot: %s\n", path, kPlanners[planner], field);
    return own ? -1 : 0;
  }
  std::string error;
  const bool of_model = robot.sim.plant == "model";
  const auto model = of_model ? ModelPlant::make(robot, error) : nullptr;
  const auto ode = of_model ? nullptr : make_sim_plant(robot, error);
  if (!model && !ode) return std::fprintf(stderr, "%s\n", error.c_str()), -1;
  const auto link = of_model ? make_model_link(robot, *model) : make_sim_link(robot, *ode, false);
  RunOptions options;
  options.seconds = ticks * robot.config.period_s;
  options.quiet = true;
  const RunResult result = run_robot(robot, *link, options);
  std::printf("%s: %s: %llu ticks, %s, the last plan costs %g\n", path, kPlanners[planner],
              static_cast<unsigned long long>(result.ticks),
              tiller_state_name(static_cast<tiller_state_t>(result.info.state)), result.info.plan_cost);
  const bool planned = std::isfinite(result.info.plan_cost) || planner == tiller_planner_policy;
  return result.exit_code == 0 && result.info.state == tiller_state_active && planned ? 1 : -1;
}

}  // namespace

int main(int argc, char** argv) {
  const unsigned ticks = argc > 1 ? static_cast<unsigned>(std::atoi(argv[1])) : 0;
  int bad = argc < 3 || ticks == 0;
  for (int i = 2; i < argc; ++i) {
    int ran = 0;
    std::string error;
    const auto robot = read_robot_file(argv[i], error);
    if (!robot) return std::fprintf(stderr, "%s\n", error.c_str()), 1;
    shorten(robot->config);
    const auto shipped = robot->config;
    for (std::uint32_t planner = 0; planner < std::size(kPlanners); ++planner) {
      const int outcome = run(*robot, planner, ticks);
      robot->config = shipped;
      ran += outcome > 0;
      bad += outcome < 0;
    }
    bad += ran < 5;  // all but those that a robot's inputs or cones rule out
  }
  return bad != 0;
}
