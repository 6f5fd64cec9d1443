#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

namespace tiller::tools {

/// Threads for tiller_hooks_t::parallel_for. The calling thread works too, so one thread means no other.
/// Work is handed out by a counter: which thread does which index is chance, and the library's results do not
/// depend on it. A call costs a wake-up (5..50 us) per thread and nothing on the heap.
class ThreadPool {
 public:
  explicit ThreadPool(unsigned threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  unsigned size() const { return static_cast<unsigned>(workers_.size()) + 1; }
  void run(std::uint32_t n, void (*work)(void* arg, std::uint32_t index), void* arg);

 private:
  void serve();
  void take_all();

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable begin_, done_;
  std::uint64_t generation_ = 0;  // guarded by mutex_, as are the next two
  unsigned busy_ = 0;
  bool ending_ = false;
  std::uint32_t n_ = 0;  // the job: written before the workers wake, read until busy_ is zero
  void (*work_)(void*, std::uint32_t) = nullptr;
  void* arg_ = nullptr;
  std::atomic<std::uint32_t> next_{0};
};

}  // namespace tiller::tools
