#pragma once

#include "tools/run/foresight.hpp"
#include "tools/run/run_result.hpp"

namespace tiller::tools {

/// The files that a run writes.
class RunFiles {
 public:
  /// `goal_kinds`: of RunTask.
  RunFiles(const RobotFile& robot, const RunOptions& options, bool has_truth, std::uint32_t goal_kinds);

  bool wanted() const { return recorder_.wanted(); }
  void start(const tiller_config_t& config) { recorder_.start(config); }
  LogState state() const { return recorder_.state(); }
  /// After each tick: adds what the files alone tell of it, and hands it over.
  void take(const tiller_t* controller, LoggedTick& tick);
  void close(RunResult& result);

 private:
  const tiller_config_t& config_;
  Recorder recorder_;
  Foresight foresight_;
};

}  // namespace tiller::tools
