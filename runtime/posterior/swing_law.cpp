#include "posterior/swing_law.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Of a resonator: its band is an eighth of its frequency, about as wide as a bin.
constexpr double kQuality = 8.0;

}  // namespace

SwingLaw SwingLaw::lay_out(Arena& arena, std::uint32_t joints) {
  SwingLaw law;
  law.joints_ = joints;
  for (double** row : {&law.share_, &law.along_, &law.across_, &law.gain_}) *row = arena.take<double>(kBins);
  law.mean_ = arena.take<double>(joints);
  law.resonator_ = arena.take<double>(std::size_t{joints} * kBins * 2);
  return law;
}

void SwingLaw::begin(const PriorDistribution& prior, std::uint32_t time, std::uint32_t sizes, double period_s) {
  time_ = time;
  sizes_ = sizes;
  low_ = prior.low(time + 1);
  width_ = (prior.high(time + 1) - low_) / kBins;
  seen_ = 0.0;
  std::memset(mean_, 0, sizeof(double) * joints_);
  std::memset(resonator_, 0, sizeof(double) * joints_ * kBins * 2);
  for (std::uint32_t k = 0; k < kBins; ++k) {
    const double turn = period_s * math::exp(low_ + (k + 0.5) * width_), left = math::exp(-turn / kQuality);
    along_[k] = left * math::cos(turn);
    across_[k] = left * math::sin(turn);
    gain_[k] = turn * turn;
    share_[k] = 1.0 / kBins;
  }
}

void SwingLaw::observe(const double* force) {
  double power[kBins] = {}, all = 0.0;
  seen_ += 1.0;
  for (std::uint32_t j = 0; j < joints_; ++j) {
    mean_[j] += (force[j] - mean_[j]) / seen_;  // what stays is no swing
    double* z = resonator_ + std::size_t{j} * kBins * 2;
    for (std::uint32_t k = 0; k < kBins; ++k, z += 2) {
      const double real = along_[k] * z[0] - across_[k] * z[1] + force[j] - mean_[j];
      z[1] = across_[k] * z[0] + along_[k] * z[1];
      z[0] = real;
      power[k] += gain_[k] * (z[0] * z[0] + z[1] * z[1]);
    }
  }
  for (double p : power) all += p;
  if (!(all > 0.0 && std::isfinite(all))) return;
  for (std::uint32_t k = 0; k < kBins; ++k) share_[k] = 0.5 / kBins + 0.5 * power[k] / all;
}

double SwingLaw::log_density(double omega) const {
  const double bin = std::clamp((omega - low_) / width_, 0.0, kBins - 1.0);
  return math::log(share_[static_cast<std::uint32_t>(bin)]);
}

double SwingLaw::step(const PriorDistribution& prior, Rng& rng, const double* present, double* to) const {
  std::copy(present, present + prior.dimension(), to);
  double left = rng.uniform();
  std::uint32_t bin = 0;
  while (bin + 1 < kBins && left >= share_[bin]) left -= share_[bin++];
  to[time_] = prior.low(time_) + rng.uniform() * (prior.high(time_) - prior.low(time_));
  to[time_ + 1] = low_ + (bin + rng.uniform()) * width_;
  if (rng.uniform() < 0.5)
    for (std::uint32_t j = time_ - sizes_; j < time_; ++j) to[j] += rng.normal();
  const double change =
      prior.log_density(to) - prior.log_density(present) + log_density(present[time_ + 1]) - log_density(to[time_ + 1]);
  if (std::isfinite(change)) return change;
  std::copy(present, present + prior.dimension(), to);
  return -INFINITY;
}

}  // namespace tiller
