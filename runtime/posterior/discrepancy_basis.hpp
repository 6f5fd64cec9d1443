#pragma once

#include <cstdint>

namespace tiller {

/// Forces at one joint that a model may lack: constant, viscous, dry.
constexpr std::uint32_t kDiscrepancyBasis = 3;
/// Joints that have them; a model with more has them at its first ones alone.
constexpr std::uint32_t kDiscrepancyJoints = 4;
/// Forces at all of these joints.
constexpr std::uint32_t kMaxRegressors = kDiscrepancyJoints * kDiscrepancyBasis;
/// States that they push within a step: a position and a velocity for each joint.
constexpr std::uint32_t kMaxPushed = 2 * kDiscrepancyJoints;

}  // namespace tiller
