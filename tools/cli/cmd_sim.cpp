#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>

#include "io/udp_multicast.hpp"
#include "ros2/ros2_source.hpp"
#include "sim/servers/serve_can.hpp"
#include "sim/servers/serve_lcm.hpp"
#include "sim/servers/serve_ros2.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/command/commands.hpp"
#include "tools/links/lcm_seal.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/robot/ros2_topics.hpp"
#include "tools/simulator/plant_lines.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string robot;
  std::string serve = "lcm";
  bool lockstep = false, real_time = false;
  double seconds = 0;
  double answer_timeout_s = 1, repeat_s = 0.1, pace = 0;
  std::uint64_t seed = 0;
};

/// The servers send the plant's channels as they come; the robot file must list them in that order.
bool is_same_order(const RobotFile& robot, const SimPlant& made, std::string& error) {
  Words channels;
  for (const sim::Channel& channel : made.plant->measurements()) channels.push_back(channel.name);
  if (channels == robot.names.measurements) return true;
  error = robot.path + ": [measurement] lists " + join(robot.names.measurements) + "; the plant serves " +
          join(channels) + ": list these, in this order";
  return false;
}

void print_plant(const RobotFile& robot, const SimPlant& made) {
  std::printf("plant %s, seed %llu:", robot.sim.plant.c_str(), static_cast<unsigned long long>(robot.sim.seed));
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (std::isfinite(made.true_params[i]))
      std::printf("  %s %.4g", robot.names.params[i].c_str(), made.true_params[i]);
  }
  std::printf("\n");
}

/// A robot of JointStates alone: what the robot file takes from elsewhere, nobody publishes here.
bool ros2_options(const RobotFile& robot, sim::Ros2Options& ros2, std::string& error) {
  const Ros2Section& section = robot.transport.ros2;
  ros2.joint_states = section.joint_states;
  ros2.commands = ros2_commands_topic(robot);
  for (std::size_t i = 0; i < robot.names.measurements.size(); ++i) {
    const std::string& name = robot.names.measurements[i];
    Ros2Source source;
    const bool known = section.sources.empty() ? ros2_source_of_name(name.c_str(), &source)
                                               : ros2_parse_source(section.sources[i].c_str(), &source);
    if (!known || source.message != Ros2Message::kJointState) {
      error = robot.path + ": transport.sources." + name +
              ": the plant publishes JointStates alone; write \"position:joint\" or \"velocity:joint\"";
      return false;
    }
    ros2.channels.push_back({source.joint, source.field});
  }
  return true;
}

int serve_plant(const Arguments& a, const RobotFile& robot, sim::Plant& plant, sim::ServeReport& report) {
  const StopFlag stop;
  sim::ServeOptions options;
  options.period_s = robot.config.period_s;
  options.lockstep = a.lockstep;
  options.duration_s = a.seconds;
  options.answer_timeout_s = a.answer_timeout_s;
  options.pace = a.pace;
  options.plan_timeout_s = robot.sim.plan_timeout_s;
  options.repeat_s = a.repeat_s;
  options.stop = &stop.flag();
  double next_s = 0;
  bool tripped = false;
  options.on_period = [&](const sim::Plant& p, const sim::PlantMeasurement&) {
    const double time_s = 1e-6 * static_cast<double>(p.time_us());
    if (time_s < next_s && p.watchdog_tripped() == tripped) return;
    next_s = time_s + 0.5;
    tripped = p.watchdog_tripped();
    std::vector<double> state(p.states().size());
    p.true_state(state.data());
    std::printf("%7.2f s", time_s);
    for (std::size_t i = 0; i < state.size(); ++i) std::printf("  %s %.3f", p.states()[i].name.c_str(), state[i]);
    std::printf("%s\n", tripped ? "  WATCHDOG: no command, the motor is off" : "");
    std::fflush(stdout);
  };
  if (a.serve == "lcm") {
    sim::LcmOptions lcm;
    lcm.url = robot.transport.url;
    lcm.channel_prefix = robot.transport.channel_prefix;
    LcmSeal seal;
    if (!make_lcm_seal(robot, seal, report.error)) return 1;
    lcm.sign = seal.sign;
    lcm.verify = seal.verify;
    return serve_lcm(plant, lcm, options, report);
  }
  if (a.serve == "ros2") {
    sim::Ros2Options ros2;
    return ros2_options(robot, ros2, report.error) ? serve_ros2(plant, ros2, options, report) : 1;
  }
  sim::CanOptions can;
  can.interface = robot.transport.interface;
  if (!robot.transport.nodes.empty()) can.drive.node = robot.transport.nodes[0];
  if (!robot.transport.drives.empty()) {
    const DriveSection& drive = robot.transport.drives[0];
    can.drive.protocol = drive.actuator;
    can.drive.position_rad = drive.position_rad;
    can.drive.velocity_rad_s = drive.velocity_rad_s;
    can.drive.torque_Nm = drive.torque_Nm;
    can.drive.kp_Nm_rad = drive.kp_max;
    can.drive.kd_Nms_rad = drive.kd_max;
    can.drive.reply = drive.reply;
    can.drive.reply_id = drive.reply_id;
  }
  if (!robot.transport.wheel_radius_m.empty()) can.wheel_radius_m = robot.transport.wheel_radius_m[0];
  can.sensor_node = robot.transport.sensor_node;
  return serve_can(plant, can, options, report);
}

