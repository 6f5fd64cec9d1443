#pragma once

#include <cstdint>
#include <vector>

#include "posterior/posterior.hpp"

namespace tiller::tools {

/// What was known part of the way through the logs.
struct Snapshot {
  std::uint64_t transitions = 0;        ///< taken in so far; 0: the prior
  double data_s = 0;                    ///< seconds of data taken in, gaps and what lies between logs left out
  std::vector<double> mean, low, high;  ///< (np), 5 % and 95 %
  double effective_samples = 0, noise_scale = 1, exponent = 1;
  double acceptance = 0;  ///< of moves, running mean
};

/// The posterior while logs are taken in, at no more than kMost points: densely at first, where most is learnt, then
/// evenly. Methods that take all logs at once leave it empty.
class History {
 public:
  static constexpr std::uint64_t kMost = 400;
  /// For `transitions` transitions of `np` parameters in all; begins with the prior.
  void begin(const Posterior& prior, std::uint32_t np, std::uint64_t transitions);
  void begin_stretch() { stretches_s_.push_back(data_s_); }
  /// After every transition. Costs a comparison, at a snapshot 3 quantiles per parameter.
  void add(const Posterior& posterior, double period_s);

  const std::vector<Snapshot>& snapshots() const { return snapshots_; }
  /// Seconds of data at which each stretch of a log begins.
  const std::vector<double>& stretches_s() const { return stretches_s_; }

 private:
  void take(const Posterior& posterior);
  std::uint64_t stride() const;

  std::vector<Snapshot> snapshots_;
  std::vector<double> stretches_s_;
  std::uint32_t np_ = 0;
  std::uint64_t all_ = 0, done_ = 0, next_ = 1;
  double data_s_ = 0;
};

}  // namespace tiller::tools
