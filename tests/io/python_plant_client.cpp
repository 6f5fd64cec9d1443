// Balances examples/python_plant/plant.py over LCM for a given number of measurements. Run by python_plant_test.sh.
#include <poll.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "io/lcm_transport.hpp"

namespace {

// Discrete linear-quadratic gain for the masses and lengths in plant.py, at 20 ms, weights (1, 10, .1, .1) on the
// state and .1 on the force. Wrong signs, axes or units in the plant make it fall.
constexpr double kGain[4] = {-2.79, -35.95, -4.15, -7.53};

bool next_measurement(tiller::LcmTransport& transport, tiller_measurement_t& measurement) {
  while (tiller::kLcmTransport.poll(&transport, &measurement) != tiller_status_ok) {
    pollfd wanted = {tiller::kLcmTransport.descriptor(&transport), POLLIN, 0};
    if (::poll(&wanted, 1, 60000) <= 0) return false;  // the plant repeats itself until it is answered
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  const long ticks = argc > 1 ? std::strtol(argv[1], nullptr, 10) : 0;
  tiller::LcmOptions options;
  options.measurement_count = 2;
  options.input_count = 1;
  options.lockstep = true;
  tiller::LcmTransport transport;
  tiller::OpenError error;
  if (tiller::lcm_transport_open(&transport, options, &error) != tiller_status_ok) {
    std::fprintf(stderr, "%s\n", error.text);
    return 1;
  }
  tiller_measurement_t now{}, before{};
  double largest_rad = 0.0;
  for (long k = 0; k < ticks; ++k) {
    if (!next_measurement(transport, now)) {
      std::fprintf(stderr, "no measurement %ld within 30 s\n", k);
      return 1;
    }
    if (now.sequence != static_cast<std::uint32_t>(k) || now.stamp_us != 1000000 + 20000 * k) {
      std::fprintf(stderr, "measurement %ld has sequence %u and stamp %lld us\n", k, now.sequence,
                   static_cast<long long>(now.stamp_us));
      return 1;
    }
    if (k == 0) before = now;
    double force_N = 0.0;
    for (int i = 0; i < 2; ++i)
      force_N -= kGain[i] * now.value[i] + kGain[2 + i] * (now.value[i] - before.value[i]) / 0.02;
    before = now;
    if (k > ticks / 2) largest_rad = std::fmax(largest_rad, std::fabs(now.value[1]));
    tiller_command_t command{};
    command.stamp_us = now.stamp_us;
    command.sequence = now.sequence;
    command.state = tiller_state_active;
    command.value[0] = force_N;
    if (tiller::kLcmTransport.send(&transport, &command) != tiller_status_ok) return 1;
  }
  std::printf("largest angle in the second half: %.6f rad\n", largest_rad);
  // the slowest closed-loop mode shrinks by 0.978 per tick; 150 ticks leave 4 % of the 0.2 rad at the start
  return largest_rad < 0.05 ? 0 : 1;
}
