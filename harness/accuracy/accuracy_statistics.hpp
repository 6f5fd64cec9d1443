#pragma once

// Statistics of many runs: quantiles, rank histograms, bounds that hold for all statements of a table together.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

namespace tiller::bench {

inline double mean_of(const std::vector<double>& v) {
  return std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(v.size());
}
/// Standard error of the mean.
inline double error_of(const std::vector<double>& v) {
  const double m = mean_of(v);
  double sum = 0.0;
  for (const double x : v) sum += (x - m) * (x - m);
  return std::sqrt(sum / (static_cast<double>(v.size()) - 1.0) / static_cast<double>(v.size()));
}
/// Quantile q in [0, 1], linear between the ordered values.
inline double quantile_of(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  const double at = q * static_cast<double>(v.size() - 1);
  const std::size_t low = static_cast<std::size_t>(at), high = std::min(low + 1, v.size() - 1);
  return v[low] + (at - static_cast<double>(low)) * (v[high] - v[low]);
}

/// P(X >= value) of chi-square with `freedom` degrees: the incomplete gamma function by its series (which converges
/// for every value; the tables' values are small).
inline double chi_square_tail(double value, double freedom) {
  const double a = 0.5 * freedom, x = 0.5 * value;
  if (!(x > 0.0)) return 1.0;
  double term = 1.0 / a, sum = term;
  for (int k = 1; k < 10000 && term > 1e-17 * sum; ++k) sum += term *= x / (a + k);
  return std::max(0.0, 1.0 - sum * std::exp(-x + a * std::log(x) - std::lgamma(a)));
}

/// Hits that a binomial variable stays within, its ends included, but for at most alpha / 2 on either side.
struct Bounds {
  int low, high;
  bool hold(int hits) const { return hits >= low && hits <= high; }
};
inline Bounds binomial_bounds(int n, double p, double alpha) {
  Bounds b{0, n};
  double below = 0.0, above = 0.0;
  const auto mass = [&](int k) {
    return std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) + k * std::log(p) +
                    (n - k) * std::log(1.0 - p));
  };
  while (b.low < n && (below += mass(b.low)) <= 0.5 * alpha) ++b.low;
  while (b.high > 0 && (above += mass(b.high)) <= 0.5 * alpha) --b.high;
  return b;
}

/// Ranks of truths within their posteriors: uniform on [0, 1] where those are calibrated (Cook, Gelman, Rubin 2006).
struct Ranks {
  static constexpr int kBins = 20;
  int runs = 0, inside90 = 0, bin[kBins] = {};
  void add(double rank) {
    ++runs;
    inside90 += rank > 0.05 && rank < 0.95;
    ++bin[std::clamp(static_cast<int>(rank * kBins), 0, kBins - 1)];
  }
  double coverage() const { return static_cast<double>(inside90) / runs; }
  /// Chance of a histogram at least as uneven.
  double p_value() const {
    const double expected = static_cast<double>(runs) / kBins;
    double sum = 0.0;
    for (const int count : bin) sum += (count - expected) * (count - expected) / expected;
    return chi_square_tail(sum, kBins - 1);
  }
};

/// Statements of coverage and uniformity that are judged together: all hold in 99 % of such tables, if true.
class Family {
 public:
  void add(const Ranks& ranks) { members_.push_back(ranks); }
  int statements() const { return 2 * static_cast<int>(members_.size()); }
  int coverage_out() const {
    int out = 0;
    for (const Ranks& r : members_) out += !binomial_bounds(r.runs, 0.9, level()).hold(r.inside90);
    return out;
  }
  int uneven() const {
    int out = 0;
    for (const Ranks& r : members_) out += r.p_value() < level();
    return out;
  }

 private:
  double level() const { return 0.01 / std::max(1, statements()); }
  std::vector<Ranks> members_;
};

}  // namespace tiller::bench
