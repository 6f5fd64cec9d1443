#include "tools/cli/log_arguments.hpp"

#include <cstdio>
#include <utility>

#include "tools/command/commands.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {

void put_log_first(std::string& log, std::string& robot) {
  const auto is_robot = [](const std::string& name) {
    return name.size() > 5 && name.substr(name.size() - 5) == ".toml";
  };
  if (is_robot(log) && !robot.empty() && !is_robot(robot)) std::swap(log, robot);
}

std::unique_ptr<RobotFile> read_robot_of_log(const std::string& command, const std::string& log,
                                             const std::string& robot) {
  if (!robot.empty()) return read_robot_or_complain(robot);
  std::string errors;
  const std::string text = robot_in_log(log, errors);
  if (errors.empty())
    errors =
        log +
        ": no robot file is in it, as an MCAP of `tiller run --record` has; give it as the second argument: tiller " +
        command + " LOG my_robot.toml";
  errors += "\n";
  auto read = text.empty() ? nullptr : parse_robot_file(text, log + ":robot.toml", errors);
  if (!read) std::fputs(errors.c_str(), stderr);
  return read;
}

}  // namespace tiller::tools
