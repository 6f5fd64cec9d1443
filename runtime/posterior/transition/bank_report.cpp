// The members' joint report.

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "posterior/transition/bank.hpp"

namespace tiller {

namespace {

/// Weight of a member whose particles are not worth a look for the share of them that lies in one half of a period.
constexpr double kNegligible = 1e-9;

}  // namespace

void BankPosterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  if (param_mean || param_sd) {
    double mean[TILLER_MAX_PARAMS] = {}, square[TILLER_MAX_PARAMS] = {}, m[TILLER_MAX_PARAMS], s[TILLER_MAX_PARAMS];
    double centre[TILLER_MAX_PARAMS];
    leader().moments(centre, nullptr, nullptr, nullptr);
    for (std::uint32_t k = 0; k < members_; ++k) {
      if (!(weight_[k] > 0.0)) continue;
      engine_[k]->moments(m, s, nullptr, nullptr);
      for (std::uint32_t i = 0; i < np_; ++i) {
        mean[i] += weight_[k] * (m[i] - centre[i]);
        square[i] += weight_[k] * (s[i] * s[i] + (m[i] - centre[i]) * (m[i] - centre[i]));
      }
    }
    for (std::uint32_t i = 0; i < np_; ++i) {
      if (param_mean) param_mean[i] = centre[i] + mean[i];
      if (param_sd) param_sd[i] = std::sqrt(std::fmax(0.0, square[i] - mean[i] * mean[i]));
    }
  }
  // measured, so nearly the same for all
  if (state_mean || state_sd) leader().moments(nullptr, nullptr, state_mean, state_sd);
}

void BankPosterior::covariance(double* covariance) const {
  double mean[TILLER_MAX_PARAMS], m[TILLER_MAX_PARAMS], c[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];
  moments(mean, nullptr, nullptr, nullptr);
  for (std::uint32_t i = 0; i < np_ * np_; ++i) covariance[i] = 0.0;
  for (std::uint32_t k = 0; k < members_; ++k) {
    if (!(weight_[k] > 0.0)) continue;
    engine_[k]->moments(m, nullptr, nullptr, nullptr);
    engine_[k]->covariance(c);
    for (std::uint32_t i = 0; i < np_; ++i)
      for (std::uint32_t j = 0; j < np_; ++j)
        covariance[i * np_ + j] += weight_[k] * (c[i * rows_ + j] + (m[i] - mean[i]) * (m[j] - mean[j]));
  }
}

/// As Cloud::quantile, over all members' particles.
double BankPosterior::quantile(std::uint32_t param, double q) const {
  if (param >= np_ || !(q >= 0.0 && q <= 1.0)) return NAN;
  double params[TILLER_MAX_PARAMS];
  for (std::uint32_t k = 0; k < size(); ++k) {
    particle(k, params, nullptr, &scratch_.share[k]);
    scratch_.value[k] = params[param];
    scratch_.order[k] = k;
  }
  const double* value = scratch_.value;
  std::sort(scratch_.order, scratch_.order + size(),
            [value](std::uint32_t a, std::uint32_t b) { return value[a] != value[b] ? value[a] < value[b] : a < b; });
  double below = 0.0, last_at = 0.0, last = scratch_.value[scratch_.order[0]];
  for (std::uint32_t k = 0; k < size(); ++k) {
    const double share = scratch_.share[scratch_.order[k]], at = below + 0.5 * share,
                 here = scratch_.value[scratch_.order[k]];
    if (!(share > 0.0)) continue;
    if (at >= q) return below > 0.0 && at > last_at ? last + (q - last_at) / (at - last_at) * (here - last) : here;
    below += share;
    last_at = at;
    last = here;
  }
  return last;
}

void BankPosterior::Counts::add(const Posterior& engine) {
  PosteriorReport report;
  engine.report(report);
  resamplings += engine.resamplings();
  gated += engine.gated();
  relearned += report.relearned;
  lost += report.lost;
}

void BankPosterior::Counts::subtract(const Posterior& engine) {
  Counts of;
  of.add(engine);
  resamplings -= of.resamplings;
  gated -= of.gated;
  relearned -= of.relearned;
  lost -= of.lost;
}

BankPosterior::Counts BankPosterior::counts() const {
  Counts sum = retired_;
  for (std::uint32_t k = 0; k < members_; ++k) sum.add(*engine_[k]);
  return sum;
}

std::uint64_t BankPosterior::resamplings() const { return counts().resamplings; }

std::uint64_t BankPosterior::gated() const { return counts().gated; }

void BankPosterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  if (index >= size()) return;
  double all[TILLER_MAX_PARAMS];
  engine_[index / n_]->particle(index % n_, params ? all : nullptr, state, weight);
  if (params) std::copy(all, all + np_, params);
  if (weight) *weight *= weight_[index / n_];
}

void BankPosterior::particle_effects(std::uint32_t index, double* effect_state) const {
  if (index < size()) engine_[index / n_]->particle_effects(index % n_, effect_state);
}

double BankPosterior::particle_delay(std::uint32_t index) const {
  if (index >= size()) return 0.0;
  double all[TILLER_MAX_PARAMS];
  if (hypotheses_.fractional) engine_[index / n_]->particle(index % n_, all, nullptr, nullptr);
  return periods(index / n_, hypotheses_.fractional ? all[np_] : 0.0);
}

void BankPosterior::clear_adequacy() {
  for (std::uint32_t k = 0; k < members_; ++k) engine_[k]->clear_adequacy();
}

