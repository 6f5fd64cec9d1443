#include "tools/run/run_files.hpp"

#include <chrono>
#include <cmath>
#include <cstdio>

#include "abi/controller.hpp"
#include "io/monotonic_clock.hpp"
#include "tools/base/exit_codes.hpp"

namespace tiller::tools {
namespace {

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

RecorderOptions recorder_options(const RunOptions& options, bool has_truth, std::uint32_t goal_kinds) {
  RecorderOptions recorder = options.files;
  recorder.has_truth = has_truth;
  recorder.goals = goal_kinds;
  recorder.lossless = !options.real_time;
  if (options.real_time) recorder.epoch_us = wall_us() - monotonic_us();
  return recorder;
}

}  // namespace

RunFiles::RunFiles(const RobotFile& robot, const RunOptions& options, bool has_truth, std::uint32_t goal_kinds)
    : config_(robot.config),
      recorder_(robot, recorder_options(options, has_truth, goal_kinds)),
      foresight_(robot.config.planner.horizon, robot.config.model->state_count) {}

void RunFiles::take(const tiller_t* controller, LoggedTick& tick) {
  if (config_.planner.predict_spread != 0) foresight_.look(controller, tick.info);
  tick.was_foreseen = foresight_.recall(tick.info, tick.foreseen_mean, tick.foreseen_sd);
  if (!wanted()) return;
  if (tiller_get_record(controller, tick.info.ticks - 1, &tick.entry.record) != tiller_status_ok) return;
  take_news(tick.info, tick.entry);
  if (config_.cost.outputs) (void)tiller_get_outputs(controller, tick.outputs);
  // a tick without a measurement has none, and neither has one that tests nothing
  const bool fresh = tick.entry.record.has_measurement != 0;
  const AdequacyTest* test = fresh ? controller->executive->posterior().adequacy() : nullptr;
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k) tick.innovation[k] = test ? test->residual(k) : NAN;
  recorder_.push(tick);
}

void RunFiles::close(RunResult& result) {
  result.files = recorder_.stop();
  for (const std::string& message : result.files.messages) std::fprintf(stderr, "tiller: %s\n", message.c_str());
  result.log = recorder_.state();
  if (!result.files.complete) result.exit_code = kExitLogIncomplete;
}

}  // namespace tiller::tools
