// The way of a measurement to a controller and of its command back, over LCM and over ROS 2's wire by turns, between
// two processes: from publishing to receiving, with a controller that answers at once. ./dev bench transports runs it
// on a loopback of its own.

#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <vector>

#include "bench/table/arguments.hpp"
#include "io/lcm_transport.hpp"
#include "io/monotonic_clock.hpp"
#include "ros2/ros2_transport.hpp"
#include "sim/plant/plant.hpp"
#include "sim/servers/serve_lcm.hpp"
#include "sim/servers/serve_ros2.hpp"

namespace tiller::bench {
namespace {

constexpr std::uint32_t kJoints = 6;
constexpr std::int64_t kLostUs = 1000000;

[[noreturn]] void fail(const char* what, const char* why) {
  std::fprintf(stderr, "bench_transports: %s: %s\n", what, why);
  std::_Exit(1);
}

void answer(const tiller_transport_t& table, void* device) {
  tiller_measurement_t measurement;
  if (table.poll(device, &measurement) != tiller_status_ok) return;
  tiller_command_t command{};
  command.sequence = measurement.sequence;
  for (std::uint32_t i = 0; i < kJoints; ++i) command.value[i] = measurement.value[i];
  (void)table.send(device, &command);
}

/// Until it is killed.
[[noreturn]] void be_the_controller() {
  static LcmTransport lcm;
  static Ros2Transport ros2;
  LcmOptions by_lcm;
  by_lcm.measurement_count = by_lcm.input_count = kJoints;
  Ros2Options by_ros2;
  by_ros2.measurement_count = by_ros2.input_count = kJoints;
  by_ros2.commands = "arm/commands";
  for (std::uint32_t i = 0; i < kJoints; ++i) {
    char source[16];
    (void)std::snprintf(source, sizeof source, "position:j%u", i);
    if (!ros2_parse_source(source, &by_ros2.source[i])) fail(source, "is no source");
  }
  OpenError error;
  if (lcm_transport_open(&lcm, by_lcm, &error) != tiller_status_ok) fail("lcm", error.text);
  if (ros2_transport_open(&ros2, by_ros2, &error) != tiller_status_ok) fail("ros2", error.text);
  for (;;) {
    pollfd wanted[] = {{kLcmTransport.descriptor(&lcm), POLLIN, 0}, {kRos2Transport.descriptor(&ros2), POLLIN, 0}};
    (void)::poll(wanted, 2, -1);
    if (wanted[0].revents != 0) answer(kLcmTransport, &lcm);
    if (wanted[1].revents != 0) answer(kRos2Transport, &ros2);
  }
}

/// Microseconds until the answer; negative: it was lost.
std::int64_t exchange(sim::PlantLink& link, sim::PlantMeasurement& m) {
  ++m.sequence;
  m.stamp_us = monotonic_us();
  const std::int64_t begin_us = monotonic_us();
  if (!link.publish(m)) fail("the plant", link.error().c_str());
  sim::PlantCommand command;
  while (monotonic_us() - begin_us < kLostUs)
    if (link.receive(command, kLostUs)) return monotonic_us() - begin_us;
  return -1;
}

double quantile_us(std::vector<std::int64_t>& sorted, double share) {
  std::sort(sorted.begin(), sorted.end());
  return static_cast<double>(sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))]);
}

struct Side {
  const char* name;
  std::unique_ptr<sim::PlantLink> link;
  sim::PlantMeasurement m{0, 0, std::vector<double>(kJoints, 0.5)};
  std::vector<std::int64_t> taken_us{};
  std::uint64_t lost = 0;
};

std::vector<Side> open_sides() {
  sim::Ros2Options ros2;
  ros2.commands = "arm/commands";
  for (std::uint32_t i = 0; i < kJoints; ++i) ros2.channels.push_back({"j" + std::to_string(i), 0});
  std::string error;
  std::vector<Side> sides;
  const auto plant = sim::Plant::make(sim::PlantOptions(), error);  // the link asks it for its latency alone
  if (plant) sides.push_back({"LCM", sim::open_lcm_link(sim::LcmOptions(), *plant, error)});
  if (error.empty()) sides.push_back({"ROS 2", sim::open_ros2_link(ros2, false, error)});
  if (!error.empty()) fail("the plant", error.c_str());
  return sides;
}

int run(int exchanges, int pause_us) {
  const pid_t controller = fork();
  if (controller == 0) be_the_controller();
  std::vector<Side> sides = open_sides();
  for (Side& side : sides)  // until both ends know each other
    for (int tries = 0; exchange(*side.link, side.m) < 0;)
      if (++tries > 30) fail(side.name, "no answer");
  for (int k = 0; k < exchanges; ++k) {
    for (Side& side : sides) {
      (void)usleep(static_cast<unsigned>(pause_us));
      const std::int64_t us = exchange(*side.link, side.m);
      if (us < 0)
        ++side.lost;
      else
        side.taken_us.push_back(us);
    }
  }
  (void)kill(controller, SIGKILL);
  (void)waitpid(controller, nullptr, 0);
  std::printf("%d joints, %d exchanges each by turns, %d us between them\n", kJoints, exchanges, pause_us);
  for (Side& side : sides)
    std::printf("  %-6s %6.0f us median, %6.0f us 99 %%, %6.0f us 99.9 %%, %6.0f us at most; %llu lost\n", side.name,
                quantile_us(side.taken_us, 0.5), quantile_us(side.taken_us, 0.99), quantile_us(side.taken_us, 0.999),
                quantile_us(side.taken_us, 1), static_cast<unsigned long long>(side.lost));
  return 0;
}

}  // namespace
}  // namespace tiller::bench

int main(int argc, char** argv) {
  return tiller::bench::run(argc > 1 ? tiller::bench::whole_number(argv[1]) : 10000,
                            argc > 2 ? tiller::bench::whole_number(argv[2]) : 1000);
}
