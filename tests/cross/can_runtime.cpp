// The controller of swing_up.hpp on a robot's computer, with a drive and a sensor board on a CAN bus: a command for
// each measurement, the board's stamps being the time (lockstep). Prints a hash over the commands.
//
//   can_runtime INTERFACE PROTOCOL TICKS                       the controller; PROTOCOL: a name of actuators.def
//   can_runtime --hand-over INTERFACE PROTOCOL COMMAND ...     opens the socket, and runs COMMAND with it as descriptor
//   3
//
// The second is for a controller of another architecture: what emulates its system calls knows no options of CAN
// sockets, so a native program sets them, and the controller takes "fd:3" for its interface.

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "io/socketcan_transport.hpp"
#include "swing_up.hpp"
#include "tiller/config.hpp"

namespace {

constexpr int kPatience_ms = 60000;  // an emulator within an emulator
constexpr int kHandedOver = 3;

alignas(TILLER_ALIGNMENT) unsigned char block[512u << 10];
tiller::SocketCanTransport transport;

bool open_transport(const char* interface, const char* protocol) {
  tiller::SocketCanOptions options;
  options.interface = interface;
  options.confirm_timeout_us = 0;  // in lockstep only the order counts
  options.layout.motor_count = options.layout.channel_count = 1;
  options.layout.motors[0].node = 3;
  options.layout.motors[0].wheel_radius_m = 1.0;
  if (!tiller::find_actuator(protocol, options.layout.motors[0].drive.kind)) {
    std::fprintf(stderr, "no actuator '%s'\n", protocol);
    return false;
  }
  tiller::OpenError problem;
  if (socketcan_open(&transport, options, &problem) == tiller_status_ok) return true;
  std::fprintf(stderr, "%s\n", problem.text);
  return false;
}

tiller_status_t wait_for(tiller_measurement_t& measurement) {
  for (;;) {
    const tiller_status_t status = tiller::kSocketCanTransport.poll(&transport, &measurement);
    if (status != tiller_status_no_new_measurement) return status;
    pollfd wanted = {transport.socket, POLLIN, 0};
    if (poll(&wanted, 1, kPatience_ms) <= 0) return tiller_status_sensor_stale;
  }
}

int control(unsigned long ticks) {
  const tiller::Config config = swing_up::config(swing_up::kSwingUp);
  tiller_t* t = nullptr;
  if (tiller_init(&t, &config, nullptr, block, sizeof block) != tiller_status_ok) return 1;
  (void)tiller_arm(t);
  std::uint64_t hash = swing_up::kHashStart;
  for (unsigned long tick = 0; tick < ticks; ++tick) {
    tiller_measurement_t measurement;
    tiller_status_t status = wait_for(measurement);
    if (status == tiller_status_ok) {
      tiller_command_t command;
      (void)tiller_tick(t, measurement.stamp_us, &measurement, &command);
      status = tiller::kSocketCanTransport.send(&transport, &command);
      swing_up::hash_bits(hash, command.value[0]);
    }
    if (status == tiller_status_ok) continue;
    const char* why = socketcan_fault_text(&transport);
    std::fprintf(stderr, "tick %lu: %s\n", tick, why != nullptr ? why : tiller_status_text(status));
    return 1;
  }
  std::printf("%lu ticks, commands %016llx\n", ticks, static_cast<unsigned long long>(hash));
  const auto& bus = transport.bus_counters;
  std::fprintf(stderr, "%llu set points confirmed, %llu frames received\n",
               static_cast<unsigned long long>(bus.confirmed),
               static_cast<unsigned long long>(transport.counters.received));
  return bus.confirmed > 0 ? 0 : 1;
}

int hand_over(char** command) {
  if (dup2(transport.socket, kHandedOver) != kHandedOver) return 1;
  if (fcntl(kHandedOver, F_SETFD, 0) != 0) return 1;  // stays open in the next program
  execvp(command[0], command);
  std::perror(command[0]);
  return 1;
}

}  // namespace

int main(int count, char** arguments) {
  const bool hands_over = count > 4 && std::strcmp(arguments[1], "--hand-over") == 0;
  if (!hands_over && count != 4) return 2;
  if (!open_transport(arguments[hands_over ? 2 : 1], arguments[hands_over ? 3 : 2])) return 1;
  return hands_over ? hand_over(arguments + 4) : control(std::strtoul(arguments[3], nullptr, 10));
}
