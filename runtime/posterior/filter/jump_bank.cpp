#include "posterior/filter/jump_bank.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

namespace {

double log_add(double a, double b) {
  const double high = std::fmax(a, b), low = std::fmin(a, b);
  return std::isfinite(low) ? high + math::log(1.0 + math::exp(low - high)) : high;
}

}  // namespace

void JumpBank::begin(double low, double high) {
  ticks_ = 0;
  for (bool& used : used_) used = false;
  prior_[kStays] = 0.0;
  for (std::uint32_t w = 0; w < kWalks; ++w) {
    rate_[w] = math::exp(low + (w + 0.5) / kWalks * (high - low));
    prior_[1 + w] = -math::log(static_cast<double>(kWalks));
  }
}

double JumpBank::log_ticks() const { return math::log(std::fmax(1.0, static_cast<double>(ticks_))); }

/// Times far back need not lie as close as late ones: what a merger loses is the likelihood of the less likely of two,
/// by the share of their distance in their age. Not its weight, in which an old lane counts for all that it took up:
/// late times would be merged before they can tell anything.
std::uint32_t JumpBank::make_room(const double* log_likelihood, double time_s) {
  std::uint32_t order[kLanes], count = 0;  // jumps, oldest first
  for (std::uint32_t l = kFirstJump; l < kLanes; ++l) {
    if (!used_[l]) return l;
    std::uint32_t at = count++;
    for (; at > 0 && opened_s_[order[at - 1]] > opened_s_[l]; --at) order[at] = order[at - 1];
    order[at] = l;
  }
  std::uint32_t from = kNone, into = kNone;
  double least = HUGE_VAL;
  for (std::uint32_t i = 0; i + 1 < count; ++i) {
    const std::uint32_t a = order[i], b = order[i + 1];
    const double in_a = prior_[a] + log_likelihood[a], in_b = prior_[b] + log_likelihood[b];
    const double distance_s = opened_s_[b] - opened_s_[a], age_s = time_s - opened_s_[b];
    const double loss = std::fmin(log_likelihood[a], log_likelihood[b]) + math::log(distance_s / age_s);
    if (into != kNone && !(loss < least)) continue;
    least = loss;
    into = in_a >= in_b ? a : b;
    from = in_a >= in_b ? b : a;
  }
  if (std::isfinite(log_likelihood[into]))
    prior_[into] =
        log_add(prior_[into] + log_likelihood[into], prior_[from] + log_likelihood[from]) - log_likelihood[into];
  used_[from] = false;
  return from;
}

std::uint32_t JumpBank::likeliest_jump(const double* log_likelihood) const {
  std::uint32_t best = kNone;
  for (std::uint32_t l = kFirstJump; l < kLanes; ++l)
    if (used_[l] && (best == kNone || prior_[l] + log_likelihood[l] > prior_[best] + log_likelihood[best])) best = l;
  return best;
}

std::uint32_t JumpBank::likeliest(const double* log_likelihood) const {
  const std::uint32_t best = likeliest_jump(log_likelihood);
  if (best == kNone) return kStays;
  return prior_[best] + log_likelihood[best] - log_ticks() > log_likelihood[kStays] ? best : kStays;
}

void JumpBank::open(std::uint32_t lane, std::uint32_t from, const Jump& jump) {
  used_[lane] = true;
  opened_s_[lane] = jump.time_s;
  const bool together = from >= kFirstJump && jump.time_s - jump_[from].time_s < kTogether_s;
  jump_[lane] = together ? jump_[from] : jump;
  prior_[lane] = math::log(static_cast<double>(kEvery));
  if (from == kStays) return;
  // what follows a jump is a share of it
  const double share = static_cast<double>(kEvery) / static_cast<double>(ticks_);
  prior_[lane] = prior_[from] + math::log(share);
  prior_[from] += math::log(1.0 - share);
}

double JumpBank::log_sum(const double* log_likelihood, std::uint32_t from, std::uint32_t to) const {
  double sum = -HUGE_VAL;
  for (std::uint32_t l = from; l < to; ++l)
    if (l < kFirstJump || used_[l]) sum = log_add(sum, prior_[l] + log_likelihood[l]);
  return sum;
}

double JumpBank::walk_evidence(const double* log_likelihood) const {
  return log_sum(log_likelihood, 1, kFirstJump) - log_likelihood[kStays];
}

double JumpBank::jump_evidence(const double* log_likelihood) const {
  if (ticks_ < kEvery) return 0.0;
  return log_sum(log_likelihood, kFirstJump, kLanes) - log_ticks() - log_likelihood[kStays];
}

}  // namespace tiller
