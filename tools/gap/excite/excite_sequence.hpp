#pragma once

#include <cstdint>
#include <vector>

#include "core/rng.hpp"
#include "tiller/tiller.h"

namespace tiller::tools::gap {

struct InputRange {
  double low = 0, high = 0, rate_per_s = 0, rest = 0;  ///< rest: what it begins and ends with
};

/// Inputs, each in force for a period.
struct InputSequence {
  double period_s = 0;
  std::uint32_t inputs = 0;
  std::vector<double> value;  ///< (points x nu)
  std::size_t points() const { return inputs ? value.size() / inputs : 0; }
  double seconds() const { return period_s * static_cast<double>(points()); }
};
std::vector<double> rms_of(const InputSequence& sequence, const std::vector<InputRange>& range);

/// The shape of a stretch of a sequence.
enum class Shape : std::uint32_t { multisine, chirp, steps, square, hold_release, ramp, count };
constexpr std::uint32_t kShapes = static_cast<std::uint32_t>(Shape::count);

/// One stretch of one input, all but the shape in [0, 1].
struct Gene {
  Shape shape = Shape::multisine;
  double amplitude = 0.5;         ///< share of the range, logarithmic from kSmallest on
  double offset = 0.5;            ///< of the middle
  double slow = 0.3, fast = 0.7;  ///< frequencies, logarithmic
  double pattern = 0.5;           ///< random phases and levels
};
constexpr int kGeneNumbers = 5;
double& number_of(Gene& gene, int i);

/// The choices that make a sequence: (stretches x nu) genes.
struct SequenceCode {
  std::vector<Gene> genes;
};

/// Stretches that `seconds` are cut into.
std::uint32_t stretches_of(double seconds);
/// Within range and rate; begins and ends with the input at rest.
InputSequence express(const SequenceCode& code, const std::vector<InputRange>& range, double period_s, double seconds);
/// Twelve lines from 0.2 Hz to 4 Hz (less where the period is long), phases by Schroeder (1970), with the root mean
/// square given (nu); where that exceeds the range it is cut.
InputSequence default_multisine(const std::vector<InputRange>& range, const std::vector<double>& rms, double period_s,
                                double seconds);
/// The sequence's distance from rest times `share`.
InputSequence scaled(const InputSequence& sequence, const std::vector<InputRange>& range, double share);

}  // namespace tiller::tools::gap
