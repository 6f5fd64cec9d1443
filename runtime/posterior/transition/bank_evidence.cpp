// Which delay, which rate.

#include <cmath>

#include "posterior/transition/bank.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// A delay that is this far behind stays there: a change of the robot may bring it back within as much evidence.
constexpr double kFloor = 50.0;
/// A delay leads when it is ahead of the leader by this much: e^3 = 20 to 1, "strong" (Kass and Raftery).
constexpr double kSwitch = 3.0;
/// Share of a rate's evidence that is kept per tick: fifty ticks of it count, as long as a change may take to be seen.
constexpr double kKept = 0.98;
/// Log odds of each further rate against the first before any data: where nothing changes, a rate of .95 predicts worse
/// by some .05 nats a tick and parameter, 2.5 over those fifty ticks, and this keeps it below a hundredth.
constexpr double kLogFaster = -2.5;
/// A faster rate that predicts better by this: not by a cluster of large values, which a faster rate's wider noise
/// explains better by up to ten nats, but by a change, of which a single tick often tells more.
constexpr double kClear = 20.0;
/// Ticks that a cloud which started again has to learn in: what it predicts meanwhile is as wide as the prior, says
/// nothing of its rate, and neither counts nor is used. Twice the memory of a rate of .94, so that a slower cloud comes
/// out of it knowing more of the robot as it is now than the faster one that it takes over from.
constexpr std::uint32_t kTrial = 32;

/// Replacement for the non-finite density of a cloud that died.
constexpr double kDead = -50.0;
double finite(double log_density) { return std::isfinite(log_density) ? std::fmax(log_density, -1e6) : kDead; }

}  // namespace

void BankPosterior::forget_evidence() {
  for (double& e : delay_evidence_) e = 0.0;
  for (double& e : rate_evidence_) e = 0.0;
  for (std::uint32_t& ticks : age_) ticks = 0;
  best_delay_ = 0;
  log_predictive_ = 0.0;
  set_member_weights();
}

void BankPosterior::weigh_delays(const double* log_predictive) {
  if (delays_ == 1) return;
  double largest = -HUGE_VAL;
  for (std::uint32_t j = 0; j < delays_; ++j) {
    delay_evidence_[j] += finite(log_predictive[j]);
    largest = std::fmax(largest, delay_evidence_[j]);
  }
  std::uint32_t ahead = best_delay_;
  for (std::uint32_t j = 0; j < delays_; ++j) {
    delay_evidence_[j] = std::fmax(delay_evidence_[j] - largest, -kFloor);
    if (delay_evidence_[j] > delay_evidence_[ahead]) ahead = j;
  }
  if (delay_evidence_[ahead] - delay_evidence_[best_delay_] < kSwitch) return;
  best_delay_ = ahead;
  // what the faster clouds know was learnt with another delay
  for (std::uint32_t i = 1; i < rates_; ++i) put_on_trial(i);
}

void BankPosterior::weigh_rates(const double* log_predictive) {
  double largest = -HUGE_VAL;
  for (std::uint32_t i = 0; i < rates_; ++i) {
    if (on_trial(i)) continue;
    rate_evidence_[i] = kKept * rate_evidence_[i] + finite(log_predictive[member_of_rate(i)]);
    largest = std::fmax(largest, rate_evidence_[i]);
  }
  // who is on trial comes out of it level with the best
  for (std::uint32_t i = 0; i < rates_; ++i) rate_evidence_[i] = on_trial(i) ? 0.0 : rate_evidence_[i] - largest;
  for (std::uint32_t i = 0; i < rates_; ++i)
    if (on_trial(i)) ++age_[i];
}

bool BankPosterior::on_trial(std::uint32_t rate) const { return age_[rate] < kTrial; }

void BankPosterior::leave_what_has_changed() {
  for (std::uint32_t slow = 0; slow + 1 < rates_; ++slow) {
    bool behind = false;
    for (std::uint32_t fast = slow + 1; fast < rates_; ++fast)
      behind = behind || (!on_trial(fast) && rate_evidence_[fast] - rate_evidence_[slow] > kClear);
    if (!behind || on_trial(slow)) continue;
    restart_on_trial(slow);
    ++restarts_;
  }
}

void BankPosterior::restart_on_trial(std::uint32_t rate) {
  restart_rate(rate);
  put_on_trial(rate);
}

void BankPosterior::put_on_trial(std::uint32_t rate) {
  rate_evidence_[rate] = 0.0;
  age_[rate] = 0;
}

void BankPosterior::set_member_weights() {
  double sum = 0.0;
  for (std::uint32_t j = 0; j < delays_; ++j) sum += delay_weight_[j] = math::exp(delay_evidence_[j]);
  for (std::uint32_t j = 0; j < delays_; ++j) delay_weight_[j] /= sum;
  double largest = -HUGE_VAL;
  bool any_learnt = false;
  for (std::uint32_t i = 0; i < rates_; ++i) any_learnt = any_learnt || !on_trial(i);
  const auto log_weight = [&](std::uint32_t i) {
    if (any_learnt && on_trial(i)) return -HUGE_VAL;
    return rate_evidence_[i] + (i ? kLogFaster : 0.0);
  };
  for (std::uint32_t i = 0; i < rates_; ++i) largest = std::fmax(largest, log_weight(i));
  sum = 0.0;
  for (std::uint32_t i = 0; i < rates_; ++i) sum += rate_weight_[i] = math::exp(log_weight(i) - largest);
  for (std::uint32_t i = 0; i < rates_; ++i) rate_weight_[i] /= sum;

  // delays other than the leading one have clouds of the first rate alone
  sum = 0.0;
  for (std::uint32_t j = 0; j < delays_; ++j) weight_[j] = delay_weight_[j];
  weight_[best_delay_] = delay_weight_[best_delay_] * rate_weight_[0];
  for (std::uint32_t i = 1; i < rates_; ++i) weight_[delays_ + i - 1] = delay_weight_[best_delay_] * rate_weight_[i];
  for (std::uint32_t k = 0; k < members_; ++k) sum += weight_[k];
  leader_ = 0;
  for (std::uint32_t k = 0; k < members_; ++k) {
    weight_[k] /= sum;
    if (weight_[k] > weight_[leader_]) leader_ = k;
  }
}

}  // namespace tiller
