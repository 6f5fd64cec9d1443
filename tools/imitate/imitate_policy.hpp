#pragma once

#include "tools/imitate/adversarial.hpp"
#include "tools/imitate/imitate.hpp"

namespace tiller::tools::imitate {

/// Whether a method learns a policy in the place of weights.
bool learns_policy(const std::string& method);

/// A policy's commands are shares of the range between limits. False with a sentence in `error` where one has no end.
bool has_limits(const RobotFile& robot, std::string& error);

/// Periods of a rollout.
std::uint32_t rollout_length(const ImitateOptions& options);

/// Learns a policy from result.demonstrations by fit_adversarial() and replays it, beside behaviour cloning, from their
/// starts. Sets result.policy, result.replayed and the demonstrations' shares at limits. Cost: fit_adversarial()'s.
void imitate_policy(const RobotFile& robot, const Scene& scene, const ImitateOptions& options, Imitated& result);

/// The policy as files have it: scales folded into the weights, angles by sine and cosine, `low` and `high` the range
/// of what it sees in `motions`.
StoredPolicy stored_policy(const RobotFile& robot, const Scene& scene, const SmallPolicy& policy,
                           const std::vector<const Motion*>& motions);

}  // namespace tiller::tools::imitate