void BankPosterior::report(PosteriorReport& report) const {
  leader().report(report);
  for (double& weight : report.delay_weight) weight = 0.0;
  for (std::uint32_t k = 0; k < members_; ++k) {
    const double late = late_share(k);
    report.delay_weight[delay_of(k)] += weight_[k] * (1.0 - late);
    if (late > 0.0) report.delay_weight[delay_of(k) + 1] += weight_[k] * late;
  }
  for (std::uint32_t i = 0; i < TILLER_MAX_FORGETTING; ++i)
    report.forgetting_weight[i] = i < rates_ ? rate_weight_[i] : 0.0;
  const Counts sum = counts();
  report.relearned = sum.relearned;
  report.lost = sum.lost;
}

/// Share of a member's particles that are nearer to the next whole period than to the one before.
double BankPosterior::late_share(std::uint32_t member) const {
  if (!hypotheses_.fractional || !(weight_[member] > kNegligible)) return 0.0;
  double params[TILLER_MAX_PARAMS], weight, late = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    engine_[member]->particle(i, params, nullptr, &weight);
    if (params[np_] > 0.5 * config_->period_s) late += weight;
  }
  return std::min(late, 1.0);
}

double BankPosterior::periods(std::uint32_t member, double fraction_s) const {
  return delay_of(member) + (hypotheses_.fractional ? fraction_s / config_->period_s : 0.0);
}

/// Of whole periods the leader's.
double BankPosterior::mean_delay() const {
  if (!hypotheses_.fractional) return delay_of(leader_);
  double mean[TILLER_MAX_PARAMS], sum = 0.0;
  for (std::uint32_t k = 0; k < members_; ++k) {
    if (!(weight_[k] > 0.0)) continue;
    engine_[k]->moments(mean, nullptr, nullptr, nullptr);
    sum += weight_[k] * periods(k, mean[np_]);
  }
  return sum;
}

/// Whose each of `count` <= kColumns columns is. How many are a member's: one uniform number, evenly spaced pointers
/// into the cumulated weights. Mixed, so that any first few columns come from all: the next one is of whom the largest
/// share is still to come.
void BankPosterior::apportion(std::uint32_t count, std::uint64_t tick, std::uint32_t first,
                              std::uint32_t* columns) const {
  Rng rng(config_->seed, kRngSelect, ~(tick * kColumns + first));
  const double offset = rng.uniform();
  double sum = 0.0;
  std::uint32_t next = 0, left[kMaxMembers];
  for (std::uint32_t k = 0; k < members_; ++k) {
    sum += weight_[k] * count;
    columns[k] = 0;
    for (; next < count && next + offset < sum; ++next) ++columns[k];
  }
  columns[leader_] += count - next;  // rounding; or a single column, which is the leader's
  if (count == 1)
    for (std::uint32_t k = 0; k < members_; ++k) columns[k] = k == leader_ ? 1 : 0;
  for (std::uint32_t k = 0; k < members_; ++k) left[k] = columns[k];
  for (std::uint32_t m = 0; m < count; ++m) {
    std::uint32_t most = members_;
    for (std::uint32_t k = 0; k < members_; ++k) {
      if (left[k] == 0) continue;
      if (most == members_ || std::uint64_t{left[k]} * columns[most] > std::uint64_t{left[most]} * columns[k]) most = k;
    }
    --left[most];
    scratch_.owner[m] = most;
  }
}

void BankPosterior::draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
                         float* history) const {
  for (std::uint32_t first = 0; first < count; first += kColumns)
    draw_block(count, first, tick, params, state, effect_state);
  // a single one is the mean of all
  double mean[TILLER_MAX_PARAMS];
  if (count == 1 && params) {
    moments(mean, nullptr, nullptr, nullptr);
    for (std::uint32_t i = 0; i < np_; ++i) params[i] = static_cast<float>(mean[i]);
  }
  if (count == 1) drawn_delay_[0] = mean_delay();
  // a configuration whose setup has a history has whole periods
  if (history && !hypotheses_.fractional) leader().draw(1, tick, nullptr, nullptr, nullptr, history);
}

/// Columns first .. first + kColumns - 1.
void BankPosterior::draw_block(std::uint32_t count, std::uint32_t first, std::uint64_t tick, float* params,
                               float* state, float* effect_state) const {
  const std::uint32_t block = std::min(count - first, kColumns);
  std::uint32_t columns[kMaxMembers];
  apportion(block, tick, first, columns);
  const std::uint32_t* owner = scratch_.owner;
  float *from_state = scratch_.drawn + rows_ * kColumns, *from_effect = from_state + nx_ * kColumns;
  const auto copy = [&](const float* from, std::uint32_t rows, std::uint32_t stride, std::uint32_t at, float* to,
                        std::uint32_t column) {
    for (std::uint32_t i = 0; i < rows && to; ++i) to[i * count + column] = from[i * stride + at];
  };
  for (std::uint32_t k = 0; k < members_; ++k) {
    const std::uint32_t stride = columns[k];
    if (stride == 0) continue;
    engine_[k]->draw(stride, tick + first, scratch_.drawn, from_state, from_effect, nullptr);
    std::uint32_t at = 0;
    for (std::uint32_t m = 0; m < block; ++m) {
      if (owner[m] != k) continue;
      const float* fraction = scratch_.drawn + np_ * stride + at;
      drawn_delay_[m] = periods(k, hypotheses_.fractional ? static_cast<double>(*fraction) : 0.0);
      copy(scratch_.drawn, np_, stride, at, params, first + m);
      copy(from_state, nx_, stride, at, state, first + m);
      copy(from_effect, ns_, stride, at, effect_state, first + m);
      ++at;
    }
  }
}

void BankPosterior::set_origin(const double* state) {
  for (std::uint32_t k = 0; k < members_; ++k) engine_[k]->set_origin(state);
}

}  // namespace tiller
