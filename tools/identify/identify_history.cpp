#include "tools/identify/identify_history.hpp"

#include <algorithm>

namespace tiller::tools {

void History::begin(const Posterior& prior, const tiller_config_t& config, std::uint64_t transitions) {
  *this = {};
  np_ = config.param_count;
  residuals_.resize(config.measurement_count);
  all_ = transitions;
  take(prior);
}

void History::add(const Posterior& posterior, double period_s) {
  ++done_;
  data_s_ += period_s;
  if (posterior.adequacy() != nullptr) look_at(*posterior.adequacy());
  if (done_ < next_ && done_ < all_) return;
  take(posterior);
  next_ = done_ + stride();
}

void History::look_at(const AdequacyTest& test) {
  for (std::size_t k = 0; k < residuals_.size(); ++k) {
    const double z = test.residual(static_cast<std::uint32_t>(k));
    if (!std::isfinite(z)) continue;
    Residuals& r = residuals_[k];
    r.low = std::min(r.low, z);
    r.high = std::max(r.high, z);
    r.squares += z * z;
    ++r.count;
  }
  if (alarm_.raised || test.state() != tiller_adequacy_inadequate) return;
  alarm_ = {true, data_s_, test.channel(), test.feature()};
}

void History::take_residuals(Snapshot& snapshot) {
  for (Residuals& r : residuals_) {
    const bool none = r.count == 0;
    snapshot.residual_low.push_back(none ? NAN : r.low);
    snapshot.residual_high.push_back(none ? NAN : r.high);
    snapshot.residual_rms.push_back(none ? NAN : std::sqrt(r.squares / static_cast<double>(r.count)));
    r = {};
  }
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
  take_residuals(s);
  if (posterior.adequacy() != nullptr) s.adequacy_statistic = posterior.adequacy()->statistic();
  snapshots_.push_back(std::move(s));
}

}  // namespace tiller::tools
