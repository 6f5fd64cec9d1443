#include "tools/doctor/work_count.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <vector>

#include "rollout/path.hpp"
#include "rollout/residual.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/doctor/tireless.hpp"
#include "tools/links/trial_plant.hpp"

namespace tiller::tools {
namespace {

// ---- kernels that count ---------------------------------------------------------------------------

using Clock = std::chrono::steady_clock;

ModelWork counted;
Clock::duration in_kernels;            // wall time of what is counted
const RolloutTable* behind = nullptr;  // what does the work

template <class Work>
void timed(const Work& work) {
  const auto begin = Clock::now();
  work();
  in_kernels += Clock::now() - begin;
}
void rollout_f32(const tiller_model_t& model, const RolloutJob<float>& job) {
  counted.rollout_f32 += std::uint64_t{job.lanes} * job.horizon * job.setup->substeps;
  timed([&] { behind->rollout_f32(model, job); });
}
void rollout_f64(const tiller_model_t& model, const RolloutJob<double>& job) {
  counted.rollout_f64 += std::uint64_t{job.lanes} * job.horizon * job.setup->substeps;
  timed([&] { behind->rollout_f64(model, job); });
}
void linearise(const tiller_model_t& model, const LineariseJob& job) {
  counted.linearise += std::uint64_t{job.lanes} * job.setup->substeps;
  timed([&] { behind->linearise(model, job); });
}
void residual(const tiller_model_t& model, const ResidualJob& job) {
  counted.residual += std::uint64_t{job.lanes} * job.count * job.setup->substeps;
  timed([&] { behind->residual(model, job); });
}
void path_linearise(const tiller_model_t& model, const PathJob& job) {
  counted.path_linearise += std::uint64_t{job.horizon} * job.scenarios * job.setup->substeps;
  timed([&] { select_path(*behind).linearise(model, job); });
}
void path_feedback(const tiller_model_t& model, const FeedbackJob& job) {
  counted.path_feedback += std::uint64_t{job.horizon} * job.scenarios * kCandidates * job.setup->substeps;
  timed([&] { select_path(*behind).feedback(model, job); });
}

/// A model whose kernels count; one at a time.
class CountingModel {
 public:
  explicit CountingModel(const tiller_model_t& model) : model_(model), table_(select_rollout(model)) {
    behind = &select_rollout(model);
    path_ = {&path_linearise, &path_feedback};
    table_.rollout_f32 = &rollout_f32;
    table_.rollout_f64 = &rollout_f64;
    table_.linearise = &linearise;
    table_.residual = behind->residual ? &residual : nullptr;
    table_.path = &path_;
    kernels_.table[static_cast<int>(best_isa())] = &table_;
    model_.kernels = &kernels_;
  }
  const tiller_model_t& model() const { return model_; }

