#include "tools/identify/residual_pattern.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

void ResidualPattern::Sums::add(double feature, double residual) {
  if (!std::isfinite(feature) || !std::isfinite(residual)) return;
  const double f = feature, r = residual;
  n += 1, b += f, be += f * r, bee += f * r * r, bbee += f * f * r * r, e += r, ee += r * r;
}

double ResidualPattern::Sums::deviations() const {
  const double mean = b / n, variance = bbee - 2.0 * mean * bee + mean * mean * ee;
  // a feature that never changes leaves rounding errors
  if (!(n >= 2.0 * kSettling) || !(variance > 1e-12 * bbee)) return NAN;
  return (be - mean * e) / std::sqrt(variance);
}

void ResidualPattern::begin(const tiller_config_t& config) {
  *this = {};
  ny_ = config.measurement_count;
  nu_ = config.model->input_count;
  sums_.resize(std::size_t{ny_} * (2 + nu_));
}

void ResidualPattern::begin_stretch(const double* start) {
  steps_ = 0;
  std::copy_n(start, ny_, last_);
  std::fill_n(before_, ny_, NAN);
}

void ResidualPattern::add(const AdequacyTest& test, const Transition& step) {
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (steps_ >= kSettling) {
      const double e = test.residual(k);
      Sums* sums = sums_.data() + std::size_t{k} * (2 + nu_);
      sums[0].add(last_[k], e);
      sums[1].add(last_[k] - before_[k], e);
      for (std::uint32_t j = 0; j < nu_; ++j) sums[2 + j].add(step.input[j], e);
    }
    before_[k] = last_[k];
    last_[k] = step.measured[k];
  }
  ++steps_;
}

std::vector<ResidualTrend> ResidualPattern::trends() const {
  std::vector<ResidualTrend> out(ny_);
  for (std::uint32_t k = 0; k < ny_; ++k) {
    const Sums* sums = sums_.data() + std::size_t{k} * (2 + nu_);
    out[k].value = sums[0].deviations();
    out[k].change = sums[1].deviations();
    for (std::uint32_t j = 0; j < nu_; ++j) out[k].inputs.push_back(sums[2 + j].deviations());
  }
  return out;
}

}  // namespace tiller::tools
