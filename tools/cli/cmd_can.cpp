#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <sstream>
#include <thread>

#include "tools/command/commands.hpp"
#include "tools/doctor/can_doctor.hpp"
#include "tools/robot/drive_settings.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string interface, robot, from;
  double seconds = 1;
  bool fd = false, as_json = false;
};

bool is_name(const std::string& text) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
           c == '.';
  };
  bool good = !text.empty() && text.size() <= 15 && text[0] != '-';
  for (const char c : text) good = good && allowed(c);
  return good;
}

std::string read_all(std::FILE* stream) {
  std::string text;
  char block[4096];
  for (std::size_t n; (n = std::fread(block, 1, sizeof block, stream)) > 0;) text.append(block, n);
  return text;
}

/// ip says what is wrong on stderr, which goes on to the user's.
bool ask_ip(const std::string& interface, CanLinkState& link, std::string& error) {
  const std::string command = "ip -details -statistics -json link show dev " + interface;
  std::FILE* stream = popen(command.c_str(), "r");
  const std::string text = stream == nullptr ? "" : read_all(stream);
  if (stream == nullptr || pclose(stream) != 0) {
    error = "`" + command +
            "` failed: is there such an interface (ip -brief link), and is iproute2 installed? A virtual " +
            "one: sudo ip link add " + interface + " type vcan; sudo ip link set " + interface + " up";
    return false;
  }
  return parse_can_link(text, link, error);
}

bool read_text(const std::string& path, std::string& text) {
  std::ifstream file(path);
  std::ostringstream all;
  all << file.rdbuf();
  text = all.str();
  return static_cast<bool>(file);
}

/// One reading, or two and the load between them.
bool observe(const Arguments& a, CanLinkState& link, double& load, std::string& error) {
  load = -1;
  if (!a.from.empty()) {
    std::string text;
    if (read_text(a.from, text)) return parse_can_link(text, link, error);
    error = "cannot read " + a.from;
    return false;
  }
  if (!ask_ip(a.interface, link, error)) return false;
  if (!link.up || link.bitrate <= 0) return true;
  const CanLinkState before = link;
  std::this_thread::sleep_for(std::chrono::duration<double>(a.seconds));
  if (!ask_ip(a.interface, link, error)) return false;
  load = can_load(before, link, a.seconds);
  return true;
}

void add_listeners(const std::string& name, std::vector<CanFinding>& findings) {
  CanListeners listeners;
  bool any = false;
  for (const char* file : {"rcvlist_all", "rcvlist_fil", "rcvlist_inv", "rcvlist_sff", "rcvlist_eff", "rcvlist_err"}) {
    std::string text;
    if (!read_text(std::string("/proc/net/can/") + file, text)) continue;
    any = true;
    count_can_listeners(file, text, name, listeners);
  }
  if (any) findings.push_back(describe_can_listeners(listeners));
}

/// Demands of the robot file on the bus: FD for some drives; at most so many frames a motor and one for the board.
bool read_demand(const Arguments& a, CanDemand& demand, std::string& interface) {
  demand.fd = a.fd;
  if (a.robot.empty()) return true;
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return false;
  const Words fd = actuators_with(kNeedsFd);
  for (const DriveSection& drive : robot->transport.drives) demand.fd = demand.fd || index_of(fd, drive.actuator) >= 0;
  demand.frames_per_tick = ActuatorProtocol::kMaxFrames * static_cast<std::int64_t>(robot->names.inputs.size()) + 1;
  if (interface.empty()) interface = robot->transport.interface;
  return true;
}

int doctor(Arguments a) {
  CanDemand demand;
  if (!read_demand(a, demand, a.interface)) return kExitBadInput;
  if (a.interface.empty() && a.from.empty()) return complain("name an interface, or a robot file by --robot");
  if (a.from.empty() && !is_name(a.interface)) return complain("'" + a.interface + "' is no name of an interface");
  CanLinkState link;
  std::string error;
  double load = -1;
  if (!observe(a, link, load, error)) return complain(error);
  std::vector<CanFinding> findings = examine_can_link(link, demand);
  if (load >= 0) findings.push_back(examine_can_load(load));
  if (a.from.empty()) add_listeners(link.name, findings);
  const std::string text = a.as_json ? can_findings_json(link.name, findings) : can_findings_text(findings);
  std::fputs(text.c_str(), stdout);
  return worst(findings) == Severity::failure ? kExitBadInput : kExitOk;
}

}  // namespace

void add_can_command(CLI::App& app, int& exit_code) {
  auto* can = app.add_subcommand("can", "look at a CAN bus");
  can->require_subcommand(1);
  auto* command = can->add_subcommand("doctor", "what is wrong with a CAN interface, and the command that mends it");
  auto a = std::make_shared<Arguments>();
  command->add_option("INTERFACE", a->interface, "network interface, e.g. can0 (default: the robot file's)");
  command->add_option("--robot", a->robot, "robot file: what the bus will have to do");
  command->add_flag("--fd", a->fd, "CAN FD is needed (" + join(actuators_with(kNeedsFd)) + ")");
  command->add_option("--seconds", a->seconds, "how long the load is measured (default 1)")
      ->check(number_between(0.05, 600));
  command->add_option("--from", a->from, "a file with the output of `ip -details -statistics -json link show IFACE`");
  command->add_flag("--json", a->as_json, "findings as JSON");
  command->footer(
      "Examples:\n"
      "  tiller can doctor can0\n"
      "  tiller can doctor --robot robots/cart_pole.toml --json\n\n"
      "Exit codes: 0 the robot can run (perhaps with warnings); 1 it cannot, or there is no such interface.");
  command->callback([a, &exit_code] { exit_code = doctor(*a); });
}

}  // namespace tiller::tools
