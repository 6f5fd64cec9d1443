#include "tools/open/visited_states.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "tiller/config.hpp"
#include "tools/links/trial_plant.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kFewestPeriods = 50, kMostPeriods = 200, kMostHorizon = 50;
constexpr std::uint32_t kPlanSubsteps = 2, kPlantSubsteps = 16;  // fine enough to follow, not to be judged

struct FreeBlock {
  void operator()(void* block) const { std::free(block); }
};

/// The same task for a controller that costs little: nothing to learn, one hypothesis, few samples.
Config cheap(const tiller_config_t& config, std::uint32_t planner) {
  Config c = config;
  for (std::uint32_t i = 0; i < c.param_count; ++i) {
    const double centre = centre_of(c.priors[i]);
    c.priors[i] = {tiller_prior_fixed, 0, centre, 0, centre, centre};
  }
  c.prior_mixture = nullptr;
  c.substeps = kPlanSubsteps;
  c.record_ticks = 0;
  Config plain;
  if (tiller_config_default(&plain, config.model) == tiller_status_ok) c.posterior = plain.posterior;
  c.posterior.enabled = 0;
  c.posterior.particles = c.posterior.window = 16;
  c.posterior.moves_per_tick = 0;
  c.posterior.adequacy = 0;
  c.planner.kind = planner;
  c.planner.horizon = std::min(c.planner.horizon, kMostHorizon);
  c.planner.knots = std::min(c.planner.knots, c.planner.horizon);
  c.planner.hold_steps = std::min(c.planner.hold_steps, c.planner.horizon);
  c.planner.rollouts = std::min(c.planner.rollouts, 64u);
  c.planner.nodes = std::min(c.planner.nodes, 256u);
  c.planner.particles = 1;
  c.planner.iterations = std::min(c.planner.iterations, 2u);
  c.planner.deadline_us = 0;
  c.safety.frozen_ticks = 0;  // the model may rest
  return c;
}

/// A controller and its block.
class Controller {
 public:
  explicit Controller(const tiller_config_t& config) {
    const std::size_t size = tiller_size(&config);
    if (size == 0) return;
    block_.reset(
        std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT));
    if (!block_ || tiller_init(&controller_, &config, nullptr, block_.get(), size) != tiller_status_ok ||
        tiller_arm(controller_) != tiller_status_ok)
      controller_ = nullptr;
  }
  tiller_t* get() const { return controller_; }

 private:
  std::unique_ptr<void, FreeBlock> block_;
  tiller_t* controller_ = nullptr;
};

bool all_finite(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

void append(std::vector<double>& rows, const std::vector<double>& row) {
  rows.insert(rows.end(), row.begin(), row.end());
}

void note(const TrialPlant& plant, const double* input, std::uint32_t nu, VisitedStates& path) {
  append(path.state, plant.state());
  append(path.effect_state, plant.effect_state());
  append(path.history, plant.history());
  path.input.insert(path.input.end(), input, input + nu);
  ++path.count;
}

std::uint32_t periods_of(const tiller_config_t& config) {
  const std::uint32_t wanted =
      std::max(2 * config.planner.horizon, config.cost.reference ? config.cost.reference_steps : 0);
  return std::clamp(wanted, kFewestPeriods, kMostPeriods);
}

bool steer(const tiller_config_t& config, std::uint32_t planner, TrialPlant& plant, VisitedStates& path) {
  const Config c = cheap(config, planner);
  const Controller controller(c);
  if (!controller.get()) return false;
  for (std::uint32_t tick = 0; tick < periods_of(config); ++tick) {
    const tiller_measurement_t m = plant.measure(tick);
    tiller_command_t command;
    (void)tiller_tick(controller.get(), m.stamp_us, &m, &command);
    if (command.state == tiller_state_safe) break;
    note(plant, command.value, config.model->input_count, path);
    plant.step(command.value);
    if (!all_finite(plant.state())) break;
  }
  return path.count > 0;
}

}  // namespace

VisitedStates visit_states(const tiller_config_t& config) {
  VisitedStates path;
  TrialPlant plant(config, kPlantSubsteps);
  path.effect_states = static_cast<std::uint32_t>(plant.effect_state().size());
  path.history_numbers = static_cast<std::uint32_t>(plant.history().size());
  if (plant.good() &&
      (steer(config, tiller_planner_ilqr, plant, path) || steer(config, config.planner.kind, plant, path)))
    return path;
  note(plant, config.safety.safe_command, config.model->input_count, path);
  return path;
}

}  // namespace tiller::tools
