#pragma once

#include <cstdlib>
#include <memory>
#include <string>

#include "tiller/tiller.h"
#include "tools/base/thread_pool.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A controller with what a process on Linux gives it: its block, threads, a clock.
class HostController {
 public:
  explicit HostController(unsigned threads) : pool_(threads) {}

  /// Lays the controller out and makes code, lanes and threads warm. `touch`: the block's pages are there before the
  /// first tick asks for them. False with a sentence in `error`.
  bool make(const RobotFile& robot, const tiller_config_t& config, bool touch, std::string& error);
  tiller_t* get() const { return controller_; }

 private:
  struct FreeBlock {
    void operator()(void* block) const { std::free(block); }
  };
  using Block = std::unique_ptr<void, FreeBlock>;

  bool lay_out(const tiller_config_t& config, bool touch, Block& block, tiller_t*& controller, std::string& error);

  ThreadPool pool_;
  tiller_hooks_t hooks_{};
  Block block_;
  tiller_t* controller_ = nullptr;
};

}  // namespace tiller::tools
