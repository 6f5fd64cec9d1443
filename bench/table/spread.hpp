#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace tiller::bench {

/// work(i) for i in 0..count-1 on `threads` threads, with progress on the terminal.
template <class Work>
void spread(const std::string& what, int count, unsigned threads, const Work& work) {
  std::atomic<int> next{0}, done{0};
  std::mutex printing;
  auto last = std::chrono::steady_clock::now();
  const auto loop = [&] {
    for (int i = next++; i < count; i = next++) {
      work(i);
      ++done;
      const std::lock_guard<std::mutex> lock(printing);
      const auto now = std::chrono::steady_clock::now();
      if (now - last < std::chrono::seconds(1)) continue;
      last = now;
      std::fprintf(stderr, "\r\033[K%s: %d of %d", what.c_str(), done.load(), count);
    }
  };
  std::vector<std::thread> pool;
  for (unsigned i = 1; i < threads; ++i) pool.emplace_back(loop);
  loop();
  for (std::thread& t : pool) t.join();
  std::fprintf(stderr, "\r\033[K");
}

}  // namespace tiller::bench
