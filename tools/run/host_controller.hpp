#pragma once

#include <cstdlib>
#include <memory>
#include <string>

#include "tiller/tiller.h"
#include "tools/base/thread_pool.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/run/realtime_run.hpp"

namespace tiller::tools {

/// A controller with what a process on Linux gives it: its block, threads, a clock, real time.
class HostController {
 public:
  HostController(const RobotFile& robot, bool real_time, unsigned threads)
      : robot_(robot), real_time_(real_time), realtime_(robot, real_time), pool_(threads) {}

  /// Lays the controller out and makes code, lanes and threads warm. In real time the block's pages are there before
  /// the first tick asks for them. False with a sentence in `error`.
  bool make(const tiller_config_t& config, std::string& error);
  tiller_t* get() const { return controller_; }
  const RealtimeReport& realtime() const { return realtime_.report(); }

 private:
  struct FreeBlock {
    void operator()(void* block) const { std::free(block); }
  };
  using Block = std::unique_ptr<void, FreeBlock>;

  bool lay_out(const tiller_config_t& config, Block& block, tiller_t*& controller, std::string& error);

  const RobotFile& robot_;
  bool real_time_;
  RealtimeGuard realtime_;  // before the threads that a tick uses
  ThreadPool pool_;
  tiller_hooks_t hooks_{};
  Block block_;
  tiller_t* controller_ = nullptr;
};

}  // namespace tiller::tools
