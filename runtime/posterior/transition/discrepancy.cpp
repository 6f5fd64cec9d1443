#include "posterior/transition/discrepancy.hpp"

#include <cmath>
#include <cstring>

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

Discrepancy Discrepancy::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                 const RolloutTable& table, const Evidence& evidence) {
  Discrepancy d;
  d.whitened_ = arena.take<float>(evidence.columns());
  if (evidence.joints() > 0) d.response_ = ForceResponse::lay_out(arena, config, setup, table, evidence.joints());
  return d;
}

void Discrepancy::clear() {
  begun_ = false;
  begun_at_ = again_ = again_end_ = 0;
}

/// As the particles' mean, of all transitions before, lets expect them. change (columns): [pushed state][force's
/// joint][kind].
void Discrepancy::respond(const TransitionData& data, std::uint32_t slot, double* change) {
  double mean[TILLER_MAX_PARAMS], all[TILLER_MAX_STATES * kMaxRegressors];
  data.particles.cloud.moments(mean, nullptr);
  const MeasuredStep& s = *data.ring.steps(slot);
  response_.observe(mean, s.state, nullptr, s.input, s.period_s, s.history, dry_force_, all);
  const std::uint32_t regressors = data.evidence.regressors();
  for (std::uint32_t b = 0; b < data.evidence.pushed_count(); ++b)
    std::memcpy(change + b * regressors, all + data.evidence.pushed(b) * regressors, sizeof(double) * regressors);
}

void Discrepancy::write_basis(const TransitionData& data, std::uint32_t slot, double* change) {
  respond(data, slot, change);
  for (std::uint32_t c = 0; c < data.evidence.columns(); ++c)
    data.ring.basis(slot)[c] = static_cast<float>(change[c] * scale_[c]);
}

void Discrepancy::set_basis(const TransitionData& data, std::uint32_t slot) {
  if (!begun_) return;
  double change[kMaxPushed * kMaxRegressors];
  estimate_dry_force(data);
  write_basis(data, slot, change);
  leave_out_sticking(data, slot, change);
}

/// A joint that is about to be stopped by dry friction is where it stops whatever the parameters say: its friction is
/// what the model's forces need, so there is nothing to learn from it, and no regressor has that form.
void Discrepancy::leave_out_sticking(const TransitionData& data, std::uint32_t slot, const double* change) const {
  const std::uint32_t joints = data.evidence.joints();
  MeasuredStep& step = *data.ring.steps(slot);
  for (std::uint32_t j = 0; j < joints; ++j) {
    const std::uint32_t own = (j * joints + j) * kDiscrepancyBasis;
    const bool slips = !(std::fabs(change[own + 2]) < kSlips * std::fabs(change[own]));
    const double rms_speed = scale_[own] / scale_[own + 1];
    if (slips || std::fabs(change[own + 1]) > kSlow * rms_speed * std::fabs(change[own])) continue;
    for (std::uint32_t b = 0; b < data.evidence.pushed_count(); ++b)
      if (scale_[(b * joints + j) * kDiscrepancyBasis] > 0.0) step.change[data.evidence.pushed(b)] = NAN;
  }
  data.ring.set_weight(slot, step.weight);
}

/// Where a joint comes to rest within a step the response depends on the friction's strength: the best guess is what
/// the transitions before say of it.
void Discrepancy::estimate_dry_force(const TransitionData& data) {
  const TransitionParticles& p = data.particles;
  const std::uint32_t joints = data.evidence.joints();
  for (std::uint32_t j = 0; j < joints; ++j) {
    double force = 0.0, weight = 0.0;
    for (std::uint32_t i = 0; i < p.n(); i += p.sample_stride()) {
      double beta[kMaxRegressors];
      data.evidence.coefficients(p.total + i, p.n(), j, beta);
      const double b = beta[j * kDiscrepancyBasis + 2];
      if (!(p.cloud.weight[i] > 0.0) || !std::isfinite(b)) continue;
      weight += p.cloud.weight[i];
      force += p.cloud.weight[i] * b;
    }
    if (!(weight > 0.0)) continue;
    force *= scale_[(j * joints + j) * kDiscrepancyBasis + 2] / weight;
    dry_force_[j] = force > least_dry_force_[j] ? force : least_dry_force_[j];
  }
}

