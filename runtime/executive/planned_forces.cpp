#include "executive/planned_forces.hpp"

#include <algorithm>
#include <cmath>

#include "core/bits.hpp"
#include "posterior/discrepancy_basis.hpp"

namespace tiller {

namespace {

constexpr std::uint16_t kKinds[kDiscrepancyBasis] = {tiller_effect_viscous_friction, tiller_effect_coulomb_friction,
                                                     tiller_effect_constant_offset};

/// What of a friction is sure: a plan that counts on more would be late where there is less.
double sure(double mean, double sd) { return std::fmax(0.0, mean - sd); }

}  // namespace

PlannedForces::PlannedForces(const tiller_config_t& config, const StepSetup& setup)
    : first_param_(config.param_count), period_s_(config.period_s), setup_(setup) {
  const std::uint32_t slips = Posterior::slip_states(config), joints = Posterior::force_joints(config);
  const std::uint32_t count = slips != 0 ? bit_count(slips) : joints;
  kinds_ = slips == 0 && joints <= kDiscrepancyJoints ? kDiscrepancyBasis : 1;
  if (count == 0 || setup.effect_count + kinds_ * joints > TILLER_MAX_EFFECTS ||
      config.param_count + (kinds_ + 1) * count + 2 > TILLER_MAX_PARAMS)
    return;
  count_ = count;
  take_effects(joints);
  setup_.slip_states = slips;
  setup_.fading = count;
  setup_.fading_param = first_param_ + (kinds_ - 1) * count;
}

void PlannedForces::take_effects(std::uint32_t joints) {
  for (std::uint32_t kind = 0; kind < kinds_; ++kind)
    for (std::uint32_t j = 0; j < joints; ++j)
      setup_.effects[setup_.effect_count++] = {kKinds[kDiscrepancyBasis - kinds_ + kind], static_cast<std::uint16_t>(j),
                                               static_cast<std::uint16_t>(first_param_ + kind * joints + j), 0};
}

/// A slip is the filter's: its mean over the first period.
void PlannedForces::fill(const Posterior& posterior, std::uint32_t count, float* params) const {
  if (count_ == 0) return;
  double value[kMaxRegressors + 2 * TILLER_MAX_JOINTS + 2] = {};
  double* const wandering = value + (kinds_ - 1) * count_;
  if (kinds_ > 1) {
    const Posterior::Friction friction = posterior.friction();
    for (std::uint32_t j = 0; j < count_; ++j) {
      value[j] = sure(friction.viscous[j], friction.viscous_sd[j]);
      value[count_ + j] = sure(friction.dry[j], friction.dry_sd[j]);
    }
  }
  const Posterior::Fading fading = posterior.forces(slip() ? period_s_ : 0.0, wandering, nullptr, wandering + count_);
  wandering[2 * count_] = period_s_ * fading.rate;
  wandering[2 * count_ + 1] = period_s_ * fading.turn;
  float* row = params + std::size_t{first_param_} * count;
  for (std::uint32_t j = 0; j < (kinds_ + 1) * count_ + 2; ++j, row += count)
    std::fill(row, row + count, static_cast<float>(value[j]));
}

}  // namespace tiller
