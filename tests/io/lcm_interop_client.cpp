// lcm_interop_client URL COUNT [KEY_FILE]: answers COUNT measurements through the runtime's own codec. See
// lcm_interop_test.py.
#include <poll.h>

#include <cstdio>
#include <cstdlib>

#include "io/key_file.hpp"
#include "io/lcm_transport.hpp"

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  tiller::LcmOptions options;
  options.url = argv[1];
  options.measurement_count = 2;
  options.input_count = 1;
  tiller::OpenError error;
  std::uint8_t key[tiller::MessageSeal::kKeyBytes];
  if (argc > 3) {
    if (tiller::read_key_file(argv[3], key, &error) != tiller_status_ok) {
      std::fprintf(stderr, "%s\n", error.text);
      return 1;
    }
    options.key = key;
  }
  static tiller::LcmTransport transport;
  if (tiller::lcm_transport_open(&transport, options, &error) != tiller_status_ok) {
    std::fprintf(stderr, "%s\n", error.text);
    return 1;
  }
  std::printf("ready\n");
  std::fflush(stdout);
  const auto count = static_cast<std::uint64_t>(std::atoll(argv[2]));
  while (transport.counters.received < count) {
    tiller_measurement_t measurement;
    if (tiller::kLcmTransport.poll(&transport, &measurement) != tiller_status_ok) {
      pollfd wanted = {tiller::kLcmTransport.descriptor(&transport), POLLIN, 0};
      if (::poll(&wanted, 1, 30000) <= 0) return 1;
      continue;
    }
    tiller_command_t command{};
    command.stamp_us = measurement.stamp_us;
    command.sequence = measurement.sequence;
    command.state = tiller_state_active;
    command.value[0] = 0.5 * measurement.value[0];
    command.plan_sequence = measurement.sequence + 7;
    if (tiller::kLcmTransport.send(&transport, &command) != tiller_status_ok) return 1;
  }
  const tiller_transport_counters_t& c = transport.counters;
  if (options.key != nullptr) std::printf("challenged=%llu ", static_cast<unsigned long long>(transport.challenged));
  std::printf("received=%llu bad=%llu old=%llu\n", static_cast<unsigned long long>(c.received),
              static_cast<unsigned long long>(c.bad_messages), static_cast<unsigned long long>(c.dropped_old));
  return 0;
}
