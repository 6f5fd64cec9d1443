#include "tools/substeps.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/rng.hpp"
#include "rollout/rollout.hpp"
#include "tools/plant_setup.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kLanes = 16, kMostPeriods = 100, kMostSubsteps = 64;
constexpr double kTolerance = 0.1;  // of the noise

double draw(const tiller_prior_t& prior, Rng& rng) {
  return draw_from_prior(
      prior, [](void* context) { return static_cast<Rng*>(context)->uniform(); }, &rng);
}

/// What the trial trajectories share: everything but the substeps.
class Trial {
 public:
  explicit Trial(const tiller_config_t& config)
      : config_(config),
        table_(select_rollout(*config.model)),
        nx_(config.model->state_count),
        nu_(config.model->input_count),
        periods_(std::clamp(config.planner.horizon, 2u, kMostPeriods)) {
    Rng rng(1, kRngPrior, 0);
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l) params_.push_back(draw(config.priors[i], rng));
    params_.resize(std::size_t{TILLER_MAX_PARAMS} * kLanes);
    for (std::uint32_t i = 0; i < nx_; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        start_.push_back(config.initial_state[i] + config.initial_state_sd[i] * rng.normal());
    draw_inputs(rng);
  }

  /// RMS over trajectories and periods of the change that halving the substeps makes, state by state.
  std::vector<double> error(std::uint32_t substeps) const {
    const std::vector<double> path = follow(kMostSubsteps / 4);
    std::vector<double> sum(nx_), coarse, fine;
    for (std::uint32_t k = 0; k < periods_; ++k) {
      const double* from = path.data() + std::size_t{k} * nx_ * kLanes;
      coarse = one_period(from, k, substeps);
      fine = one_period(from, k, 2 * substeps);
      for (std::uint32_t i = 0; i < nx_; ++i)
        for (std::uint32_t l = 0; l < kLanes; ++l) {
          const double d = coarse[i * kLanes + l] - fine[i * kLanes + l];
          if (std::isfinite(d)) sum[i] += d * d;
        }
    }
    for (double& s : sum) s = std::sqrt(s / (kLanes * periods_));
    return sum;
  }

 private:
  /// Random walks through the inputs' range: smooth enough to move the robot, bold enough to reach the limits.
  void draw_inputs(Rng& rng) {
    inputs_.resize(std::size_t{periods_} * nu_ * kLanes);
    for (std::uint32_t j = 0; j < nu_; ++j)
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        const double low = config_.safety.input_low[j], high = config_.safety.input_high[j];
        double u = std::clamp(0.0, low, high);
        for (std::uint32_t k = 0; k < periods_; ++k) {
          u = std::clamp(u + 0.25 * (high - low) * rng.normal(), low, high);
          inputs_[(std::size_t{k} * nu_ + j) * kLanes + l] = u;
        }
      }
  }
  RolloutJob<double> job(const StepSetup& setup, const double* state, std::uint32_t first, std::uint32_t count) const {
    RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = count;
    job.state = {state, kLanes};
    job.params = {params_.data(), kLanes};
    job.effect_state = {zero_, 0};
    job.controls = {inputs_.data() + std::size_t{first} * nu_ * kLanes, kLanes};
    job.history = zero_;
    return job;
  }
  std::vector<double> follow(std::uint32_t substeps) const {
    StepSetup setup = with(substeps);
    std::vector<double> path(std::size_t{periods_ + 1} * nx_ * kLanes);
    RolloutJob<double> all = job(setup, start_.data(), 0, periods_);
    all.trajectory = path.data();
    table_.rollout_f64(*config_.model, all);
    return path;
  }
  std::vector<double> one_period(const double* from, std::uint32_t k, std::uint32_t substeps) const {
    StepSetup setup = with(substeps);
    std::vector<double> to(std::size_t{nx_} * kLanes);
    RolloutJob<double> one = job(setup, from, k, 1);
    one.final_state = to.data();
    table_.rollout_f64(*config_.model, one);
    return to;
  }
  StepSetup with(std::uint32_t substeps) const {
    StepSetup setup;
    if (make_step_setup(config_, setup) != tiller_status_ok) return setup;
    setup.substeps = substeps;
    return setup;
  }

  const tiller_config_t& config_;
  const RolloutTable& table_;
  std::uint32_t nx_, nu_, periods_;
  std::vector<double> params_, start_, inputs_;
  double zero_[TILLER_MAX_EFFECT_STATES + TILLER_MAX_DELAY_STEPS * TILLER_MAX_INPUTS] = {};
};

}  // namespace

SubstepAdvice advise_substeps(const tiller_config_t& config) {
  const Trial trial(config);
  SubstepAdvice advice;
  const auto share = [&](std::uint32_t substeps, std::uint32_t* worst) {
    const std::vector<double> error = trial.error(substeps);
    double most = 0.0;
    for (std::uint32_t i = 0; i < error.size(); ++i) {
      const double noise = config.process_sd[i] * std::sqrt(config.period_s);
      if (!(noise > 0.0) || error[i] / noise <= most) continue;
      most = error[i] / noise;
      if (worst) *worst = i;
    }
    return most;
  };
  advice.error_share = share(config.substeps, &advice.worst_state);
  for (advice.needed = 1; advice.needed < kMostSubsteps; advice.needed *= 2)
    if (share(advice.needed, nullptr) <= kTolerance) break;
  return advice;
}

}  // namespace tiller::tools
