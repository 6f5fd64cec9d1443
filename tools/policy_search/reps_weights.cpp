#include "tools/policy_search/reps_weights.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools {
namespace {

struct Costs {
  double least = std::numeric_limits<double>::infinity(), most = -std::numeric_limits<double>::infinity();
  std::size_t count = 0, ties = 0;  // finite ones; those equal to the least
};

Costs survey(const std::vector<double>& cost) {
  Costs c;
  for (const double v : cost) {
    if (!std::isfinite(v)) continue;
    ++c.count;
    if (v < c.least) c.ties = 0;
    c.ties += v <= c.least ? 1 : 0;
    c.least = std::min(c.least, v);
    c.most = std::max(c.most, v);
  }
  return c;
}

// Weights at eta; returns their KL divergence from equal ones.
double weigh(const std::vector<double>& cost, const Costs& c, double eta, std::vector<double>& weight) {
  double sum = 0, mean = 0;
  for (std::size_t i = 0; i < cost.size(); ++i) {
    weight[i] = 0;
    if (!std::isfinite(cost[i])) continue;
    const double exponent = eta > 0 ? -(cost[i] - c.least) / eta : (cost[i] <= c.least ? 0.0 : -1e9);
    weight[i] = std::exp(exponent);
    sum += weight[i];
    mean += weight[i] * exponent;
  }
  for (double& w : weight) w /= sum;
  return mean / sum - std::log(sum / static_cast<double>(c.count));
}

}  // namespace

bool reps_weights(const std::vector<double>& cost, double epsilon, RepsWeights& result) {
  const Costs c = survey(cost);
  result = {};
  result.weight.assign(cost.size(), 0.0);
  if (c.count == 0 || !(epsilon > 0)) return false;
  if (epsilon >= std::log(static_cast<double>(c.count) / static_cast<double>(c.ties))) {
    result.slack = true;
    result.kl = weigh(cost, c, 0.0, result.weight);
    return true;
  }
  // KL <= (range / eta)^2 / 8 (Hoeffding's lemma), so the root lies below this
  double high = (c.most - c.least) / std::sqrt(8 * epsilon), low = high;
  while (weigh(cost, c, low, result.weight) < epsilon) {
    low *= 0.5;
    if (low < std::numeric_limits<double>::min()) break;  // ties up to rounding: as good as slack
  }
  for (int i = 0; i < 100 && high - low > 1e-15 * high; ++i) {
    const double middle = std::sqrt(low) * std::sqrt(high);
    (weigh(cost, c, middle, result.weight) < epsilon ? high : low) = middle;
  }
  result.temperature = high;  // the side on which the bound is kept
  result.kl = weigh(cost, c, high, result.weight);
  return true;
}

}  // namespace tiller::tools
