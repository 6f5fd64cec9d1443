#include "tools/open/substeps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/rng.hpp"
#include "rollout/rollout.hpp"
#include "tools/base/text.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/open/visited_states.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kLanes = 16, kMostPoints = 25, kExcursion = 4, kMostSubsteps = 64;
constexpr double kWander = 0.1;  // of an input's range, per period

double draw(const tiller_prior_t& prior, Rng& rng) {
  return draw_from_prior(
      prior, [](void* context) { return static_cast<Rng*>(context)->uniform(); }, &rng);
}

/// Row i of a path's point in every lane.
void spread(const double* row, std::size_t count, std::vector<double>& lanes) {
  lanes.resize(count * kLanes);
  for (std::size_t i = 0; i < count; ++i)
    std::fill_n(lanes.begin() + static_cast<std::ptrdiff_t>(i * kLanes), kLanes, row[i]);
}

/// Where the lanes stand at the beginning of a period.
struct Start {
  std::vector<double> state, effect_state;  // (nx x lanes), (ns x lanes)
  std::vector<double> input;                // (nu x lanes)
  std::vector<double> history;              // (rows x nu) newest first; lanes share it
};

/// One period from many states that the robot visits, with any number of substeps.
class Trial {
 public:
  explicit Trial(const tiller_config_t& config)
      : config_(config),
        table_(select_rollout(*config.model)),
        nx_(config.model->state_count),
        nu_(config.model->input_count) {
    Rng rng(1, kRngPrior, 0);
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l) params_.push_back(draw(config.priors[i], rng));
    params_.resize(std::size_t{TILLER_MAX_PARAMS} * kLanes);
    const VisitedStates path = visit_states(config);
    const std::uint32_t points = std::min(path.count, kMostPoints);
    for (std::uint32_t k = 0; k < points; ++k) wander(path, k * path.count / points, rng);
  }

  /// RMS over all starts and lanes of the change that halving the substeps makes, worst state over its noise.
  StepError error(std::uint32_t substeps) const {
    std::vector<double> sum(nx_), coarse, fine, effects;
    for (const Start& start : starts_) {
      one_period(start, substeps, coarse, effects);
      one_period(start, 2 * substeps, fine, effects);
      for (std::size_t n = 0; n < fine.size(); ++n) add_difference(coarse[n], fine[n], sum[n / kLanes]);
    }
    StepError worst;
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double noise = config_.process_sd[i] * std::sqrt(config_.period_s);
      const double share = std::sqrt(sum[i] / static_cast<double>(kLanes * starts_.size())) / noise;
      if (noise > 0.0 && share > worst.share) worst = {share, i};
    }
    return worst;
  }

 private:
  /// A motion that the finer step leaves finite and the coarse one does not is the worst error there is; where both
  /// fail, it is the model that has no answer.
  static void add_difference(double coarse, double fine, double& sum) {
    if (std::isfinite(fine))
      sum += std::isfinite(coarse) ? (coarse - fine) * (coarse - fine) : std::numeric_limits<double>::infinity();
  }

  /// A few periods off the path: parameters and inputs that are not the controller's own.
  void wander(const VisitedStates& path, std::uint32_t point, Rng& rng) {
    Start start;
    spread(path.state.data() + std::size_t{point} * nx_, nx_, start.state);
    spread(path.effect_state.data() + std::size_t{point} * path.effect_states, path.effect_states, start.effect_state);
    spread(path.input.data() + std::size_t{point} * nu_, nu_, start.input);
    const double* before = path.history.data() + std::size_t{point} * path.history_numbers;
    start.history.assign(before, before + path.history_numbers);
    for (std::uint32_t k = 0; k < kExcursion; ++k) {
      move_inputs(start.input, rng);
      starts_.push_back(start);
      one_period(starts_.back(), kMostSubsteps / 4, start.state, start.effect_state);
    }
  }
  void move_inputs(std::vector<double>& input, Rng& rng) const {
    for (std::uint32_t j = 0; j < nu_; ++j)
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        const double low = config_.safety.input_low[j], high = config_.safety.input_high[j];
        double& u = input[j * kLanes + l];
        u = std::clamp(u + kWander * (high - low) * rng.normal(), low, high);
      }
  }
  void one_period(const Start& start, std::uint32_t substeps, std::vector<double>& to,
                  std::vector<double>& effects) const {
    StepSetup setup;
    if (make_step_setup(config_, setup) != tiller_status_ok) return;
    setup.substeps = substeps;
    to.resize(start.state.size());
    std::vector<double> next_effects(start.effect_state.size());
    RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = 1;
    job.state = {start.state.data(), kLanes};
    job.params = {params_.data(), kLanes};
    job.effect_state = {start.effect_state.data(), kLanes};
    job.controls = {start.input.data(), kLanes};
    job.history = start.history.data();
    std::vector<double> next(start.state.size());
    job.final_state = next.data();
    job.final_effect_state = next_effects.data();
    table_.rollout_f64(*config_.model, job);
    to = std::move(next);
    effects = std::move(next_effects);
  }

  const tiller_config_t& config_;
  const RolloutTable& table_;
  std::uint32_t nx_, nu_;
  std::vector<double> params_;
  std::vector<Start> starts_;
};

}  // namespace

SubstepAdvice advise_substeps(const tiller_config_t& config) {
  const Trial trial(config);
  SubstepAdvice advice;
  advice.configured = trial.error(config.substeps);
  for (;; advice.needed *= 2) {
    advice.advised = trial.error(advice.needed);
    if (is_enough(advice) || advice.needed >= kMostSubsteps) return advice;
  }
}

std::string step_error_text(const RobotFile& robot) {
  const SubstepAdvice& advice = robot.substeps;
  const std::string with_needed =
      is_enough(advice) ? format("below %.1g", kStepErrorTolerance) : format("still %.2g", advice.advised.share);
  return format("%.2g of the noise expected of %s in a period (%s with %u substeps)", advice.configured.share,
                robot.names.states[advice.configured.worst_state].c_str(), with_needed.c_str(), advice.needed);
}

}  // namespace tiller::tools
