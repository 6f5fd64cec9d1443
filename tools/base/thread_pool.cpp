#include "tools/base/thread_pool.hpp"

namespace tiller::tools {

ThreadPool::ThreadPool(unsigned threads) {
  for (unsigned i = 1; i < threads; ++i) workers_.emplace_back([this] { serve(); });
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ending_ = true;
  }
  begin_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(std::uint32_t n, void (*work)(void* arg, std::uint32_t index), void* arg) {
  if (workers_.empty() || n < 2) {
    for (std::uint32_t i = 0; i < n; ++i) work(arg, i);
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    n_ = n;
    work_ = work;
    arg_ = arg;
    next_.store(0, std::memory_order_relaxed);
    busy_ = static_cast<unsigned>(workers_.size());
    ++generation_;
  }
  begin_.notify_all();
  take_all();
  std::unique_lock<std::mutex> lock(mutex_);
  done_.wait(lock, [this] { return busy_ == 0; });
}

void ThreadPool::take_all() {
  for (std::uint32_t i; (i = next_.fetch_add(1, std::memory_order_relaxed)) < n_;) work_(arg_, i);
}

void ThreadPool::serve() {
  std::uint64_t seen = 0;
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    begin_.wait(lock, [&] { return ending_ || generation_ != seen; });
    if (ending_) return;
    seen = generation_;
    lock.unlock();
    take_all();
    lock.lock();
    if (--busy_ == 0) done_.notify_one();
  }
}

}  // namespace tiller::tools
