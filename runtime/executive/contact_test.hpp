#pragma once

#include <cmath>
#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Whether a force beyond the model is a contact (safety.contact_force): where its estimate is larger than the limit,
/// and kDeviations from none; until it is below half of the limit. Of estimates of no force 7e-6 are that far: 0.1 an
/// hour, if one is independent every ten periods of 20 ms.
class ContactTest {
 public:
  void lay_out(const tiller_config_t& config) {
    for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
      limit_[j] = config.safety.contact_force[config.model->joints[j].velocity];
  }
  /// Bit j: joint j is touched. (joints) each.
  std::uint32_t judge(std::uint32_t joints, const double* mean, const double* sd) {
    for (std::uint32_t j = 0; j < joints; ++j) {
      const double force = std::fabs(mean[j]);
      if (force > limit_[j] && force > kDeviations * sd[j]) touched_ |= 1u << j;
      if (!(force > kEnd * limit_[j])) touched_ &= ~(1u << j);
    }
    return touched_;
  }

 private:
  static constexpr double kDeviations = 4.5, kEnd = 0.5;
  double limit_[TILLER_MAX_JOINTS] = {};
  std::uint32_t touched_ = 0;
};

}  // namespace tiller
