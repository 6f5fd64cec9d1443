#pragma once

#include <vector>

#include "harness/faults/fault_world.hpp"
#include "tiller/config.hpp"

namespace tiller::faults {

/// A configuration that does not fit: it must not become a controller at all.
struct Refusal {
  const char* name;
  const char* what;
  void (*spoil)(tiller::Config&);
  std::size_t missing_bytes = 0;  ///< of the block
  std::size_t shift_bytes = 0;    ///< of its start, away from TILLER_ALIGNMENT
};

const std::vector<Refusal>& all_refusals();

/// True when tiller_init refuses it, and leaves no controller behind.
bool is_refused(const Refusal& refusal, Robot robot);

}  // namespace tiller::faults
