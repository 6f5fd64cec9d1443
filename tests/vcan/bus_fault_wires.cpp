#include "bus_fault_wires.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <sstream>

#include "tiller/config.hpp"

namespace tiller::faults {
namespace {

// what a run has changed; each program that is started costs an emulated machine a tenth of a second
std::set<std::string> queues;
bool gateway_changed = true, links_changed = true;

std::unique_ptr<Link> cable(const Setup& setup, Device& device) {
  restore_wires();
  return std::make_unique<SocketLink>(setup, device, Wiring::kPair);
}
std::unique_ptr<Link> one_bus(const Setup& setup, Device& device) {
  restore_wires();
  return std::make_unique<SocketLink>(setup, device, Wiring::kOneBus);
}
std::unique_ptr<Link> through_gateway(const Setup& setup, Device& device) {
  restore_wires();
  gateway("", "");
  return std::make_unique<SocketLink>(setup, device, Wiring::kGateway);
}

Fault kind(const char* name, const char* group, const char* what, End end, Timeout timeout, const char* answer) {
  Fault fault{name, group, what, Route::kSocket, end, timeout, answer};
  fault.prepare = shrink;
  return fault;
}

std::string rules_for(const std::string& ends, const std::string& rules) {
  if (rules == "none") return "";
  if (rules.empty()) return " && cangw -A -e " + ends;
  std::istringstream all(rules);
  std::string text;
  for (std::string rule; std::getline(all, rule, ';');) text += " && cangw -A -e " + ends + " " + rule;
  return text;
}

}  // namespace

void wire(const std::string& command) {
  links_changed = links_changed || command.find("ip link") != std::string::npos;
  gateway_changed = gateway_changed || command.find("cangw") != std::string::npos;
  if (std::system(command.c_str()) == 0) return;
  std::fprintf(stderr, "failed: %s\n", command.c_str());
  SocketLink::report("a command of ip, tc or cangw failed");
}

void restore_wires() {
  // what is not there to be removed is no error
  if (links_changed)
    (void)!std::system(
        "ip link show vx1 >/dev/null 2>&1 || ip link add vx0 type vxcan peer name vx1;"
        "for i in vx0 vx1; do ip link set $i down; ip link set $i mtu 72; done;"  // moteus speaks CAN FD
        "for i in vx0 vx1 vcan0 vcan1; do ip link set $i up; done");
  for (const std::string& interface : queues)
    (void)!std::system(("tc qdisc del dev " + interface + " root 2>/dev/null").c_str());
  if (gateway_changed) (void)!std::system("cangw -F 2>/dev/null");
  links_changed = gateway_changed = false;
  queues.clear();
}

void netem(const char* interface, const std::string& what) {
  queues.insert(interface);
  wire(std::string("tc qdisc replace dev ") + interface + " root netem " + what);
}

std::string wall_time(double periods) {
  return std::to_string(std::llround(1e-3 * periods * static_cast<double>(SocketLink::current().period_wall_us()))) +
         "ms";
}

void shrink(Setup& setup) {
  tiller::Config& c = setup.config;
  c.posterior.particles = 16;
  c.posterior.moves_per_tick = 0;
  c.planner.horizon = 20;
  c.planner.knots = 4;
  c.planner.rollouts = 16;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  setup.plant.step_s = 0.001;
  setup.latest_onset_ticks = 50;
}

Fault on_cable(const char* name, const char* what, End end, Timeout timeout, const char* answer) {
  Fault fault = kind(name, "sockets", what, end, timeout, answer);
  fault.link = cable;
  return fault;
}
Fault on_one_bus(const char* name, const char* what, End end, Timeout timeout, const char* answer) {
  Fault fault = kind(name, "sockets", what, end, timeout, answer);
  fault.link = one_bus;
  return fault;
}
Fault behind_gateway(const char* name, const char* what, End end, Timeout timeout, const char* answer) {
  Fault fault = kind(name, "gateway", what, end, timeout, answer);
  fault.link = through_gateway;
  return fault;
}

void gateway(const std::string& readings, const std::string& commands) {
  wire("cangw -F" + rules_for("-s vx1 -d vcan1", readings) + rules_for("-s vcan1 -d vx1", commands));
}

const std::vector<Fault>& socket_faults() {
  static const std::vector<Fault> all = [] {
    std::vector<Fault> list;
    for (const auto& part :
         {queue_faults(), interface_faults(), frame_faults(), gateway_faults(), other_drive_faults()})
      list.insert(list.end(), part.begin(), part.end());
    return list;
  }();
  return all;
}

}  // namespace tiller::faults
