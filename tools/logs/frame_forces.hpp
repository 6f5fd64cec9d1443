#pragma once

#include <vector>

#include "tiller/tiller.h"
#include "tools/base/text.hpp"

namespace tiller::tools {

/// Forces beyond the model as one force at the origin of each frame, in the base's axes. A frame is what the model's
/// outputs tell two or three coordinates of (<frame>_x_m, _y_m, _z_m). Its Jacobian J (coordinates x joints) makes
/// joint forces tau = J' F of a force F; F is the least-squares solution of the joint forces that are estimated, each
/// weighted by its deviation, and its deviations are those that come from theirs. What moves no joint that is felt is
/// not determined (along a stretched arm), and NaN. No moments at the frame, and no frames where a joint that is felt
/// has no position.
class FrameForces {
 public:
  /// `config` outlives it.
  explicit FrameForces(const tiller_config_t& config);
  /// "tip_x_N", "tip_z_N", ...; none where the posterior looks for no forces.
  const Words& names() const { return names_; }
  /// mean, sd (names), at the estimate that `info` tells. Cost: two outputs a joint, and a decomposition of 3 x joints
  /// a frame.
  void compute(const tiller_info_t& info, double* mean, double* sd) const;

 private:
  const tiller_config_t& config_;
  std::uint32_t joints_ = 0;                        // that are felt
  std::vector<std::vector<std::uint32_t>> frames_;  // each one's outputs
  Words names_;
};

}  // namespace tiller::tools
