#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/ring.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The last ticks with every input and output, and the caller's calls between them: what a replay needs.
class Recorder {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config) {
    if (config.record_ticks > 0)
      ring_ = Ring<tiller_record_t>(arena.take<tiller_record_t>(config.record_ticks), config.record_ticks);
  }

  void note_call(tiller_call_t call) {
    const std::uint32_t shift = 4 * call_count_;
    if (call_count_ < kMostCalls) calls_ |= static_cast<std::uint32_t>(call) << shift;
    // the marker takes the place of the last call: a replay must not believe that it knows all
    if (call_count_ >= kMostCalls) calls_ |= std::uint32_t{tiller_call_lost} << (4 * (kMostCalls - 1));
    ++call_count_;
  }

  void push(const tiller_record_t& record) {
    if (ring_.capacity() > 0) {
      tiller_record_t& slot = ring_.push();
      slot = record;
      slot.calls = calls_;
    }
    calls_ = 0;
    call_count_ = 0;
  }

  const tiller_record_t* find(std::uint64_t tick) const {
    return ring_.capacity() > 0 && ring_.holds(tick) ? &ring_[tick] : nullptr;
  }
  bool overwritten(std::uint64_t tick) const { return tick < ring_.begin(); }

 private:
  static constexpr std::uint32_t kMostCalls = 8;
  Ring<tiller_record_t> ring_;
  std::uint32_t calls_ = 0;
  std::uint32_t call_count_ = 0;
};

}  // namespace tiller
