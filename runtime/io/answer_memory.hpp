#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// The answer to the newest measurement of a plant in lockstep, which stands still until it has it.
///
/// Such a plant repeats a measurement whose answer does not come. What was lost is either the measurement, which then
/// is new here, or the answer, which then is sent again: the same command, not another tick. A repetition is known by
/// its sequence and stamp together, so that a restarted plant's first measurement is none.
class AnswerMemory {
 public:
  /// A measurement was accepted, and the next command answers it.
  void ask(std::uint32_t sequence, std::int64_t stamp_us) {
    sequence_ = sequence;
    stamp_us_ = stamp_us;
    asked_ = true;
    answered_ = false;
  }

  /// A command goes out: the first one since ask() is the answer, the others belong to ticks without a measurement.
  void note(const tiller_command_t& command) {
    if (!asked_ || answered_) return;
    answer_ = command;
    answered_ = true;
  }

  bool is_repeated(std::uint32_t sequence, std::int64_t stamp_us) const {
    return asked_ && sequence == sequence_ && stamp_us == stamp_us_;
  }

  /// Null while the tick that answers has not ended.
  const tiller_command_t* answer() const { return answered_ ? &answer_ : nullptr; }

 private:
  bool asked_ = false, answered_ = false;
  std::uint32_t sequence_ = 0;
  std::int64_t stamp_us_ = 0;
  tiller_command_t answer_{};
};

}  // namespace tiller
