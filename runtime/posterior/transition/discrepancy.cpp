// The discrepancy's regressors, and when they come into force.

#include <cmath>
#include <cstring>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

namespace {

/// Transitions after which the regressors' scale is taken, once and for all: sums over different regressors would not
/// add up.
constexpr std::uint32_t kScaleTicks = 16;
/// Ticks after that at which the regressors of what the ring holds are taken again, kScaleTicks transitions a tick: the
/// first ones came from a cloud that was still wide.
constexpr std::uint64_t kAgain[] = {16, 48};
/// Least strength at which dry friction is taken, in what moves a velocity by a deviation of its configured noise.
constexpr double kLeastDry = 0.1;
/// Dry friction that hardly stops anything.
constexpr double kFeeble = 1e-6;
/// Below this share of the first transitions' RMS velocity a joint that dry friction would stop says nothing.
constexpr double kSlow = 0.2;
/// From this share of the response to a constant force on, dry friction does not stop the joint within the step.
constexpr double kSlips = 0.999;

}  // namespace

/// As the particles' mean, of all transitions before, lets expect them. change (columns): [pushed state][force's
/// joint][kind].
void TransitionCloud::respond(std::uint32_t slot, double* change) {
  double mean[TILLER_MAX_PARAMS], all[TILLER_MAX_STATES * kMaxRegressors];
  cloud_.moments(mean, nullptr);
  const MeasuredStep& s = steps_[slot];
  response_.observe(mean, s.state, nullptr, s.input, s.period_s, s.history, dry_force_, all);
  const std::uint32_t regressors = evidence_.regressors();
  for (std::uint32_t b = 0; b < evidence_.pushed_count(); ++b)
    std::memcpy(change + b * regressors, all + evidence_.pushed(b) * regressors, sizeof(double) * regressors);
}

void TransitionCloud::set_basis(std::uint32_t slot) {
  float* basis = basis_ + slot * columns_;
  std::memset(basis, 0, sizeof(float) * columns_);
  if (!discrepancy_begun_) return;
  double change[kMaxPushed * kMaxRegressors];
  estimate_dry_force();
  respond(slot, change);
  for (std::uint32_t c = 0; c < columns_; ++c) basis[c] = static_cast<float>(change[c] * basis_scale_[c]);
  leave_out_sticking(slot, change);
}

/// A joint that is about to be stopped by dry friction is where it stops whatever the parameters say: its friction is
/// what the model's forces need, so there is nothing to learn from it, and no regressor has that form.
void TransitionCloud::leave_out_sticking(std::uint32_t slot, const double* change) {
  const std::uint32_t joints = evidence_.joints();
  for (std::uint32_t j = 0; j < joints; ++j) {
    const std::uint32_t own = (j * joints + j) * kDiscrepancyBasis;
    const bool slips = !(std::fabs(change[own + 2]) < kSlips * std::fabs(change[own]));
    const double rms_speed = basis_scale_[own] / basis_scale_[own + 1];
    if (slips || std::fabs(change[own + 1]) > kSlow * rms_speed * std::fabs(change[own])) continue;
    for (std::uint32_t b = 0; b < evidence_.pushed_count(); ++b)
      if (basis_scale_[(b * joints + j) * kDiscrepancyBasis] > 0.0) steps_[slot].change[evidence_.pushed(b)] = NAN;
  }
  set_weight(slot, steps_[slot].weight);
}

/// Where a joint comes to rest within a step the response depends on the friction's strength: the best guess is what
/// the transitions before say of it.
void TransitionCloud::estimate_dry_force() {
  const std::uint32_t stride = n_ > kSubsample ? n_ / kSubsample : 1, joints = evidence_.joints();
  for (std::uint32_t j = 0; j < joints; ++j) {
    double force = 0.0, weight = 0.0;
    for (std::uint32_t i = 0; i < n_; i += stride) {
      double beta[kMaxRegressors];
      evidence_.coefficients(total_ + i, n_, j, beta);
      const double b = beta[j * kDiscrepancyBasis + 2];
      if (!(cloud_.weight[i] > 0.0) || !std::isfinite(b)) continue;
      weight += cloud_.weight[i];
      force += cloud_.weight[i] * b;
    }
    if (!(weight > 0.0)) continue;
    force *= basis_scale_[(j * joints + j) * kDiscrepancyBasis + 2] / weight;
    dry_force_[j] = force > least_dry_force_[j] ? force : least_dry_force_[j];
  }
}

