#pragma once

#include <string>

#include "tools/policy_search/policy.hpp"

namespace tiller::tools::policy {

/// The policy as JSON:
///
///     {"format": "tiller policy", "version": 1, "kind": "rbf", "squash": "sine", "period_s": 0.1,
///      "states": [...], "commands": [...], "inputs": ["position_m", "sin(angle_rad)", ...],
///      "low": [...], "high": [...], ...}
///
/// with, by kind: linear "weight" (a row a command) and "bias"; rbf "centres" (a row a bump), "inverse_lengths" (a row a
/// command) and "weights" (a row a command); tanh "widths" and "weights" (nets::Mlp's order). "squash" is "sine" or "cut".
std::string policy_text(const Policy& policy);

/// Reads it. False with a sentence in `error` that names path, key and remedy.
bool parse_policy(const std::string& text, const std::string& path, Policy& policy, std::string& error);
bool read_policy(const std::string& path, Policy& policy, std::string& error);

}  // namespace tiller::tools::policy