void Discrepancy::keep(const TransitionData& data) {
  if (data.evidence.joints() == 0) return;
  const TransitionRing& ring = data.ring;
  if (!begun_) {
    if (ring.size() < kScaleTicks || !find_scale(data)) return;
    begun_ = true;
    begun_at_ = again_end_ = ring.end();
    again_ = ring.end() - kScaleTicks;
  }
  for (const std::uint64_t ticks : kAgain)
    if (ring.end() - begun_at_ == ticks) {
      again_ = 0;
      again_end_ = ring.end();
    }
  if (again_ < ring.begin()) again_ = ring.begin();
  if (again_ >= again_end_) return;
  const std::uint64_t last = again_ + kScaleTicks < again_end_ ? again_ + kScaleTicks : again_end_;
  renew(data, again_, last);
  again_ = last;
}

/// Twice the transitions, one after them, and their predecessor.
std::uint64_t Discrepancy::work_limit(std::uint32_t particles) {
  return std::uint64_t{2} * (kScaleTicks + 2) * particles;
}

const float* Discrepancy::whiten(const TransitionData& data) {
  const Evidence::Counted one = data.ring.counted(data.ring.newest());
  const std::uint32_t regressors = data.evidence.regressors();
  for (std::uint32_t c = 0; c < data.evidence.columns(); ++c) {
    const std::uint32_t place = c / regressors;
    const double rho = one.linked[place] > 0.0f ? data.evidence.colour(data.evidence.pushed(place)) : 0.0;
    whitened_[c] = one.basis[c] - static_cast<float>(rho) * one.before[c];
  }
  return whitened_;
}

/// From what the ring holds last. False while a joint stands still.
bool Discrepancy::find_scale(const TransitionData& data) {
  const Evidence& evidence = data.evidence;
  const std::uint32_t joints = evidence.joints(), columns = evidence.columns();
  double square[kMaxPushed * kMaxRegressors] = {}, change[kMaxPushed * kMaxRegressors] = {};
  for (std::uint32_t j = 0; j < joints; ++j) dry_force_[j] = kFeeble;
  for (std::uint64_t k = data.ring.end() - kScaleTicks; k < data.ring.end(); ++k) {
    respond(data, data.ring.slot(k), change);
    for (std::uint32_t c = 0; c < columns; ++c) square[c] += change[c] * change[c] / kScaleTicks;
  }
  for (std::uint32_t j = 0; j < joints; ++j) {
    const double* own = square + (j * joints + j) * kDiscrepancyBasis;
    if (!(own[0] > 0.0 && own[1] > 0.0)) return false;
    least_dry_force_[j] = kLeastDry * std::sqrt(evidence.configured_variance(evidence.pushed(j)) / own[0]);
    dry_force_[j] = least_dry_force_[j];
  }
  for (std::uint32_t c = 0; c < columns; ++c) scale_[c] = square[c] > 0.0 ? 1.0 / std::sqrt(square[c]) : 0.0;
  return true;
}

/// New regressors for transitions of the ring, and every particle's projections on them in place of those on the old.
/// The transition after the last has the last's for its predecessor's.
void Discrepancy::renew(const TransitionData& data, std::uint64_t first, std::uint64_t last) {
  double change[kMaxPushed * kMaxRegressors];
  const std::uint64_t touched = last < data.ring.end() ? last + 1 : last;
  const auto count = [&](double sign) {
    data.particles.clear_fresh();
    data.sums.sum_fresh(data.particles, first, touched);
    data.particles.add_fresh(sign);
    for (std::uint64_t k = first; k < touched; ++k) data.evidence.add_basis(data.ring.counted(data.ring.slot(k)), sign);
  };
  estimate_dry_force(data);
  count(-1.0);
  for (std::uint64_t k = first; k < last; ++k) write_basis(data, data.ring.slot(k), change);
  count(1.0);
  data.evidence.prepare();
}

}  // namespace tiller
