#include "tools/run/host_controller.hpp"

#include <chrono>

#include "io/realtime.hpp"

namespace tiller::tools {
namespace {

std::int64_t now_ns(void*) {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void parallel_for(void* pool, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  static_cast<ThreadPool*>(pool)->run(n, work, arg);
}

/// A few ticks of a controller of its own, so that code, lanes and threads are warm when the robot's first tick
/// comes: cold, it takes six times as long on a desk machine, and seconds where the processor is emulated.
void rehearse(const tiller_config_t& config, tiller_t* rehearsal) {
  tiller_measurement_t m{};
  tiller_command_t command;
  for (std::uint32_t i = 0; i < config.measurement_count; ++i) {
    m.value[i] = config.initial_state[config.measured_state[i]];
  }
  (void)tiller_arm(rehearsal);
  for (std::uint32_t tick = 1; tick <= 3; ++tick) {
    m.sequence = tick;
    m.stamp_us = static_cast<std::int64_t>(1e6 * config.period_s * tick);
    (void)tiller_tick(rehearsal, m.stamp_us, &m, &command);
    (void)tiller_prepare(rehearsal);
  }
}

}  // namespace

bool HostController::lay_out(const tiller_config_t& config, Block& block, tiller_t*& controller, std::string& error) {
  constexpr std::size_t alignment = TILLER_ALIGNMENT;
  const std::size_t size = tiller_size(&config);
  if (size > 0) block.reset(std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment));
  if (!block) {
    const char* field = "";
    const tiller_status_t status = tiller_config_check(&config, &field);
    error = std::string(field ? field : "") + ": " + tiller_status_text(status);
    return false;
  }
  const tiller_status_t status = tiller_init(&controller, &config, &hooks_, block.get(), size);
  if (real_time_) touch_pages(block.get(), size);
  if (status != tiller_status_ok) error = tiller_status_text(status);
  return status == tiller_status_ok;
}

bool HostController::make(const tiller_config_t& config, std::string& error) {
  hooks_.size = sizeof hooks_;
  hooks_.version = TILLER_CONFIG_VERSION;
  hooks_.context = &pool_;
  hooks_.now_ns = now_ns;
  hooks_.parallel_for = pool_.size() > 1 ? parallel_for : nullptr;
  Block spare;
  tiller_t* rehearsal = nullptr;
  if (lay_out(config, spare, rehearsal, error) && lay_out(config, block_, controller_, error)) {
    rehearse(config, rehearsal);
    return true;
  }
  error = robot_.path + ": " + error;
  return false;
}

}  // namespace tiller::tools
