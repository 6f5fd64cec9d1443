#pragma once

#include "tools/likelihood_free/inference.hpp"
#include "tools/simulator/simulator_file.hpp"

namespace tiller::tools {

/// What a result is told with.
struct InferFacts {
  const SimulatorFile* file = nullptr;
  const InferenceOptions* options = nullptr;
  Words logs;
  std::size_t pieces = 0;
  double seconds = 0.0;
};

/// The table that the command prints.
std::string infer_text(const InferFacts& facts, const Inferred& result);
/// Everything, for programs and for the page: `infer.json`.
std::string infer_json(const InferFacts& facts, const Inferred& result);

/// The posterior in the form that a run goes on from: 512 of the weighted draws, resampled, as a mixture.
bool write_inferred_posterior(const std::string& path, const RobotFile& robot, const Inferred& result,
                              std::string& error);

}  // namespace tiller::tools
