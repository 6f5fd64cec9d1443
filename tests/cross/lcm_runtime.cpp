// lcm_runtime [PREFIX]: the controller of swing_up.hpp on a robot's computer: measurements in and commands out over LCM
// by the runtime's own codec, one command for each measurement, the stamps being the time (lockstep). Ends two seconds
// after the last measurement, or after twenty without any; prints a hash over the commands.

#include <poll.h>

#include <cstdio>
#include <cstring>

#include "io/lcm_transport.hpp"
#include "swing_up.hpp"
#include "tiller/config.hpp"

namespace {

constexpr int kFirst_ms = 20000, kNext_ms = 2000;

alignas(TILLER_ALIGNMENT) unsigned char block[512u << 10];
tiller::LcmTransport transport;

bool open_transport(const char* prefix) {
  tiller::LcmOptions options;
  options.channel_prefix = prefix;
  options.measurement_count = options.input_count = 1;
  options.lockstep = true;
  tiller::OpenError problem;
  if (lcm_transport_open(&transport, options, &problem) == tiller_status_ok) return true;
  std::fprintf(stderr, "LCM: %s\n", problem.text);
  return false;
}

/// False when nothing came for `patience_ms`.
bool wait_for(tiller_measurement_t& measurement, int patience_ms) {
  while (tiller::kLcmTransport.poll(&transport, &measurement) != tiller_status_ok) {
    pollfd wanted = {tiller::kLcmTransport.descriptor(&transport), POLLIN, 0};
    if (poll(&wanted, 1, patience_ms) <= 0) return false;
  }
  return true;
}

}  // namespace

int main(int count, char** arguments) {
  const tiller::Config config = swing_up::config(swing_up::kSwingUp);
  tiller_t* t = nullptr;
  if (tiller_init(&t, &config, nullptr, block, sizeof block) != tiller_status_ok) return 1;
  if (!open_transport(count > 1 ? arguments[1] : "TILLER_")) return 1;
  (void)tiller_arm(t);
  tiller_measurement_t measurement;
  std::uint64_t hash = swing_up::kHashStart;
  std::uint32_t ticks = 0;
  for (int patience_ms = kFirst_ms; wait_for(measurement, patience_ms); patience_ms = kNext_ms) {
    tiller_command_t command;
    (void)tiller_tick(t, measurement.stamp_us, &measurement, &command);
    (void)tiller::kLcmTransport.send(&transport, &command);
    swing_up::hash_bits(hash, command.value[0]);
    ++ticks;
  }
  tiller::kLcmTransport.close(&transport);
  std::printf("%u ticks, commands %016llx\n", ticks, static_cast<unsigned long long>(hash));
  return ticks > 0 ? 0 : 1;
}
