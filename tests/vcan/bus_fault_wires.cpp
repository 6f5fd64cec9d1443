#include "bus_fault_wires.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <sstream>

namespace tiller::faults {
namespace {

bool changed = true;

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
  Fault fault{name, group, what, Road::kSocket, end, timeout, answer};
  fault.prepare = shrink;
  return fault;
}

void add_rules(const std::string& ends, const std::string& rules) {
  if (rules == "none") return;
  if (rules.empty()) return wire("cangw -A -e " + ends);
  std::istringstream all(rules);
  for (std::string rule; std::getline(all, rule, ';');) wire("cangw -A -e " + ends + " " + rule);
}

}  // namespace

void wire(const std::string& command) {
  changed = true;
  if (std::system(command.c_str()) == 0) return;
  std::fprintf(stderr, "failed: %s\n", command.c_str());
  SocketLink::report("a command of ip, tc or cangw failed");
}

void restore_wires() {
  if (!changed) return;
  // what is not there to be removed is no error
  (void)!std::system(
      "for i in vx0 vx1 vcan0; do tc qdisc del dev $i root; done 2>/dev/null; cangw -F 2>/dev/null;"
      "ip link show vx1 >/dev/null 2>&1 || ip link add vx0 type vxcan peer name vx1;"
      "for i in vx0 vx1 vcan0 vcan1; do ip link set $i up; done");
  changed = false;
}

void netem(const char* interface, const std::string& what) {
  wire(std::string("tc qdisc replace dev ") + interface + " root netem " + what);
}

std::string wall_time(double periods) {
  return std::to_string(std::llround(1e-3 * periods * static_cast<double>(SocketLink::current().period_wall_us()))) +
         "ms";
}

void shrink(Setup& setup) {
  tiller_config_t& c = setup.config;
  c.posterior.particles = 16;
  c.posterior.moves_per_tick = 0;
  c.planner.horizon = 20;
  c.planner.knots = 4;
  c.planner.rollouts = 16;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  setup.plant.step_s = 0.001;
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
  wire("cangw -F");
  add_rules("-s vx1 -d vcan1", readings);
  add_rules("-s vcan1 -d vx1", commands);
}

const std::vector<Fault>& socket_faults() {
  static const std::vector<Fault> all = [] {
    std::vector<Fault> list;
    for (const auto& part : {queue_faults(), interface_faults(), frame_faults(), gateway_faults()})
      list.insert(list.end(), part.begin(), part.end());
    return list;
  }();
  return all;
}

}  // namespace tiller::faults
