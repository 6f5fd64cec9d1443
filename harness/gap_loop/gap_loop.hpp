#pragma once

// Worth of the new robot file: a cart-pole tracks a reference with the model it was given, `tiller gap` reads that
// run's logs and names what is hidden in the plant, and the same controller tracks again with the effect in its model.

#include <cstdint>
#include <string>

#include "tools/gap/pipeline/gap.hpp"

namespace tiller::bench {

/// The effect that the plant has and the first robot file lacks.
enum class HiddenEffect { dry_friction, delay };
const char* hidden_name(HiddenEffect hidden);

struct LoopCase {
  HiddenEffect hidden = HiddenEffect::dry_friction;
  std::uint64_t seed = 1;   ///< of plant, strength of the effect, sensors and controller
  std::uint32_t logs = 3;   ///< runs that gap reads
  double log_s = 10;        ///< of each
  double evaluated_s = 12;  ///< of the runs that are compared
};

struct LoopOutcome {
  double truth = 0;  ///< strength of the hidden effect, SI
  tools::gap::Verdict verdict = tools::gap::Verdict::unfit;
  std::string named;             ///< effects that were added; empty: none
  bool right = false;            ///< the kind that is hidden is the only one
  double before = 0, after = 0;  ///< mean tracking cost with the old and with the new file, same plant and noise
  double gap_before = 0, gap_after = 0;  ///< rollout error over 1 s in sigma, windows kept for the test
  bool failed = false;                   ///< a run ended in SAFE or could not begin
  std::string error;
};

/// The whole loop for one seed. Deterministic.
LoopOutcome close_loop(const LoopCase& which);

}  // namespace tiller::bench
