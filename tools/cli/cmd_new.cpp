// new: a robot's folder out of five answers.
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <sstream>

#include "tools/base/output_file.hpp"
#include "tools/cli/import_description.hpp"
#include "tools/command/commands.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/transport_names.hpp"
#include "tools/starter/starter.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string folder, mechanism, sensors, limits, period, transport;
  bool force = false;
};

bool asks() { return ::isatty(STDIN_FILENO) != 0; }

/// One line from the terminal; empty: the default, and so is the end of the input.
std::string ask(const std::string& question, const std::string& fallback) {
  std::printf("%s [%s]: ", question.c_str(), fallback.c_str());
  std::fflush(stdout);
  std::string line;
  if (!std::getline(std::cin, line)) std::printf("\n");
  line = trimmed(line);
  return line.empty() ? fallback : line;
}

using Check = std::function<bool(const std::string& answer, std::string& error)>;

/// The option's answer, else the terminal's, else the default. False after a complaint: an option's answer is wrong.
bool settle(const char* option, const std::string& given, const std::string& question, const std::string& fallback,
            const Check& check) {
  std::string error;
  if (!given.empty()) {
    if (check(given, error)) return true;
    (void)complain(std::string(option) + " " + error);
    return false;
  }
  while (asks() && !std::cin.eof()) {
    if (check(ask(question, fallback), error)) return true;
    std::printf("   %s\n", error.c_str());
  }
  return check(fallback, error);
}

bool is_description(const std::string& mechanism) {
  std::error_code ignored;
  return fs::is_regular_file(mechanism, ignored);
}

bool settle_mechanism(const Arguments& a, std::string& mechanism) {
  const Words known = starter_mechanisms();
  const Check check = [&](const std::string& answer, std::string& error) {
    mechanism = answer;
    if (index_of(known, answer) >= 0 || is_description(answer)) return true;
    const std::string near = nearest(answer, known);
    error = "'" + answer + "' is no file and none of " + join(known) + (near.empty() ? "" : "; is " + near + " meant?");
    return false;
  };
  return settle("--mechanism", a.mechanism, "1. Mechanism: " + join(known) + ", or a description's file (URDF, MJCF)",
                "pendulum", check);
}

std::string read_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

bool settle_rest(const Arguments& a, const RobotFile& robot, Answers& answers) {
  using Read = bool (*)(const std::string&, const RobotFile&, Answers&, std::string&);
  const auto with = [&](Read read) -> Check {
    return [&robot, &answers, read](const std::string& answer, std::string& error) {
      return read(answer, robot, answers, error);
    };
  };
  const std::string transport = robot.transport.kind.empty() ? "lcm" : robot.transport.kind;
  return settle("--sensors", a.sensors,
                "2. Sensors: measured states with their standard deviation, of " + join(robot.names.states),
                sensors_text(robot), with(read_sensors)) &&
         settle("--limits", a.limits, "3. Limits of the inputs: one number for both sides, or low..high",
                limits_text(robot), with(read_limits)) &&
         settle("--period", a.period, "4. Period of the control loop in s", number_text(robot.config.period_s),
                with(read_period)) &&
         settle("--transport", a.transport,
                "5. Transport to the robot: " + join(transport_words()) + ", or none for simulation alone", transport,
                with(read_transport));
}

int new_command(const Arguments& a) {
  const std::string folder = fs::path(a.folder).lexically_normal().string(), path = folder + "/robot.toml";
  std::error_code ignored;
  if (!a.force && fs::exists(path, ignored)) return complain(path + " is there already; write it anew with --force");
  if (asks()) std::printf("Five questions; Enter takes what stands in brackets.\n");
  std::string mechanism, errors;
  if (!settle_mechanism(a, mechanism)) return kExitBadInput;
  const bool described = is_description(mechanism);
  if (const int code = described ? import_description(mechanism, folder) : 0; code != 0) return code;
  const std::string text = described ? read_text(path) : starter_text(mechanism);
  auto robot = parse_robot_file(text, path, errors);
  if (!robot) return complain(errors);
  Answers answers;
  if (!settle_rest(a, *robot, answers)) return kExitBadInput;
  const std::string made = with_answers(text, *robot, answers, fs::path(folder).filename().string());
  if (!parse_robot_file(made, path, errors)) return complain(errors);
  make_folders_for(path);
  if (!replace_file(path, made, errors)) return complain(errors);
  const char* const file = path.c_str();
  std::printf("%s\nnext:\n  tiller run %s --sim --seconds 5 --report %s/run.html\n", file, file, folder.c_str());
  std::printf("  tiller run %s --sim --real-time --view rerun\n", file);
  return kExitOk;
}

}  // namespace

void add_new_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("new", "five questions, and a robot's folder that runs in simulation at once");
  auto a = std::make_shared<Arguments>();
  command->add_option("FOLDER", a->folder, "where robot.toml goes; made if need be")->required();
  command->add_option("--mechanism", a->mechanism, "a mechanism that comes with tiller, or a description (URDF, MJCF)");
  command->add_option("--sensors", a->sensors, "\"STATE=SD, ...\": what is measured, and how well, in SI units");
  command->add_option("--limits", a->limits, "\"INPUT=HIGH, ...\" or \"INPUT=LOW..HIGH, ...\"");
  command->add_option("--period", a->period, "of the control loop, in s; horizon and deadline go with it");
  command->add_option("--transport", a->transport, join(transport_words()) + ", or none for simulation alone");
  command->add_flag("--force", a->force, "write a robot file anew that is there already");
  command->footer(
      "On a terminal it asks for what no option says; elsewhere that is as the mechanism comes.\n\n"
      "Examples:\n"
      "  tiller new my_robot\n"
      "      asks; Enter takes the default\n"
      "  tiller new my_pole --mechanism cart_pole --sensors \"position_m=0.001, angle_rad=0.003\" --limits force_N=15\n"
      "      --period 0.01 --transport none\n"
      "      the same without a terminal\n"
      "  tiller new my_arm --mechanism my_arm.urdf --period 0.005");
  command->callback([a, &exit_code] { exit_code = new_command(*a); });
}

}  // namespace tiller::tools
