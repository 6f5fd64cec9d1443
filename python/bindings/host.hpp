#pragma once

#include <atomic>
#include <cstdlib>
#include <memory>
#include <optional>
#include <vector>

#include "robot.hpp"
#include "tiller/config.hpp"
#include "tools/base/thread_pool.hpp"

namespace tiller::python {

/// A controller with its block, threads and clock, as a process on Linux has them.
class Host {
 public:
  /// Raises StatusError with the configuration's field that is at fault. `by_clock`: the planner keeps the deadline of
  /// the robot file; else its iterations alone decide, and the same measurements give the same commands.
  /// `seed`: of its random numbers, in the place of the robot file's.
  Host(Robot robot, unsigned threads, bool by_clock, std::optional<std::uint64_t> seed);
  Host(const Host&) = delete;
  Host& operator=(const Host&) = delete;

  tiller_t* get() const { return controller_; }
  const Robot& robot() const { return robot_; }
  const Config& config() const { return config_; }
  std::size_t block_bytes() const { return size_; }
  std::vector<double>& state_rows() { return state_rows_; }
  std::vector<double>& output_rows() { return output_rows_; }

  /// One thread at a time: raises StatusError (wrong_state) for a second one, and ends with the scope.
  class Turn {
   public:
    Turn(Host& host, const char* where);
    ~Turn() { host_.taken_.store(false, std::memory_order_release); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    Host& host_;
  };

 private:
  struct FreeBlock {
    void operator()(void* block) const { std::free(block); }
  };

  Robot robot_;
  Config config_;
  tools::ThreadPool pool_;
  tiller_hooks_t hooks_{};
  std::unique_ptr<void, FreeBlock> block_;
  std::size_t size_ = 0;
  tiller_t* controller_ = nullptr;
  std::vector<double> state_rows_, output_rows_;  // of set_reference: they outlive the controller or the next goal
  std::atomic<bool> taken_{false};
};

}  // namespace tiller::python
