#pragma once

#include <cstdint>

namespace tiller::faults {

/// Outcome for damaged, repeated and reordered frames and messages of our own: `passed` of `trials` were taken for
/// genuine.
struct IntegrityRow {
  std::uint64_t trials = 0, passed = 0;
};

/// Every pattern of one and two flipped bits in the identifier and the 64 bits of a protected frame, on as many random
/// measurements as it takes for that many trials. `board`: what the runtime reads; `status`: what the plant reads.
IntegrityRow flips_of_board(std::uint64_t trials);
IntegrityRow flips_of_status(std::uint64_t trials);
/// One or two random bits of a measurement over LCM, sealed with a key.
IntegrityRow flips_of_sealed(std::uint64_t trials);

/// Protected measurements over the bus, each trial one of: the last one again, the next two in the wrong order, one
/// from up to kReplayWindow measurements ago. What was not new and in order, and was taken, has passed.
constexpr std::uint32_t kReplayWindow = 1u << 16;
IntegrityRow disorder_of_board(std::uint64_t trials);
/// The same with sealed messages.
IntegrityRow disorder_of_sealed(std::uint64_t trials);

}  // namespace tiller::faults
