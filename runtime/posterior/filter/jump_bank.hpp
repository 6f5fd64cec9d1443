#pragma once

#include <cstdint>

namespace tiller {

/// Hypotheses about how one parameter has changed, a lane of a filter bank each: that it stays, that it walks at one of
/// a few rates, or that it jumped at one of a few times. Only the lanes' names, weights and ages are kept here; whoever
/// owns the filters (jumps.cpp) says how likely the data are in each.
///
/// A jump is opened every few ticks, as a copy of the likeliest filter that does not walk with the parameter's prior
/// added to its variance, so that a second jump is one after the first. Before any data one jump is expected in a run
/// as long as this one has been, at any tick of it alike: of n ticks each has the share 1 / n (the multiple model
/// filter of Willsky and Jones, IEEE TAC 21, 1976, with the change point's law of Fearnhead and Liu, JRSS B 69, 2007).
/// Where no lane is left, the two neighbouring times merge that lose least: the likelier keeps the weight of both.
class JumpBank {
 public:
  static constexpr std::uint32_t kLanes = 16;
  static constexpr std::uint32_t kStays = 0, kWalks = 4, kFirstJump = 1 + kWalks;
  static constexpr std::uint32_t kNone = kLanes;  // no lane
  /// Ticks between two jumps that are opened: what a jump does to a position within these few is below its noise.
  static constexpr std::uint32_t kEvery = 4;

  /// Jumps that lie closer together are told as one: the first filter after a large one is linear about what was
  /// before it, and takes a second start to get it right.
  static constexpr double kTogether_s = 1.0;

  struct Jump {
    double time_s = 0.0;
    double before = 0.0, variance = 0.0;  // of the coordinate, as it was
  };

  /// Forgets everything. Walks have rates whose logarithms lie evenly between `low` and `high`.
  void begin(double low, double high);
  double walk_rate(std::uint32_t walk) const { return rate_[walk]; }

  /// Counts a tick. True: a jump is to be opened.
  bool tick() { return ++ticks_ % kEvery == 0; }
  /// A lane for a jump that is opened now; `log_likelihood` (kLanes) of all data.
  std::uint32_t make_room(const double* log_likelihood, double time_s);
  /// The likeliest lane that does not walk: what a new jump begins from.
  std::uint32_t likeliest(const double* log_likelihood) const;
  std::uint32_t likeliest_jump(const double* log_likelihood) const;  // kNone: there is none
  void open(std::uint32_t lane, std::uint32_t from, const Jump& jump);
  const Jump& jump(std::uint32_t lane) const { return jump_[lane]; }

  /// Logarithms of how much likelier the data are in a walk, in jumps, than where the parameter stays.
  double walk_evidence(const double* log_likelihood) const;
  double jump_evidence(const double* log_likelihood) const;

 private:
  double log_sum(const double* log_likelihood, std::uint32_t from, std::uint32_t to) const;
  double log_ticks() const;

  std::uint64_t ticks_ = 0;
  double rate_[kWalks] = {};
  double prior_[kLanes] = {};  // logarithms; of jumps in ticks, that is before they are shared out over the run
  bool used_[kLanes] = {};
  double opened_s_[kLanes] = {};
  Jump jump_[kLanes];  // with those that are told as one, from the first of them
};

}  // namespace tiller