 private:
  tiller_model_t model_;
  RolloutTable table_;
  PathKernel path_;
  ModelKernels kernels_{};
};

// ---- the run ----------------------------------------------------------------------------------------

using Field = std::uint64_t ModelWork::*;
constexpr Field kFields[] = {&ModelWork::rollout_f32, &ModelWork::rollout_f64,    &ModelWork::linearise,
                             &ModelWork::residual,    &ModelWork::path_linearise, &ModelWork::path_feedback};

// ---- what a step costs ------------------------------------------------------------------------------

struct StepCost {
  const char* model;
  std::uint32_t states, integrator, effects;
  double instructions[6];  // in the order of kFields
};
const StepCost kCosts[] = {
#define TILLER_STEP_COST(model, states, integrator, effects, f32, f64, linearise, residual, path, feedback) \
  {#model, states, integrator, effects, {f32, f64, linearise, residual, path, feedback}},
#include "tools/doctor/instruction_costs.def"
#undef TILLER_STEP_COST
};

bool same_setting(const StepCost& cost, const tiller_config_t& config) {
  return cost.integrator == config.integrator && (cost.effects != 0) == (config.effect_count != 0);
}

const StepCost& cost_of(const tiller_config_t& config, std::string& stand_in) {
  const StepCost* nearest = nullptr;
  const auto distance = [&](const StepCost& c) {
    return std::abs(static_cast<int>(c.states) - static_cast<int>(config.model->state_count));
  };
  for (const StepCost& cost : kCosts) {
    if (!same_setting(cost, config)) continue;
    if (std::string(cost.model) == config.model->name) return cost;
    if (!nearest || distance(cost) < distance(*nearest)) nearest = &cost;
  }
  stand_in = nearest->model;
  return *nearest;
}

// ---- the run ----------------------------------------------------------------------------------------

constexpr std::uint32_t kTimedTicks = 40;

struct CountedTick {
  ModelWork work;
  double tick_s = 0.0, kernel_s = 0.0;  // wall time: of the tick, and of it in counted kernels
  std::uint32_t iterations = 0;
};

std::int64_t now_ns(void*) { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

/// A controller that steers its own model, with kernels that count. `by_clock`: the planner's deadline holds.
class CountedController {
 public:
  CountedController(const tiller_config_t& config, bool by_clock)
      : counting_(*config.model), config_(config), plant_(config, config.substeps) {
    config_.model = &counting_.model();
    never_tire(config_.safety);
    if (by_clock)
      hooks_.now_ns = now_ns;
    else
      config_.planner.deadline_us = 0;  // what is counted is the cap
  }
  bool begin(std::string& error) {
    const std::size_t size = tiller_size(&config_);
    block_.reset(
        std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT));
    const tiller_status_t status = tiller_init(&controller_, &config_, &hooks_, block_.get(), size);
    if (status == tiller_status_ok && plant_.good() && tiller_arm(controller_) == tiller_status_ok) return true;
    error = tiller_status_text(status);
    return false;
  }
  /// The first ticks begin the filters and fill the windows.
  std::uint32_t warm_up() const { return config_.posterior.window + 2; }

  CountedTick tick() {
    const tiller_measurement_t m = plant_.measure(ticks_++);
    tiller_command_t command;
    counted = {};
    in_kernels = {};
    const auto begin = Clock::now();
    (void)tiller_tick(controller_, m.stamp_us, &m, &command);
    CountedTick tick;
    tick.tick_s = std::chrono::duration<double>(Clock::now() - begin).count();
    tick.kernel_s = std::chrono::duration<double>(in_kernels).count();
    tick.work = counted;
    tiller_info_t info;
    tiller_get_info(controller_, &info);
    tick.iterations = info.planner_iterations;
    plant_.step(command.value);
    return tick;
  }

 private:
  struct FreeBlock {
    void operator()(void* block) const { std::free(block); }
  };
  const CountingModel counting_;
  Config config_;
  TrialPlant plant_;  // of the model itself: its steps are not the controller's
  tiller_hooks_t hooks_ = {sizeof(tiller_hooks_t), TILLER_CONFIG_VERSION, nullptr, nullptr, nullptr};
  std::unique_ptr<void, FreeBlock> block_;
  tiller_t* controller_ = nullptr;
  std::uint32_t ticks_ = 0;
};

}  // namespace

std::uint64_t ModelWork::steps() const {
  std::uint64_t sum = 0;
  for (const Field field : kFields) sum += this->*field;
  return sum;
}

double ModelWork::instructions(const tiller_config_t& config, std::string& stand_in) const {
  const StepCost& cost = cost_of(config, stand_in);
  double sum = 0.0;
  for (std::size_t i = 0; i < std::size(kFields); ++i)
    sum += static_cast<double>(this->*kFields[i]) * cost.instructions[i];
  return sum;
}

bool count_work(const tiller_config_t& config, std::uint32_t ticks, ModelWork& mean, ModelWork& most,
                std::string& error) {
  CountedController controller(config, false);
  if (!controller.begin(error)) return false;
  ModelWork sum;
  mean = most = {};
  for (std::uint32_t tick = 0; tick < controller.warm_up() + ticks; ++tick) {
    const ModelWork work = controller.tick().work;
    if (tick < controller.warm_up()) continue;
    for (const Field field : kFields) {
      sum.*field += work.*field;
      most.*field = std::max(most.*field, work.*field);
    }
  }
  for (const Field field : kFields) mean.*field = (sum.*field + ticks / 2) / ticks;
  return true;
}

bool time_ticks(const tiller_config_t& config, double budget_s, bool by_clock, TickTime& time, std::string& error) {
  CountedController controller(config, by_clock);
  if (!controller.begin(error)) return false;
  const auto end = Clock::now() + std::chrono::duration<double>(budget_s);
  const std::uint32_t most = controller.warm_up() + kTimedTicks;
  std::vector<CountedTick> ticks;
  (void)controller.tick();  // cold
  do ticks.push_back(controller.tick());
  while (ticks.size() < most && Clock::now() < end);
  // the later half: windows are as full as they get in that time
  ticks.erase(ticks.begin(), ticks.begin() + static_cast<std::ptrdiff_t>(ticks.size() / 2));
  std::nth_element(ticks.begin(), ticks.begin() + static_cast<std::ptrdiff_t>(ticks.size() / 2), ticks.end(),
                   [](const CountedTick& a, const CountedTick& b) { return a.tick_s < b.tick_s; });
  const CountedTick& median = ticks[ticks.size() / 2];
  time.tick_s = median.tick_s;
  time.steps = median.work.steps();
  time.step_s = time.steps > 0 ? median.kernel_s / static_cast<double>(time.steps) : 0.0;
  time.iterations = median.iterations;
  return true;
}

}  // namespace tiller::tools
