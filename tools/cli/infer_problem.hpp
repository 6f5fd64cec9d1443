#pragma once

#include <string>

#include "tools/cli/infer_logs.hpp"

namespace tiller::tools {

/// What `tiller infer` would learn from, as JSON for a laboratory (python/tiller/labs): how the simulator is started,
/// names, priors, sensors' noise, and the logs cut to pieces. All digits of every number are kept.
std::string inference_problem_json(const SimulatorFile& file, const Words& logs, const InferenceProblem& problem);

}  // namespace tiller::tools
