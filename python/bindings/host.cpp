#include "host.hpp"

#include <chrono>
#include <new>

#include "errors.hpp"

namespace tiller::python {
namespace {

std::int64_t now_ns(void*) {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void parallel_for(void* pool, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  static_cast<tools::ThreadPool*>(pool)->run(n, work, arg);
}

}  // namespace

Host::Host(Robot robot, unsigned threads, bool by_clock, std::optional<std::uint64_t> seed)
    : robot_(std::move(robot)), config_(robot_->config), pool_(threads) {
  if (!by_clock) config_.planner.deadline_us = 0;
  if (seed) config_.seed = *seed;
  hooks_.size = sizeof hooks_;
  hooks_.version = TILLER_CONFIG_VERSION;
  hooks_.context = &pool_;
  hooks_.now_ns = now_ns;
  hooks_.parallel_for = pool_.size() > 1 ? parallel_for : nullptr;
  const char* field = "";
  const tiller_status_t wrong = tiller_config_check(&config_, &field);
  if (wrong != tiller_status_ok) raise_status(wrong, "Controller: " + robot_->path, field ? field : "");
  constexpr std::size_t alignment = TILLER_ALIGNMENT;
  size_ = tiller_size(&config_);
  block_.reset(std::aligned_alloc(alignment, (size_ + alignment - 1) / alignment * alignment));
  if (!block_) throw std::bad_alloc();
  check_status(tiller_init(&controller_, &config_, &hooks_, block_.get(), size_), "Controller");
}

Host::Turn::Turn(Host& host, const char* where) : host_(host) {
  if (host.taken_.exchange(true, std::memory_order_acquire))
    raise_status(tiller_status_wrong_state, std::string(where) + ": another thread is inside this controller");
}

}  // namespace tiller::python
