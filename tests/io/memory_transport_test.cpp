#include "io/memory_transport.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <thread>

namespace tiller {
namespace {

tiller_measurement_t numbered(std::uint32_t sequence) {
  tiller_measurement_t measurement{};
  measurement.sequence = sequence;
  measurement.value[0] = 0.5 * sequence;
  return measurement;
}

TEST(MemoryTransport, PollTakesTheNewestAndCountsTheRest) {
  auto transport = std::make_unique<MemoryTransport>();
  tiller_measurement_t measurement{};
  EXPECT_EQ(tiller_status_no_new_measurement, kMemoryTransport.poll(transport.get(), &measurement));
  for (std::uint32_t k = 0; k < 5; ++k) EXPECT_TRUE(memory_put_measurement(transport.get(), numbered(k)));
  ASSERT_EQ(tiller_status_ok, kMemoryTransport.poll(transport.get(), &measurement));
  EXPECT_EQ(4u, measurement.sequence);
  EXPECT_EQ(2.0, measurement.value[0]);
  tiller_transport_counters_t counters;
  kMemoryTransport.counters(transport.get(), &counters);
  EXPECT_EQ(5u, counters.received);
  EXPECT_EQ(4u, counters.dropped_old);
}

TEST(MemoryTransport, AFullQueueRefusesAndCounts) {
  auto transport = std::make_unique<MemoryTransport>();
  tiller_command_t command{};
  for (std::uint32_t k = 0; k < MemoryTransport::kSlots; ++k) {
    command.sequence = k;
    ASSERT_EQ(tiller_status_ok, kMemoryTransport.send(transport.get(), &command));
  }
  EXPECT_EQ(tiller_status_queue_full, kMemoryTransport.send(transport.get(), &command));
  for (std::uint32_t k = 0; k < MemoryTransport::kSlots; ++k) {
    ASSERT_TRUE(memory_take_command(transport.get(), command));
    EXPECT_EQ(k, command.sequence);
  }
  EXPECT_FALSE(memory_take_command(transport.get(), command));
}

TEST(MemoryTransport, AFaultIsReportedUntilItEnds) {
  auto transport = std::make_unique<MemoryTransport>();
  tiller_measurement_t measurement{};
  memory_put_measurement(transport.get(), numbered(1));
  memory_set_fault(transport.get(), tiller_status_bus_off);
  EXPECT_EQ(tiller_status_bus_off, kMemoryTransport.poll(transport.get(), &measurement));
  memory_set_fault(transport.get(), tiller_status_ok);
  EXPECT_EQ(tiller_status_ok, kMemoryTransport.poll(transport.get(), &measurement));
  kMemoryTransport.close(transport.get());
  EXPECT_EQ(tiller_status_transport_closed, kMemoryTransport.poll(transport.get(), &measurement));
}

TEST(MemoryTransport, APlantOnAnotherThreadLosesNothingInLockstep) {
  auto transport = std::make_unique<MemoryTransport>();
  constexpr std::uint32_t kTicks = 5000;  // on a busy machine each costs both threads a time slice
  std::thread plant([&] {
    tiller_command_t command{};
    for (std::uint32_t k = 0; k < kTicks; ++k) {
      memory_put_measurement(transport.get(), numbered(k));
      while (!memory_take_command(transport.get(), command)) std::this_thread::yield();
      ASSERT_EQ(k, command.sequence);
      ASSERT_EQ(0.25 * k, command.value[0]);
    }
  });
  tiller_measurement_t measurement{};
  for (std::uint32_t k = 0; k < kTicks; ++k) {
    while (kMemoryTransport.poll(transport.get(), &measurement) != tiller_status_ok) std::this_thread::yield();
    tiller_command_t command{};
    command.sequence = measurement.sequence;
    command.value[0] = 0.5 * measurement.value[0];
    kMemoryTransport.send(transport.get(), &command);
  }
  plant.join();
}

}  // namespace
}  // namespace tiller