/// The discrepancy's tick, after the newest transition has been counted. Cost: kScaleTicks steps of the model per
/// particle at the tick at which it begins and at up to six later ones; the moves of those ticks get as much less.
void TransitionCloud::keep_discrepancy() {
  if (evidence_.joints() == 0) return;
  if (!discrepancy_begun_) {
    if (end_ - begin_ < kScaleTicks || !find_basis_scale()) return;
    discrepancy_begun_ = true;
    begun_at_ = again_end_ = end_;
    again_ = end_ - kScaleTicks;
  }
  for (const std::uint64_t ticks : kAgain)
    if (end_ - begun_at_ == ticks) {
      again_ = 0;
      again_end_ = end_;
    }
  if (again_ < begin_) again_ = begin_;
  if (again_ >= again_end_) return;
  const std::uint64_t last = again_ + kScaleTicks < again_end_ ? again_ + kScaleTicks : again_end_;
  renew_basis(again_, last);
  again_ = last;
}

/// Twice the transitions, one after them, and their predecessor.
std::uint64_t TransitionCloud::renewal_work() const { return std::uint64_t{2} * (kScaleTicks + 2) * n_; }

/// The newest regressors as newest_residual() is whitened.
void TransitionCloud::whiten_basis(std::uint32_t slot) {
  const Evidence::Counted one = counted(slot);
  const std::uint32_t regressors = evidence_.regressors();
  for (std::uint32_t c = 0; c < columns_; ++c) {
    const std::uint32_t place = c / regressors;
    const double rho = one.linked[place] > 0.0f ? evidence_.colour(evidence_.pushed(place)) : 0.0;
    whitened_[c] = one.basis[c] - static_cast<float>(rho) * one.before[c];
  }
}

void TransitionCloud::count_bases(std::uint64_t first, std::uint64_t last, double sign) {
  for (std::uint64_t k = first; k < last; ++k)
    evidence_.add_basis(counted(static_cast<std::uint32_t>(k % capacity_)), sign);
}

/// From what the ring holds last. False while a joint stands still.
bool TransitionCloud::find_basis_scale() {
  const std::uint32_t joints = evidence_.joints();
  double square[kMaxPushed * kMaxRegressors] = {}, change[kMaxPushed * kMaxRegressors] = {};
  for (std::uint32_t j = 0; j < joints; ++j) dry_force_[j] = kFeeble;
  for (std::uint64_t k = end_ - kScaleTicks; k < end_; ++k) {
    respond(static_cast<std::uint32_t>(k % capacity_), change);
    for (std::uint32_t c = 0; c < columns_; ++c) square[c] += change[c] * change[c] / kScaleTicks;
  }
  for (std::uint32_t j = 0; j < joints; ++j) {
    const double* own = square + (j * joints + j) * kDiscrepancyBasis;
    if (!(own[0] > 0.0 && own[1] > 0.0)) return false;
    least_dry_force_[j] = kLeastDry * std::sqrt(evidence_.configured_variance(evidence_.pushed(j)) / own[0]);
    dry_force_[j] = least_dry_force_[j];
  }
  for (std::uint32_t c = 0; c < columns_; ++c) basis_scale_[c] = square[c] > 0.0 ? 1.0 / std::sqrt(square[c]) : 0.0;
  return true;
}

/// New regressors for transitions of the ring, and every particle's projections on them in place of those on the old.
/// The transition after the last has the last's for its predecessor's.
void TransitionCloud::renew_basis(std::uint64_t first, std::uint64_t last) {
  double change[kMaxPushed * kMaxRegressors];
  const std::uint64_t touched = last < end_ ? last + 1 : last;
  const std::uint32_t all = rows_ * n_;
  estimate_dry_force();
  std::memset(fresh_, 0, sizeof(double) * all);
  sum_run({params_, n_}, n_, first, touched, fresh_, n_);
  transition_table().add_scaled(all, -1.0, fresh_, total_);
  transition_table().add_scaled(all, -1.0, fresh_, ring_sums_);
  count_bases(first, touched, -1.0);
  for (std::uint64_t k = first; k < last; ++k) {
    const auto slot = static_cast<std::uint32_t>(k % capacity_);
    respond(slot, change);
    for (std::uint32_t c = 0; c < columns_; ++c)
      basis_[slot * columns_ + c] = static_cast<float>(change[c] * basis_scale_[c]);
  }
  std::memset(fresh_, 0, sizeof(double) * all);
  sum_run({params_, n_}, n_, first, touched, fresh_, n_);
  transition_table().add_scaled(all, 1.0, fresh_, total_);
  transition_table().add_scaled(all, 1.0, fresh_, ring_sums_);
  count_bases(first, touched, 1.0);
  evidence_.prepare();
}

}  // namespace tiller
