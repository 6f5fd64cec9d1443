#include "tools/identify_history.hpp"

#include <algorithm>

namespace tiller::tools {

void History::begin(const Posterior& prior, std::uint32_t np, std::uint64_t transitions) {
  *this = {};
  np_ = np;
  all_ = transitions;
  take(prior);
}

void History::add(const Posterior& posterior, double period_s) {
  ++done_;
  data_s_ += period_s;
  if (done_ < next_ && done_ < all_) return;
  take(posterior);
  next_ = done_ + stride();
}

// A sixteenth more data each time, until the steps are even: 16 ln(even) + kMost / 2 snapshots, which is below kMost
// up to 2e7 transitions.
std::uint64_t History::stride() const {
  const std::uint64_t even = std::max<std::uint64_t>(1, 2 * all_ / kMost);
  return std::clamp<std::uint64_t>(done_ / 16, 1, even);
}

void History::take(const Posterior& posterior) {
  Snapshot s;
  s.transitions = done_;
  s.data_s = data_s_;
  double mean[TILLER_MAX_PARAMS] = {};
  posterior.moments(mean, nullptr, nullptr, nullptr);
  s.mean.assign(mean, mean + np_);
  for (std::uint32_t i = 0; i < np_; ++i) {
    s.low.push_back(posterior.quantile(i, 0.05));
    s.high.push_back(posterior.quantile(i, 0.95));
  }
  s.effective_samples = posterior.effective_samples();
  s.noise_scale = posterior.noise_scale();
  s.exponent = posterior.exponent();
  s.acceptance = posterior.acceptance();
  snapshots_.push_back(std::move(s));
}

}  // namespace tiller::tools
