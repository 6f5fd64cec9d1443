// A robot that has changed: what was learnt of it becomes one half of a new prior, beside the configured one.
//
// The change-point model of Fearnhead and Liu (JRSS B 69, 2007) with one candidate, the moment at which the adequacy
// test sounds: before it the parameters are those of the posterior, after it they are the same with probability one
// half, and drawn from the prior otherwise. A false alarm then costs little: the particles that were right predict
// better than those from the prior and soon have all the weight.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

namespace {

/// An alarm within so many ticks of learning again is no change of the robot: no parameters explain it. And who has
/// explained the data for as long has been right.
constexpr std::uint32_t kTrial = 1024;
/// Number of values that the earlier knowledge of the noise is worth from then on.
constexpr double kNoiseWorth = 20.0;

}  // namespace

void FilterPosterior::watch_change(bool resting) {
  if (!adequacy_ || !config_->posterior.relearn || resting) return;
  if (adequacy_->sounds()) {
    const bool on_trial = trial_ > 0;
    trial_ = kTrial;
    if (on_trial || !enabled_ || config_->posterior.moves_per_tick == 0 || cloud_.named == 0) return;
    relearn();
  } else if (trial_ > 0 && --trial_ == 0 && adequacy_->state() == tiller_adequacy_inadequate) {
    adequacy_->withdraw();
  }
}

void FilterPosterior::relearn() {
  ++relearned_;
  start_at_present();
  keep_cloud_as_prior();
  mix_cloud();
  std::memset(carried_.sums, 0, sizeof(double) * rows_ * n_);
  std::memset(carried_.base, 0, sizeof(double) * rows_ * n_);
  std::memset(carried_.log_likelihood, 0, sizeof(double) * n_);
  evidence_.clear();
  evidence_.believe(calm_scale_ * calm_scale_, kNoiseWorth);
  noise_scale_ = calm_scale_;
  summary_.clear();
  window_begin_ = window_.end();
  window_exact_ = true;
  exponent_ = 1.0;
  moved_ = leaves_ = 0;
  early_ = kEarly;
  begin_all_filters();
  adequacy_->restart();
  response_->begin();
}

/// Every filter goes on from where they are together: mean, mean covariance and what they disagree about.
void FilterPosterior::start_at_present() {
  const std::uint32_t about = heaviest();
  clear_start();
  keep_friction_law();
  knows_lacks_ = true;
  const InitialStateDistribution& law = start_;
  double off[kMaxFilterStates];
  const auto from_about = [&](std::uint32_t i) {
    const double* state = carried_.filter.state;
    for (std::uint32_t r = 0; r < nf_; ++r) off[r] = state[r * n_ + i] - state[r * n_ + about];
    for_quaternions(quaternions_, [&](std::uint32_t first) {
      const double* q = state + first * n_;
      const Vector3<double> d = attitude_difference(read_quaternion(q + i, n_), read_quaternion(q + about, n_));
      write_quaternion({0.0, d.x, d.y, d.z}, off + first);
    });
  };
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double w = cloud_.weight[i];
    if (!(w > 0.0)) continue;
    from_about(i);
    for (std::uint32_t r = 0; r < nf_; ++r) law.state[r] += w * off[r];
    for (std::uint32_t s = 0; s < ns_; ++s) law.effect_state[s] += w * carried_.filter.effect_state[s * n_ + i];
  }
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double w = cloud_.weight[i];
    if (!(w > 0.0)) continue;
    from_about(i);
    for (std::uint32_t r = 0; r < nf_; ++r) off[r] -= law.state[r];
    for (std::uint32_t r = 0; r < nf_; ++r)
      for (std::uint32_t c = r; c < nf_; ++c) {
        const std::uint32_t at = triangle_row(nf_, r, c);
        law.covariance[at] += w * (carried_.filter.covariance[at * n_ + i] + off[r] * off[c]);
      }
  }
  for_quaternions(quaternions_, [&](std::uint32_t first) {
    const Quaternion<double> middle = read_quaternion(carried_.filter.state + first * n_ + about, n_);
    const double* d = law.state + first;
    const Quaternion<double> q = normalised(attitude_sum(middle, {d[1], d[2], d[3]}));
    // what is added below
    write_quaternion({q.w - middle.w, q.x - middle.x, q.y - middle.y, q.z - middle.z}, law.state + first);
  });
  for (std::uint32_t r = 0; r < nf_; ++r) law.state[r] += carried_.filter.state[r * n_ + about];
  std::fill(law.measured, law.measured + ny_, NAN);
}

/// The cloud's normal law, in the place of what it was believed to be.
void FilterPosterior::keep_cloud_as_prior() {
  double covariance[kMaxCoordinates * kMaxCoordinates] = {};
  for (std::uint32_t j = 0; j < d_; ++j) {
    before_.mean[j] = 0.0;
    for (std::uint32_t i = 0; i < n_; ++i) before_.mean[j] += cloud_.weight[i] * cloud_.coordinate[j * n_ + i];
  }
  for (std::uint32_t r = 0; r < d_; ++r)
    for (std::uint32_t c = 0; c <= r; ++c)
      for (std::uint32_t i = 0; i < n_; ++i)
        covariance[r * d_ + c] += cloud_.weight[i] * (cloud_.coordinate[r * n_ + i] - before_.mean[r]) *
                                  (cloud_.coordinate[c * n_ + i] - before_.mean[c]);
  for (std::uint32_t r = 0; r < d_; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = covariance[r * d_ + c];
      for (std::uint32_t k = 0; k < c; ++k) rest -= before_.root[r * d_ + k] * before_.root[c * d_ + k];
      const double least = 1e-7 * cloud_.prior.spread(r);
      before_.root[r * d_ + c] = r == c ? std::sqrt(std::fmax(rest, least * least)) : rest / before_.root[c * d_ + c];
    }
}

/// Every other particle keeps what it knows, the others are drawn from the configured prior, with the noise's
/// coordinate that they had.
void FilterPosterior::mix_cloud() {
  cloud_.resample(tick_);
  permute_carried();
  cloud_.prior.believe_before(nullptr);
  for (std::uint32_t i = 1; i < n_; i += 2) {
    Rng rng(config_->seed, kRngPrior, (std::uint64_t{1} << 40) + relearned_ * n_ + i);
    double v[kMaxCoordinates];
    cloud_.prior.draw_one(rng, v);
    for (std::uint32_t j = cloud_.named; j < d_; ++j) v[j] = cloud_.coordinate[j * n_ + i];
    cloud_.set_coordinate(i, v);
  }
  cloud_.prior.believe_before(&before_);
}

}  // namespace tiller
