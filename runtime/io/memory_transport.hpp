#pragma once

#include <atomic>
#include <cstdint>

#include "tiller/transport.h"

namespace tiller {

/// A queue for one producer and one consumer thread, without locks.
template <class T, std::uint32_t kSlots>
class SpscQueue {
 public:
  /// False when full.
  bool put(const T& item) {
    const std::uint32_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == kSlots) return false;
    slots_[tail % kSlots] = item;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  /// False when empty.
  bool take(T& item) {
    const std::uint32_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    item = slots_[head % kSlots];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

 private:
  static_assert((kSlots & (kSlots - 1)) == 0, "the indices wrap at 2^32");
  T slots_[kSlots];
  std::atomic<std::uint32_t> head_{0}, tail_{0};
};

/// A transport inside one process: a plant in the same program, or a test. The plant's side may be another
/// thread. Nothing is checked on the way, so that tests can feed what a real transport would refuse.
struct MemoryTransport {
  static constexpr std::uint32_t kSlots = 64;

  SpscQueue<tiller_measurement_t, kSlots> measurements;
  SpscQueue<tiller_command_t, kSlots> commands;
  std::atomic<int> fault{tiller_status_ok};
  tiller_transport_counters_t counters{};
};

/// The table for a MemoryTransport; there is nothing to open.
extern const tiller_transport_t kMemoryTransport;

/// The plant's side. False: the queue is full, the measurement was dropped.
bool memory_put_measurement(MemoryTransport* transport, const tiller_measurement_t& measurement);
/// The oldest command not yet taken; false if there is none.
bool memory_take_command(MemoryTransport* transport, tiller_command_t& command);
/// From now on poll reports this fault; ok ends it.
void memory_set_fault(MemoryTransport* transport, tiller_status_t fault);

}  // namespace tiller
