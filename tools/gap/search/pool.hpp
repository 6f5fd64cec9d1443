#pragma once

#include <cstdint>
#include <vector>

#include "tools/gap/search/screen.hpp"

namespace tiller::tools::gap {

/// Every set of effects that was fitted to the working windows, the nominal model first, each once.
class Pool {
 public:
  static constexpr std::size_t kNone = SIZE_MAX;
  explicit Pool(Session& session) : session_(session) {}

  std::vector<Candidate> entries;

  Candidate& nominal() { return entries[0]; }
  std::size_t find(const std::vector<EffectAt>& effects) const;
  /// Fits and whitens the nominal model.
  void begin();
  /// The best `keep` sets of a screen: fitted, and decided upon where they are near the best.
  void consider(std::vector<Candidate> screened, std::size_t keep);
  /// The set without one member, fitted where it has not been yet; kNone where it cannot be.
  std::size_t without(std::size_t index, std::size_t member);
  /// To the end and decided upon, whatever it was.
  void settle(std::size_t index);
  /// Sets of `effects` members that fit best, best first; at most `width`.
  std::vector<std::size_t> beam(std::size_t effects, std::size_t width) const;
  /// The screen's view of a set: its cost on the screen's windows in coarse steps.
  double screened_now(std::size_t index);

  // ---- choice (choice.cpp) ----
  /// Lowest held-out cost, two nats counted for each parameter, of sets of at most `most` effects.
  std::size_t leader(std::size_t most = SIZE_MAX) const;
  /// The leader, or the simplest of its special cases that the data do not tell from it.
  std::size_t choose(std::size_t most = SIZE_MAX);
  /// Whether `a`, a set of `level` effects, is worth more than `b`: significantly, or no worse with no more parameters.
  bool better(std::size_t a, std::size_t b, std::size_t level);
  /// Candidates that cannot be told from `best`, itself first.
  std::vector<std::size_t> rivals(std::size_t best);

 private:
  double enough_for(const Candidate& e) const;
  /// It was decided upon and foresees no more than the nominal model.
  bool refuted(std::size_t index) const;
  void decide_near();
  bool simpler_than(std::size_t simple, std::size_t rich);

  Session& session_;
};

}  // namespace tiller::tools::gap
