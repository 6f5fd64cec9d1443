#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

/// A stack of its own, painted before anything runs on it: how deep calls went is read from the paint.
class PaintedStack {
 public:
  explicit PaintedStack(std::size_t bytes);
  ~PaintedStack();
  PaintedStack(const PaintedStack&) = delete;
  PaintedStack& operator=(const PaintedStack&) = delete;

  /// False where the machine gives no memory for it.
  bool good() const { return base_ != nullptr; }
  /// Runs `work` on it, in this thread. Below it lies a page that nobody may touch: a call that goes deeper than
  /// the stack ends the program.
  void run(const std::function<void()>& work);
  /// Bytes of the deepest call so far.
  std::size_t used() const;

 private:
  unsigned char* base_ = nullptr;
  std::size_t size_ = 0, guard_ = 0;
};

/// Stack that a controller takes of the thread which calls it, measured on this computer.
struct StackUse {
  std::size_t init_bytes = 0;  ///< tiller_init
  std::size_t tick_bytes = 0;  ///< the deepest of the ticks
  std::uint64_t plans = 0;     ///< finite ones that these ticks have made
};

/// A controller of this configuration is made and runs `ticks` ticks on its own model, after those that fill its
/// windows. What helper threads of a parallel_for take is a part of it. False with the reason in `error`.
bool measure_stack(const tiller_config_t& config, std::uint32_t ticks, StackUse& use, std::string& error);

/// Bounds on a Cortex-M7 by the calls of an image (stack_bounds.def); zeros for a model or an engine that none has.
struct StackBound {
  std::size_t init_bytes = 0, tick_bytes = 0;
};
StackBound stack_bound(const tiller_config_t& config);

}  // namespace tiller::tools
