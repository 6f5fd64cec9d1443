#pragma once

#include "io/message_seal.hpp"

namespace tiller::faults {

/// Two ends that have met, without a clock and with secrets of their own, so that runs repeat.
inline void make_sealed_pair(const std::uint8_t* key, MessageSeal& runtime, MessageSeal& plant) {
  const std::uint8_t of_runtime[MessageSeal::kSecretBytes] = {1}, of_plant[MessageSeal::kSecretBytes] = {2};
  runtime = MessageSeal(key, of_runtime, 0);
  plant = MessageSeal(key, of_plant, 0);
  std::uint8_t challenge[MessageSeal::kTrailerBytes];
  runtime.seal("TILLER_COMMAND", challenge, 0, 0);
  (void)plant.check("TILLER_COMMAND", challenge, sizeof challenge, 0);
}

}  // namespace tiller::faults
