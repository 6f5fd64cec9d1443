#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"

namespace tiller {

/// How far the likelihood counts in a cloud's target, prior x likelihood^exponent, and whose turn it is to move.
///
/// An exponent rises only after every particle has had a move since it last changed (the cloud has been swept):
/// particles that were only copied look like agreement, and the target outruns them. It falls where fewer than
/// ess_fraction N effective samples would be left, unless the cloud has been swept at the full exponent: that is
/// resampled, down to half as many.
class Tempering {
 public:
  void reset() {
    exponent_ = 1.0;
    acceptance_ = 0.0;
    cursor_ = moved_ = 0;
  }
  /// The particles are others, and their target is the whole one.
  void restart() {
    exponent_ = 1.0;
    moved_ = 0;
  }

  double exponent() const { return exponent_; }
  /// Share of accepted moves, running mean over about 20 ticks.
  double acceptance() const { return acceptance_; }
  std::uint64_t resamplings() const { return resamplings_; }
  bool swept(const Cloud& cloud) const { return moved_ >= cloud.n; }
  /// Swept at the full exponent since the last resampling.
  bool settled(const Cloud& cloud) const { return exponent_ == 1.0 && swept(cloud); }
  /// The next particle to move.
  std::uint32_t cursor() const { return cursor_; }
  void note_moves(const Cloud& cloud, std::uint32_t moves, std::uint32_t accepted);

  struct Choice {
    double exponent = 1.0, highest = 1.0;  // the largest one allowed, and
    WeighResult at_highest;                // the weights there
    double floor = 0.0;                    // of effective samples
  };
  /// How the search for an exponent goes: the share of the floor that is asked for, and how close it comes.
  struct Search {
    double share = 1.0, slack = 0.0;
  };
  /// base and gain: as in Cloud::set_weights; `weight` (N, nullable): those at the highest exponent, not normalised.
  Choice choose(const Cloud& cloud, const double* base, const double* gain, const Search& search,
                double* weight = nullptr) const;
  /// After the weights have been set at the exponent. True: the cloud is to be resampled; some particles may be dead.
  bool take(const Cloud& cloud, const Choice& choice, bool any_dead);
  void note_resampling() {
    moved_ = 0;
    ++resamplings_;
  }

 private:
  double exponent_ = 1.0, acceptance_ = 0.0;
  std::uint32_t cursor_ = 0;
  std::uint32_t moved_ = 0;  // since the last resampling or change of exponent, saturates at N
  std::uint64_t resamplings_ = 0;
};

}  // namespace tiller
