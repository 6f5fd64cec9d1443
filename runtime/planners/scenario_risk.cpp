#include "planners/scenario_risk.hpp"

#include <cmath>
#include <limits>

namespace tiller {
namespace {

constexpr double kFirstRate = 1.0, kLeastRate = 0.02;
constexpr double kLeastScale = 0.05;  // of the mean cost: ties do not make the steps endless

}  // namespace

double ScenarioRisk::tail() const {
  if (settings_->risk == tiller_risk_worst) return 1.0;  // of scenarios that are alike
  if (settings_->risk != tiller_risk_cvar) return count_;
  return (1.0 - settings_->cvar_alpha) * count_;
}

void ScenarioRisk::begin(std::uint32_t count) {
  count_ = count;
  rate_ = kFirstRate;
  for (std::uint32_t j = 0; j < count; ++j) {
    weight_[j] = 1.0 / count;
    likelihood_[j] = 1.0;
    last_change_[j] = 0.0;
  }
}

bool ScenarioRisk::take_likelihoods(const double* relative) {
  bool news = false;
  for (std::uint32_t j = 0; j < count_; ++j) {
    news = news || likelihood_[j] != relative[j];
    likelihood_[j] = relative[j];
  }
  if (!news) return false;
  for (std::uint32_t j = 0; j < count_ && mean(); ++j) weight_[j] = likelihood_[j] / count_;
  if (!mean()) project(weight_);
  return true;
}

double ScenarioRisk::value(const double* cost) const {
  double sorted[TILLER_MAX_SCENARIOS], likelihood[TILLER_MAX_SCENARIOS];
  for (std::uint32_t j = 0; j < count_; ++j) {
    if (!std::isfinite(cost[j])) return std::numeric_limits<double>::infinity();
    std::uint32_t at = j;  // insertion, costliest first
    for (; at > 0 && sorted[at - 1] < cost[j]; --at) {
      sorted[at] = sorted[at - 1];
      likelihood[at] = likelihood[at - 1];
    }
    sorted[at] = cost[j];
    likelihood[at] = likelihood_[j];
  }
  if (settings_->risk == tiller_risk_worst) return sorted[0];
  double left = tail(), sum = 0.0;
  for (std::uint32_t j = 0; j < count_ && left > 0.0; ++j) {
    sum += (left < likelihood[j] ? left : likelihood[j]) * sorted[j];
    left -= likelihood[j];
  }
  return sum / tail();
}

/// Of the worst case all; a scenario that is not likely at all is none.
double ScenarioRisk::most_weight(std::uint32_t j) const {
  if (settings_->risk == tiller_risk_worst) return likelihood_[j] > 0.0 ? 1.0 : 0.0;
  return tail() > likelihood_[j] ? likelihood_[j] / tail() : 1.0;
}

/// Nearest point of {0 <= w <= bounds, sum w = 1}: w - t cut to the bounds, t by bisection.
void ScenarioRisk::project(double* w) const {
  double low = w[0], high = w[0];
  for (std::uint32_t j = 1; j < count_; ++j) {
    low = std::fmin(low, w[j]);
    high = std::fmax(high, w[j]);
  }
  low -= 1.0;
  for (int i = 0; i < 60; ++i) {
    const double t = 0.5 * (low + high);
    double sum = 0.0;
    for (std::uint32_t j = 0; j < count_; ++j) sum += std::fmin(std::fmax(w[j] - t, 0.0), most_weight(j));
    (sum > 1.0 ? low : high) = t;
  }
  for (std::uint32_t j = 0; j < count_; ++j) w[j] = std::fmin(std::fmax(w[j] - high, 0.0), most_weight(j));
}

double ScenarioRisk::update(const double* cost) {
  if (mean() || count_ < 2) return 0.0;
  double low = cost[0], high = cost[0], sum = 0.0;
  for (std::uint32_t j = 0; j < count_; ++j) {
    if (!std::isfinite(cost[j])) return 0.0;
    low = std::fmin(low, cost[j]);
    high = std::fmax(high, cost[j]);
    sum += cost[j];
  }
  const double scale = std::fmax(high - low, kLeastScale * std::fabs(sum) / count_);
  if (!(scale > 0.0)) return 0.0;
  double next[TILLER_MAX_SCENARIOS], most = 0.0, along = 0.0;
  for (std::uint32_t j = 0; j < count_; ++j) next[j] = weight_[j] + rate_ * (cost[j] - low) / scale;
  project(next);
  for (std::uint32_t j = 0; j < count_; ++j) {
    const double change = next[j] - weight_[j];
    along += change * last_change_[j];
    most = std::fmax(most, std::fabs(change));
    last_change_[j] = change;
    weight_[j] = next[j];
  }
  // weights that turn back overshot: the fixed point is between
  if (along < 0.0) rate_ = std::fmax(kLeastRate, 0.5 * rate_);
  return most;
}

}  // namespace tiller
