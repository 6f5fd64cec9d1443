// Run by in_network_namespace.sh. The own codec allocates nothing once it is open: not for good messages, damaged ones,
// replays, fragments, other channels, nor for what it sends. A process of its own: it takes malloc's place.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>

#include "heap_trap.hpp"
#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/lcm_transport.hpp"

namespace tiller {
namespace {

constexpr int kTicks = TILLER_TEST_SANITIZED ? 2000 : 10000;

struct Bench {
  LcmTransport transport;
  UdpMulticast plant;
  MessageSeal seal;  // of a plant that never hears a challenge
  int taken = 0, failures = 0;
};

void publish(Bench& bench, const char* channel, std::int64_t sequence, std::uint32_t cut, bool fragment) {
  std::uint8_t packet[512];
  const std::uint32_t at = lc02_begin(packet, sizeof packet, 1, channel);
  LcmMeasurement message{};
  message.stamp_us = 1000 * sequence;
  message.sequence = sequence;
  message.count = 2;
  message.valid_mask = 3;
  lcm_encode(kLcmMeasurementType, &message, packet + at);
  if (fragment) packet[3] = '3';
  std::uint32_t size = kLcmMeasurementType.bytes - cut;
  if (bench.seal.has_key() && sequence % 2 == 0) {
    bench.seal.seal(channel, packet + at, size, sequence);
    size += MessageSeal::kTrailerBytes;
  }
  bench.failures += bench.plant.send(packet, at + size) != tiller_status_ok;
}

void long_life(void* arg) {
  Bench& bench = *static_cast<Bench*>(arg);
  tiller_info_t info{};
  info.force_joints = TILLER_MAX_JOINTS;
  for (int k = 0; k < kTicks; ++k) {
    publish(bench, "TILLER_MEASUREMENT", k, 0, false);
    if (k % 3 == 0) publish(bench, "TILLER_MEASUREMENT", k + 1, 5, false);
    if (k % 5 == 0) publish(bench, "TILLER_MEASUREMENT", k - 2, 0, false);
    if (k % 7 == 0) publish(bench, "TILLER_MEASUREMENT", k + 1, 0, true);
    if (k % 2 == 0) publish(bench, "CAMERA", k + 1, 0, false);
    tiller_measurement_t measurement;
    bench.taken += kLcmTransport.poll(&bench.transport, &measurement) == tiller_status_ok;
    tiller_command_t command{};
    command.value[0] = k % 11 == 0 ? std::nan("") : 0.5;
    const tiller_status_t sent = kLcmTransport.send(&bench.transport, &command);
    bench.failures += k % 11 == 0 ? sent != tiller_status_command_not_finite : sent != tiller_status_ok;
    bench.failures += lcm_send_telemetry(&bench.transport, k, info, 4, 5) != tiller_status_ok;
  }
}

std::uint64_t heap_calls_of(Bench& bench, const std::uint8_t* key) {
  LcmOptions options;
  options.measurement_count = 2;
  options.input_count = 1;
  options.key = key;
  OpenError error;
  EXPECT_EQ(tiller_status_ok, lcm_transport_open(&bench.transport, options, &error)) << error.text;
  EXPECT_EQ(tiller_status_ok, bench.plant.open(UdpmUrl(), "NOTHING", &error)) << error.text;
  const std::uint64_t calls = tiller_test::heap_calls_in(long_life, &bench);
  kLcmTransport.close(&bench.transport);
  bench.plant.close();
  return calls;
}

TEST(LcmHeap, NothingIsAllocatedOnceItIsOpen) {
  static Bench bench;
  EXPECT_EQ(0u, heap_calls_of(bench, nullptr));
  EXPECT_EQ(0, bench.failures);
  EXPECT_EQ(kTicks, bench.taken);
  const tiller_transport_counters_t& c = bench.transport.counters;
  std::printf("received %llu, bad %llu, old %llu, sent %llu\n", static_cast<unsigned long long>(c.received),
              static_cast<unsigned long long>(c.bad_messages), static_cast<unsigned long long>(c.dropped_old),
              static_cast<unsigned long long>(c.sent));
  EXPECT_GT(c.bad_messages, static_cast<std::uint64_t>(kTicks / 3)) << "damaged ones were not even seen";
}

TEST(LcmHeap, NorWithAKey) {
  static Bench bench;
  const std::uint8_t key[MessageSeal::kKeyBytes] = {1}, secret[MessageSeal::kSecretBytes] = {2};
  bench.seal = MessageSeal(key, secret, 0);
  EXPECT_EQ(0u, heap_calls_of(bench, key));
  EXPECT_EQ(0, bench.taken) << "half of it is not signed, and the rest answers no challenge";
  EXPECT_GT(bench.transport.challenged, static_cast<std::uint64_t>(kTicks / 3));
  EXPECT_GT(bench.transport.counters.bad_messages, static_cast<std::uint64_t>(kTicks / 3));
  EXPECT_EQ(0, bench.failures);
}

TEST(LcmHeap, TheTrapCatches) {
  const auto allocate = [](void*) {
    void* volatile kept = std::malloc(7);  // a compiler may leave out a pair that nobody looks at
    std::free(kept);
  };
  void (*volatile work)(void*) = allocate;
  EXPECT_EQ(2u, tiller_test::heap_calls_in(work, nullptr));
}

}  // namespace
}  // namespace tiller
