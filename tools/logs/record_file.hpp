#pragma once

#include <cstdint>
#include <istream>
#include <memory>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/base/output_file.hpp"
#include "tools/robot/joint_prior.hpp"

namespace tiller::tools {

/// What was done to find out, as in tiller_info_t; zeros: nothing, or the log tells nothing.
struct ProbeAccount {
  std::uint32_t probing = 0, calibration_left = 0;
  double value = 0.0, cost = 0.0, spent = 0.0, allowed = 0.0, information = 0.0;
};

/// One tick of a record file: what the host did to the controller before it, then the tick itself.
struct RecordEntry {
  std::uint32_t stop_status = 0;  ///< tiller_stop with this status before the tick; 0: not
  std::uint32_t goal = 0;         ///< kGoalStates, kGoalOutputs: which goal was set before the tick
  tiller_record_t record{};
  double target[TILLER_MAX_STATES] = {};          ///< then where to
  double output_target[TILLER_MAX_OUTPUTS] = {};  ///< and where to with the outputs
  /// Forces beyond the model after the tick, as in tiller_info_t. No joints: the log tells none.
  std::uint32_t force_joints = 0, touched = 0;
  double force_mean[TILLER_MAX_JOINTS] = {}, force_sd[TILLER_MAX_JOINTS] = {};
  ProbeAccount probe;  ///< after the tick
};
constexpr std::uint32_t kGoalStates = 1u, kGoalOutputs = 2u;

/// Forces, and what was done to find out, that the controller tells of after a tick.
void take_news(const tiller_info_t& info, RecordEntry& entry);

/// Record files are of one build of tiller: structs as they are in memory. Layout: "TILLREC2", uint32 sizes of
/// Config and of RecordEntry, the configuration with its arrays and its pointers zero, uint32 components and dimension
/// of the joint prior (zero: none), its weights, means and roots, then entries.
std::string record_header(const tiller_config_t& config);
void write_record_header(OutputFile& file, const tiller_config_t& config);
void write_record(OutputFile& file, const RecordEntry& entry);

/// False with a message in `error` that names the file and what is wrong with it. `joint` becomes what
/// config.prior_mixture points to, or null.
bool read_record_header(std::istream& file, const std::string& path, Config& config,
                        std::shared_ptr<const JointPrior>& joint, std::string& error);
/// The same with the entries; one that is cut off at the end is left out.
bool read_record_file(const std::string& path, Config& config, std::shared_ptr<const JointPrior>& joint,
                      std::vector<RecordEntry>& entries, std::string& error);

}  // namespace tiller::tools
