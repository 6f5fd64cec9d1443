#include "tools/command/commands.hpp"

#include <cstdio>
#include <fstream>
#include <iterator>
#include <thread>

#include "tools/open/robot_open.hpp"
#include "tools/open/substeps.hpp"
#include "tools/robot/robot_hints.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {

namespace {

std::string hints_of_file(const RobotFile& robot) {
  std::ifstream file(robot.path, std::ios::binary);
  return robot_hints(robot, {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()});
}

}  // namespace

std::unique_ptr<RobotFile> read_robot_or_complain(const std::string& path) {
  std::string errors;
  auto robot = read_robot_file(path, errors);
  std::fputs(robot ? hints_of_file(*robot).c_str() : errors.c_str(), stderr);
  if (robot && !is_enough(robot->substeps))
    std::fprintf(stderr,
                 "%s: [model] period_s = %s: the integrator's error in a period is %.2g times the noise expected of %s "
                 "even with %u substeps, and the posterior takes it for physics; shorten the period, or raise [noise] "
                 "process_sd\n",
                 path.c_str(), number_text(robot->config.period_s).c_str(), robot->substeps.advised.share,
                 robot->names.states[robot->substeps.advised.worst_state].c_str(), robot->substeps.needed);
  else if (robot && robot->config.substeps < robot->substeps.needed)
    std::fprintf(
        stderr,
        "%s: [model] substeps = %u: the integrator's error in a period is %.0f %% of the noise expected of %s, and "
        "the posterior takes it for physics; leave substeps out, or write at least %u\n",
        path.c_str(), robot->config.substeps, 100.0 * robot->substeps.configured.share,
        robot->names.states[robot->substeps.configured.worst_state].c_str(), robot->substeps.needed);
  return robot;
}

std::string version_text() { return std::string("tiller ") + tiller_version() + ", " + tiller_instruction_set(); }

CLI::Validator number_between(double low, double high) {
  const std::string range = number_text(low) + " .. " + number_text(high);
  return CLI::Validator(
      [low, high, range](std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        const bool good = end != text.c_str() && *end == '\0' && value >= low && value <= high;  // NaN: not
        return good ? std::string() : "'" + text + "' is not a number within " + range;
      },
      "in [" + range + "]");
}

int complain(const std::string& text) {
  const bool ends = !text.empty() && text.back() == '\n';
  std::fprintf(stderr, "tiller: %s%s", text.c_str(), ends ? "" : "\n");
  return kExitBadInput;
}

void add_override_options(CLI::App& command, Overrides& overrides) {
  command.add_option("--seed", overrides.seed, "seed of controller and plant, instead of the robot file's")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{9007199254740992}));
  command.add_option("--threads", overrides.threads, "threads that a tick may use; the commands do not depend on it")
      ->check(CLI::Range(1u, 64u));
  command.add_option("--planner", overrides.planner, "planner, instead of the robot file's: " + join(planner_names()));
  command.add_flag("--frozen", overrides.frozen, "do not learn: the posterior stays at the prior");
}

bool apply_overrides(const Overrides& overrides, RobotFile& robot) {
  if (overrides.seed != 0) robot.config.seed = robot.sim.seed = overrides.seed;
  if (overrides.frozen) robot.config.posterior.enabled = 0;
  if (overrides.planner.empty()) return true;
  const int kind = index_of(planner_names(), overrides.planner);
  if (kind >= 0) {
    robot.config.planner.kind = static_cast<std::uint32_t>(kind);
    return true;
  }
  const std::string near = nearest(overrides.planner, planner_names());
  complain("--planner " + overrides.planner + ": no such planner; " +
           (near.empty() ? "" : "did you mean " + near + "? ") + "known: " + join(planner_names()));
  return false;
}

}  // namespace tiller::tools
