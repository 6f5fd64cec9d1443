#pragma once

#include <cstdint>

#include "posterior/force_response.hpp"
#include "posterior/transition/residual_sums.hpp"

namespace tiller {

/// What the parts of a cloud over transitions work on.
struct TransitionData {
  TransitionRing& ring;
  Evidence& evidence;
  TransitionParticles& particles;
  ResidualSums& sums;
};

/// The discrepancy's regressors, and when they come into force: what a constant, a viscous and a dry force at each joint
/// would have changed over each transition.
class Discrepancy {
 public:
  static Discrepancy lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                             const RolloutTable& table, const Evidence& evidence);

  void clear();
  /// Regressors of a new transition, before it is counted.
  void set_basis(const TransitionData& data, std::uint32_t slot);
  /// The tick, after the newest transition has been counted. Cost: kScaleTicks steps of the model per particle at the
  /// tick at which it begins and at up to six later ones; the moves of those ticks get as much less.
  void keep(const TransitionData& data);
  /// The newest regressors (columns) as ResidualSums::newest() is whitened.
  const float* whiten(const TransitionData& data);
  /// Steps of the model that keep() takes at the most.
  static std::uint64_t work_limit(std::uint32_t particles);

 private:
  void respond(const TransitionData& data, std::uint32_t slot, double* change);
  void write_basis(const TransitionData& data, std::uint32_t slot, double* change);
  void estimate_dry_force(const TransitionData& data);
  void leave_out_sticking(const TransitionData& data, std::uint32_t slot, const double* change) const;
  bool find_scale(const TransitionData& data);
  void renew(const TransitionData& data, std::uint64_t first, std::uint64_t last);

  ForceResponse response_;
  float* whitened_ = nullptr;  // (columns) the newest basis less rho times the one before
  bool begun_ = false;
  std::uint64_t begun_at_ = 0, again_ = 0, again_end_ = 0;  // transitions whose regressors are to be taken again
  double scale_[kMaxPushed * kMaxRegressors] = {};          // (columns) 1 / root mean square
  double least_dry_force_[kDiscrepancyJoints] = {};
  double dry_force_[kDiscrepancyJoints] = {};  // strength at which dry friction is taken
};

}  // namespace tiller
