#include "tools/gap/localise/noise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools::gap {
namespace {

constexpr std::size_t kBlock = 64;
constexpr std::size_t kFirst = 23, kLast = 31;  // of 64: 0.36 .. 0.48 of the sampling rate

struct Tables {
  double window[kBlock], cosine[kBlock], sine[kBlock], window_square = 0;
  Tables() {
    for (std::size_t k = 0; k < kBlock; ++k) {
      const double turn = 6.283185307179586 * static_cast<double>(k) / kBlock;
      const double at = turn + 3.14159265358979 / kBlock;  // Blackman and Harris (1978), sidelobes below -92 dB
      window[k] = 0.35875 - 0.48829 * std::cos(at) + 0.14128 * std::cos(2 * at) - 0.01168 * std::cos(3 * at);
      cosine[k] = std::cos(turn);
      sine[k] = std::sin(turn);
      window_square += window[k] * window[k];
    }
  }
};

// Spectral density of a block at the upper frequencies, the line through it taken off first.
void add_ordinates(const double* x, const Tables& t, std::vector<double>& out) {
  double mean = 0, slope = 0, square = 0;
  for (std::size_t k = 0; k < kBlock; ++k) {
    const double at = static_cast<double>(k) - 0.5 * (kBlock - 1);
    mean += x[k] / kBlock;
    slope += at * x[k];
    square += at * at;
  }
  slope /= square;
  for (std::size_t f = kFirst; f <= kLast; ++f) {
    double real = 0, imaginary = 0;
    for (std::size_t k = 0; k < kBlock; ++k) {
      const double at = static_cast<double>(k) - 0.5 * (kBlock - 1);
      const double value = t.window[k] * (x[k] - mean - slope * at);
      real += value * t.cosine[f * k % kBlock];
      imaginary += value * t.sine[f * k % kBlock];
    }
    out.push_back((real * real + imaginary * imaginary) / t.window_square);
  }
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The step of which all changes are multiples; 0 where they are not.
double quantisation(const std::vector<std::vector<double>>& readings) {
  std::vector<double> change;
  double largest = 0;
  for (const auto& x : readings)
    for (std::size_t k = 1; k < x.size(); ++k) {
      const double d = std::fabs(x[k] - x[k - 1]);
      if (std::isfinite(x[k])) largest = std::max(largest, std::fabs(x[k]));
      if (std::isfinite(d) && d > 0) change.push_back(d);
    }
  if (change.size() < 20) return 0;
  const double tiny = 1e-9 * largest;  // what text of nine digits cannot tell from zero
  change.erase(std::remove_if(change.begin(), change.end(), [tiny](double d) { return d <= tiny; }), change.end());
  if (change.size() < 20) return 0;
  const double step = *std::min_element(change.begin(), change.end());
  std::size_t multiples = 0;
  for (const double d : change) {
    const double ratio = d / step;
    multiples += ratio < 1e4 && std::fabs(ratio - std::round(ratio)) < 0.02 * std::max(1.0, ratio / 50) ? 1 : 0;
  }
  return static_cast<double>(multiples) > 0.95 * static_cast<double>(change.size()) ? step : 0;
}

}  // namespace

NoiseEstimate estimate_noise(const std::vector<std::vector<double>>& readings) {
  static const Tables tables;
  std::vector<double> ordinates;
  for (const auto& x : readings) {
    std::size_t known = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
      known = std::isfinite(x[k]) ? known + 1 : 0;
      if (known < kBlock) continue;
      add_ordinates(x.data() + k + 1 - kBlock, tables, ordinates);
      known = kBlock / 2;  // blocks overlap by half
    }
  }
  NoiseEstimate result;
  result.sd = std::numeric_limits<double>::quiet_NaN();
  result.step = quantisation(readings);
  if (ordinates.empty()) return result;
  result.sd = std::max(std::sqrt(median(ordinates) / 0.6931471805599453), result.step / std::sqrt(12.0));
  return result;
}

}  // namespace tiller::tools::gap
