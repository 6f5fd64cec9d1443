#pragma once

#include <cstdint>

#include "rollout/measurement.hpp"

namespace tiller {

// What a quaternion's sensor says, as filters take it. Of its four values the first is missing and the others are the
// difference from no rotation (attitude_difference in tiller/rotation.hpp): the length of a quaternion says nothing, so
// three values count into the likelihood, the noise and the test of the model. Without quaternions nothing is changed.

/// Measured values (ny) become those that filters take. A quaternion that is not whole is missing.
void take_attitudes(const tiller_config_t& config, double* measured);
/// A quaternion of which one part was refused is missing.
void drop_parts(const tiller_config_t& config, double* measured);
/// Taken value k less what `reading` makes of its state, which is a filter's in rows of `stride`.
double innovation_of(const tiller_config_t& config, const double* measured, std::uint32_t k, const double* state,
                     std::uint32_t stride, const MeasurementMap& reading);

}  // namespace tiller
