#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/gap/excite/excite_sequence.hpp"
#include "tools/gap/excite/rival.hpp"

// `tiller excite`: which input sequence tells the remaining explanations of a gap apart, and how long to record.
//
// Were rival a true, its outputs along the inputs u would be y_a. Rival b is fitted to them, parameters and state, and
// what it still misses, whitened by sensor and process noise, is D_ab(u): half of it is the log odds in nats by which
// the record is expected to favour a. (Hunter and Reiner, Technometrics 7, 1965; Atkinson and Fedorov, "The design of
// experiments for discriminating between two rival models", Biometrika 62, 1975: T-optimality.)

namespace tiller::tools::gap {

/// A state that must stay within bounds, whichever rival is true.
struct KeepWithin {
  std::uint32_t state = 0;
  double low = 0, high = 0;
};

struct ExciteOptions {
  double seconds = 10;            ///< length of the sequence
  double target_nats = 20;        ///< log odds to record for
  std::vector<InputRange> range;  ///< (nu) inputs are kept within; empty: the robot file's [limits]
  std::vector<KeepWithin> keep;
  std::uint32_t population = 48, rounds = 20;  ///< of the search
  std::uint64_t seed = 1;
  std::function<void(const char* step, double share)> progress;  ///< may be empty
  const volatile int* stop = nullptr;                            ///< set by Ctrl-C: the best so far
};

/// How well a sequence tells two rivals apart.
struct Separation {
  std::size_t a = 0, b = 0;  ///< rivals
  bool nested = false;       ///< a can do what b does: only a's being true can be shown
  double nats = 0;           ///< expected log odds over one sequence, the smaller of both directions
  double baseline_nats = 0;  ///< the same of the default multisine of equal root mean square
  double best_nats = 0;      ///< by whichever sequence of the search was the best for this pair
  double seconds = 0;        ///< to record for the target; infinite where it is not separable
  bool separable = true;
  std::string advice;  ///< where it is not: the experiment or sensor that would
};

struct Proposal {
  InputSequence sequence;
  std::vector<double> rms;                    ///< (nu)
  std::vector<Separation> pairs;              ///< every unordered pair of rivals
  std::vector<std::vector<double>> outputs;   ///< (points x ny) of the first rival
  std::vector<double> state_low, state_high;  ///< (nx) reached by any rival or prior draw
  double record_s = 0;                        ///< so that every separable pair reaches the target
  bool all_separable = false;
  std::size_t tried = 0;  ///< sequences
};

/// Longest recording that is called an experiment: a pair that needs more is not separable by any input.
constexpr double kLongestRecording_s = 1800;

/// The best sequence of a random search refined by the cross-entropy method (Rubinstein 1999) over steps, chirps,
/// multisines, hold-and-release and ramps. Deterministic. False with every reason in `error`: fewer than two rivals,
/// limits that leave nothing, no sequence that keeps the states within bounds.
bool propose_excitation(const std::vector<Rival>& rivals, const ExciteOptions& options, Proposal& proposal,
                        std::string& error);

/// Expected log odds of a given sequence for every pair of rivals, as in propose_excitation.
std::vector<Separation> separations(const std::vector<Rival>& rivals, const InputSequence& sequence);

}  // namespace tiller::tools::gap
