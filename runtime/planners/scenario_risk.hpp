#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Risk over the whole-trajectory costs of M scenarios, and the weights under which a gradient planner sees them.
///
/// CVaR is a maximum over weights: max w'c with 0 <= w_j <= M p_j / tail, sum w_j = 1, of scenarios that are as likely
/// as p_j (Rockafellar and Uryasev 2000; alike, the mean has tail M, the worst case tail 1). At the optimum several
/// scenarios usually cost the same, and the weights that the ranking gives jump between them. So the weights are
/// carried from iteration to iteration and take a proximal step, w <- project(w + rate c), on the costs that their own
/// solution leads to: dual ascent, whose fixed points are the saddle points of the problem, with the weights between
/// the extremes that make the tied scenarios balance.
class ScenarioRisk {
 public:
  void lay_out(const tiller_planner_config_t& settings) { settings_ = &settings; }
  /// Starts again for `count` scenarios that are alike, all weights equal.
  void begin(std::uint32_t count);
  /// How likely the scenarios are, times their number: 1 where alike. Weights of the mean become these, others are
  /// brought within their new bounds. True if that is news.
  bool take_likelihoods(const double* relative);
  /// Of scenario j, times their number.
  double likelihood(std::uint32_t j) const { return likelihood_[j]; }
  std::uint32_t count() const { return count_; }
  bool mean() const { return settings_->risk == tiller_risk_mean; }
  /// Exact risk of the costs (M); infinity where one is not finite.
  double value(const double* cost) const;
  /// The proximal step; returns the largest change of a weight. Nothing for the mean.
  double update(const double* cost);
  const double* weight() const { return weight_; }

 private:
  double tail() const;
  double most_weight(std::uint32_t j) const;
  void project(double* w) const;

  const tiller_planner_config_t* settings_ = nullptr;
  std::uint32_t count_ = 0;
  double weight_[TILLER_MAX_SCENARIOS] = {};
  double likelihood_[TILLER_MAX_SCENARIOS] = {};  // times the number of scenarios
  double last_change_[TILLER_MAX_SCENARIOS] = {};
  double rate_ = 0.0;  // in shares of the costs' scale
};

}  // namespace tiller
