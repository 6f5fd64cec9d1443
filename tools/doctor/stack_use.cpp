#include "tools/doctor/stack_use.hpp"

#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <memory>

#include "tiller/config.hpp"
#include "tools/doctor/tireless.hpp"
#include "tools/links/trial_plant.hpp"

namespace tiller::tools {
namespace {

constexpr unsigned char kPaint = 0xA5;
constexpr std::size_t kPlenty = std::size_t{8} << 20;  // as much as a thread has on Linux

struct Call {
  const std::function<void()>* work = nullptr;
  ucontext_t here, there;
};

/// makecontext passes ints: the call travels in two halves.
void enter(unsigned high, unsigned low) {
  auto* call = reinterpret_cast<Call*>((static_cast<std::uintptr_t>(high) << 16 << 16) | low);
  (*call->work)();
}

}  // namespace

PaintedStack::PaintedStack(std::size_t bytes) : guard_(static_cast<std::size_t>(sysconf(_SC_PAGESIZE))) {
  size_ = (bytes + guard_ - 1) / guard_ * guard_;
  void* memory = mmap(nullptr, size_ + guard_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return;
  base_ = static_cast<unsigned char*>(memory) + guard_;
  (void)mprotect(memory, guard_, PROT_NONE);
  std::memset(base_, kPaint, size_);
}

PaintedStack::~PaintedStack() {
  if (base_) (void)munmap(base_ - guard_, size_ + guard_);
}

void PaintedStack::run(const std::function<void()>& work) {
  Call call;
  call.work = &work;
  (void)getcontext(&call.there);
  call.there.uc_stack.ss_sp = base_;
  call.there.uc_stack.ss_size = size_;
  call.there.uc_link = &call.here;
  const auto at = reinterpret_cast<std::uintptr_t>(&call);
  makecontext(&call.there, reinterpret_cast<void (*)()>(enter), 2, static_cast<unsigned>(at >> 16 >> 16),
              static_cast<unsigned>(at));
  (void)swapcontext(&call.here, &call.there);
}

/// Stacks grow downwards: the lowest byte without paint is the deepest.
std::size_t PaintedStack::used() const {
  std::size_t untouched = 0;
  while (untouched < size_ && base_[untouched] == kPaint) ++untouched;
  return size_ - untouched;
}

bool measure_stack(const tiller_config_t& given, std::uint32_t ticks, StackUse& use, std::string& error) {
  Config config = given;
  never_tire(config.safety);
  config.planner.deadline_us = 0;
  TrialPlant plant(config, config.substeps);
  PaintedStack for_init(kPlenty), for_ticks(kPlenty);
  if (!for_init.good() || !for_ticks.good()) {
    error = "no memory to measure the stack in";
    return false;
  }
  const std::size_t size = tiller_size(&config);
  const std::unique_ptr<void, void (*)(void*)> block(
      std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT),
      std::free);
  const tiller_hooks_t hooks = {sizeof(tiller_hooks_t), TILLER_CONFIG_VERSION, nullptr, nullptr, nullptr};
  tiller_t* controller = nullptr;
  tiller_status_t status = tiller_status_ok;
  for_init.run([&] { status = tiller_init(&controller, &config, &hooks, block.get(), size); });
  if (status == tiller_status_ok) status = tiller_arm(controller);
  if (status != tiller_status_ok || !plant.good()) {
    error = tiller_status_text(status);
    return false;
  }
  for (std::uint32_t tick = 0; tick < config.posterior.window + 2 + ticks; ++tick) {
    const tiller_measurement_t m = plant.measure(tick);
    tiller_command_t command;
    for_ticks.run([&] { (void)tiller_tick(controller, m.stamp_us, &m, &command); });
    plant.step(command.value);
  }
  use.init_bytes = for_init.used();
  use.tick_bytes = for_ticks.used();
  tiller_info_t info;
  tiller_get_info(controller, &info);
  use.plans = info.plans;
  return true;
}

StackBound stack_bound(const tiller_config_t& config) {
  StackBound bound;
  const std::string model = config.posterior.kind == tiller_posterior_filter ? config.model->name : "";
  const auto take = [&](const char* of, const std::string& call, std::size_t bytes) {
    if (model == of) (call == "tiller_init" ? bound.init_bytes : bound.tick_bytes) = bytes;
  };
#define TILLER_STACK_BOUND(of, call, bytes) take(#of, #call, bytes);
#include "tools/doctor/stack_bounds.def"
  return bound;
}

}  // namespace tiller::tools
