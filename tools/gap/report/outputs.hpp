#pragma once

#include <string>

#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// The version of gap.json: grows when a key changes its meaning or vanishes, not when one is added.
constexpr int kJsonVersion = 1;

/// How `tiller gap` ends, for scripts (docs/guide/gap.md): 0 no gap or one within the budget; 1 named, over the budget;
/// 2 ambiguous, partly explained or unnamed; 3 data unfit. Where it is asked what changed the gap is that of the model
/// of before on the logs of after.
int exit_code_of(const Result& result, double budget_sigma);

/// Everything, for programs and for the page; tools/python/tiller_tools/gap.schema.json is its schema.
/// `robot_file`: path of the new robot file; empty: none was written.
std::string gap_json(const RobotFile& robot, const Options& options, const Result& result,
                     const std::string& robot_file);

/// The text that the command prints.
std::string gap_text(const RobotFile& robot, const Result& result);

}  // namespace tiller::tools::gap