int sim_command(const Arguments& a) {
  auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  if (a.seed != 0) robot->sim.seed = a.seed;
  std::string error;
  if (a.serve == "lines")  // stdout is for answers alone
    return serve_plant_lines(*robot, std::cin, std::cout, error) ? static_cast<int>(kExitOk) : complain(error);
  const auto made = make_sim_plant(*robot, error);
  if (!made || !is_same_order(*robot, *made, error)) return complain(error);
  OpenError no_route;
  if (a.serve == "lcm" && !has_multicast_route(robot->transport.url.c_str(), &no_route)) return complain(no_route.text);
  print_plant(*robot, *made);
  std::printf("serving over %s in %s; Ctrl-C ends\n", a.serve.c_str(), a.lockstep ? "lockstep" : "real time");
  std::fflush(stdout);
  sim::ServeReport report;
  const int code = serve_plant(a, *robot, *made->plant, report);
  const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf(
      "%llu periods, %llu commands, %llu measurements sent again, %llu missing answers, %llu stale, %llu bad, "
      "%llu without a new plan, %llu late periods, %llu watchdog trips\n",
      n(report.periods), n(report.commands), n(report.repeats), n(report.missing_answers), n(report.stale_commands),
      n(report.bad_commands), n(report.hung_commands), n(report.late_periods), n(made->plant->watchdog_trips()));
  return code == 0 ? static_cast<int>(kExitOk) : complain(report.error);
}

}  // namespace

void add_sim_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("sim", "serve the simulated plant of a robot file to `tiller run`");
  auto a = std::make_shared<Arguments>();
  command->add_option("ROBOT", a->robot, "robot file (.toml) with a [sim] section")->required();
  command->add_option("--serve", a->serve, "how: lcm, can, ros2, or lines (default lcm)")
      ->check(CLI::IsMember({"lcm", "can", "ros2", "lines"}));
  auto* lockstep = command->add_flag("--lockstep", a->lockstep, "simulated time waits for each command");
  command->add_flag("--real-time", a->real_time, "simulated time follows the wall clock (default)")->excludes(lockstep);
  command->add_option("--seconds", a->seconds, "end after this much simulated time (default: at Ctrl-C)")
      ->check(number_between(0.001, 1e9));
  command
      ->add_option("--repeat", a->repeat_s,
                   "lockstep: wall time in s after which a measurement is sent again, for it or its answer was lost "
                   "(default 0.1)")
      ->check(number_between(0.001, 3600));
  command
      ->add_option(
          "--pace", a->pace,
          "lockstep: at most so many times as fast as the wall clock, for whoever listens along (default 0: as "
          "fast as it goes)")
      ->check(number_between(0, 1e6));
  command
      ->add_option("--answer-timeout", a->answer_timeout_s,
                   "lockstep: wall time in s after which time goes on without a command (default 1)")
      ->check(number_between(0.001, 1e9));
  command->add_option("--seed", a->seed, "of the plant, instead of the robot file's")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{9007199254740992}));
  command->footer(
      "Examples:\n"
      "  tiller sim robots/cart_pole.toml --serve lcm\n"
      "      a cart-pole over LCM in real time; steer it from another terminal:\n"
      "      tiller run robots/cart_pole.toml --transport lcm --arm\n"
      "  tiller sim robots/cart_pole.toml --serve can --lockstep --seed 3\n"
      "      the same on a CAN bus, waiting for each command\n"
      "  tiller sim robots/cart_pole.toml --serve lines\n"
      "      answers requests on stdin, as a simulator of tiller infer (docs/guide/simulator.md)\n\n" +
      sim::plant_help());
  command->callback([a, &exit_code] { exit_code = sim_command(*a); });
}

}  // namespace tiller::tools
