#pragma once

#include <string>

#include "tools/policy_search/policy.hpp"

namespace tiller::tools::policy {

/// The policy as the JSON that the planner `policy` takes in (`[policy] file = ...` of a robot file):
///
///     {"format": "tiller policy", "version": 1, "reads": ["state"], "squash": "sine",
///      "input_low": [], "input_high": [],
///      "network": {"kind": "gaussian", "inputs": ["position_m", "sin angle_rad", "cos angle_rad", ...],
///                  "outputs": [...], "members": 1, "hidden": [20, 0], "weights": [...]},
///      "period_s": 0.1, "states": [...], "angles": [...], "low": [...], "high": [...]}
///
/// Inputs are all states in the model's order, an angle by sine and cosine. Weights of "tanh" (a linear policy has no
/// hidden layer): layer by layer, for each output its bias and a weight for each input. Of "gaussian": an inverse
/// length for each input, the centres, then for each output a bias (zero) and a weight for each centre. The last line
/// is for those who have no robot file at hand. Numbers keep 7 digits there, all of them here.
std::string policy_text(const Policy& policy, const std::vector<int>& angles);

/// Reads it. False with a sentence in `error` that names path, key and remedy.
bool parse_policy(const std::string& text, const std::string& path, Policy& policy, std::string& error);
bool read_policy(const std::string& path, Policy& policy, std::string& error);

}  // namespace tiller::tools::policy
