#pragma once

#include <string>

#include "tools/run/run_result.hpp"

namespace tiller::tools {

/// How often plans were probed, and at what cost; empty: never.
std::string probing_text(const tiller_info_t& info);
/// The last lines of a run: state, posterior (beside the truth where it is known), tick times.
std::string summary(const RobotFile& robot, const RunOptions& options, const RunResult& result);
/// A sentence for every parameter whose posterior stands on its prior's edge (find_prior_edge).
Words run_edges(const RobotFile& robot, const RunResult& result);
/// The present state of a run's logs, for its progress.
const char* log_news(const LogState& log);
/// The defects of a run's logs, without a line's end; "complete" if there are none.
std::string log_text(const LogState& log);
/// "a force at joint 'pole' goes with ...", of an alarm of a posterior that estimates forces (`disturbance`); empty of
/// any other, and where what is left is no force's.
std::string systematic_force_text(const RobotFile& robot, const tiller_info_t& info);
/// One line on what the model does not explain, or, with `disturbance`, on the force that is left beside the estimated
/// one; info.adequacy is tiller_adequacy_inadequate.
std::string inadequacy(const RobotFile& robot, const tiller_info_t& info);

}  // namespace tiller::tools
