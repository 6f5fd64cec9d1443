#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include "tiller/tiller.h"

namespace tiller_test {

/// A real pool behind tiller_hooks_t::parallel_for: workers take indices as they come, so the order differs each time.
class ThreadPool {
 public:
  explicit ThreadPool(std::uint32_t threads) {
    for (std::uint32_t i = 1; i < threads; ++i) workers_.emplace_back([this] { serve(); });
  }
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;
  ~ThreadPool() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }

  tiller_hooks_t hooks() {
    tiller_hooks_t h{};
    h.size = sizeof h;
    h.version = TILLER_CONFIG_VERSION;
    h.context = this;
    h.parallel_for = [](void* context, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
      static_cast<ThreadPool*>(context)->run(n, work, arg);
    };
    return h;
  }
  std::uint64_t served_by_workers() const { return served_by_workers_; }

 private:
  void run(std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      work_ = work;
      arg_ = arg;
      count_ = n;
      next_ = 0;
      busy_ = static_cast<std::uint32_t>(workers_.size());
      ++round_;
    }
    wake_.notify_all();
    drain();
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return busy_ == 0; });
  }
  std::uint32_t drain() {
    std::uint32_t served = 0;
    for (std::uint32_t i = next_++; i < count_; i = next_++, ++served) work_(arg_, i);
    return served;
  }
  void serve() {
    std::uint64_t seen = 0;
    for (;;) {
      {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [&] { return stop_ || round_ != seen; });
        if (stop_) return;
        seen = round_;
      }
      served_by_workers_ += drain();
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        --busy_;
      }
      done_.notify_one();
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  bool stop_ = false;
  std::uint64_t round_ = 0;
  std::uint32_t busy_ = 0, count_ = 0;
  std::atomic<std::uint32_t> next_{0};
  std::atomic<std::uint64_t> served_by_workers_{0};
  void (*work_)(void*, std::uint32_t) = nullptr;
  void* arg_ = nullptr;
};

}  // namespace tiller_test
