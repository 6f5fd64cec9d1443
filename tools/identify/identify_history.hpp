#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "posterior/adequacy.hpp"
#include "posterior/posterior.hpp"

namespace tiller::tools {

/// The posterior part of the way through the logs.
struct Snapshot {
  std::uint64_t transitions = 0;        ///< taken in so far; 0: the prior
  double data_s = 0;                    ///< seconds of data taken in, gaps and what lies between logs left out
  std::vector<double> mean, low, high;  ///< (np), 5 % and 95 %
  double effective_samples = 0, noise_scale = 1, exponent = 1;
  double acceptance = 0;  ///< of moves, running mean
  /// (ny) one-step residuals over their predictive deviation since the snapshot before: extremes and RMS; NaN: none.
  std::vector<double> residual_low, residual_high, residual_rms;
  double adequacy_statistic = 0;  ///< largest test statistic over its threshold: above 1 the model is inadequate
};

/// The moment at which the data spoke against every value of the parameters, if there was one.
struct Alarm {
  bool raised = false;
  double data_s = 0;
  std::uint32_t channel = 0;
  tiller_feature_t feature = tiller_feature_none;
};

/// The posterior while logs are taken in, at no more than kMost points: densely at first, where most is learnt, then
/// evenly. Methods that take all logs at once leave it empty.
class History {
 public:
  static constexpr std::uint64_t kMost = 400;
  /// For `transitions` transitions in all; begins with the prior.
  void begin(const Posterior& prior, const tiller_config_t& config, std::uint64_t transitions);
  void begin_stretch() { stretches_s_.push_back(data_s_); }
  /// After every transition. Costs a comparison, at a snapshot 3 quantiles per parameter.
  void add(const Posterior& posterior, double period_s);

  const std::vector<Snapshot>& snapshots() const { return snapshots_; }
  const Alarm& alarm() const { return alarm_; }
  /// Seconds of data at which each stretch of a log begins.
  const std::vector<double>& stretches_s() const { return stretches_s_; }

 private:
  /// Of one channel since the last snapshot.
  struct Residuals {
    double low = INFINITY, high = -INFINITY, squares = 0;
    std::uint64_t count = 0;
  };
  void take(const Posterior& posterior);
  void take_residuals(Snapshot& snapshot);
  void look_at(const AdequacyTest& test);
  std::uint64_t stride() const;

  std::vector<Snapshot> snapshots_;
  std::vector<double> stretches_s_;
  std::vector<Residuals> residuals_;  // (ny)
  Alarm alarm_;
  std::uint32_t np_ = 0;
  std::uint64_t all_ = 0, done_ = 0, next_ = 1;
  double data_s_ = 0;
};

}  // namespace tiller::tools
