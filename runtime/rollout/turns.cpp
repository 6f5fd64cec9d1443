#include "rollout/turns.hpp"

#include <algorithm>
#include <cmath>

#include "core/element.hpp"
#include "core/rng.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kTries = kLanePadding;  // states that share parameters and inputs
constexpr std::uint32_t kRounds = 4;            // of those, each with its own
constexpr std::uint32_t kPeriods = 2;
// Rounding of an angle that is a turn larger, over the substeps of two periods; a spring that does less is not felt.
constexpr double kAlike = 1e-7;

double from_prior(const tiller_prior_t& prior, Rng& rng) {
  if (prior.kind == tiller_prior_fixed) return prior.a;  // whatever its bounds say
  double value = prior.a;
  if (prior.kind == tiller_prior_uniform) value = prior.low + (prior.high - prior.low) * rng.uniform();
  if (prior.kind == tiller_prior_normal) value = prior.a + prior.b * rng.normal();
  if (prior.kind == tiller_prior_log_normal) value = prior.a * math::exp(prior.b * rng.normal());
  return std::fmin(std::fmax(value, prior.low), prior.high);
}

/// One robot at kTries places, rolled out over kPeriods.
class Places {
 public:
  Places(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, std::uint32_t round)
      : config_(config),
        setup_(setup),
        table_(table),
        cost_(make_cost_terms<double>(config.cost, config.model->state_count)) {
    Rng rng(config.seed, kRngMotion, round);
    const tiller_model_t& model = *config.model;
    for (std::uint32_t l = 0; l < kTries; ++l)
      for (std::uint32_t i = 0; i < model.state_count; ++i) start_[i][l] = rng.normal();
    for (std::uint32_t i = 0; i < model.input_count * kPeriods; ++i) {
      const std::uint32_t u = i % model.input_count;
      const double low = config.safety.input_low[u], high = config.safety.input_high[u];
      control_[i] = low + (high - low) * rng.uniform();
    }
    for (std::uint32_t i = 0; i < config.param_count; ++i) param_[i] = from_prior(config.priors[i], rng);
    // the quadratic terms wrap their differences, bounds and the catalogue's terms move with the origin
    cost_.extra &= kCostOwnFunction | kCostOwnTemplate;
    if (config.model->output_count > 0) {
      for (tiller_output_cost_t& o : outputs_) o = {0.0, 1.0, 1.0, -INFINITY, INFINITY, 0.0};
      cost_.outputs = outputs_;
      cost_.output_reference = nullptr;
      cost_.extra |= kCostOutputs;
    }
    std::fill(cost_.state, cost_.state + TILLER_MAX_STATES, 0.0);
    std::fill(cost_.terminal, cost_.terminal + TILLER_MAX_STATES, 0.0);
  }

  /// Whether a turn of state `angle` makes no difference but itself.
  bool repeats(std::uint32_t angle) {
    roll(here_);
    for (double& x : start_[angle]) x += kTurn_rad;
    roll(turned_);
    for (double& x : start_[angle]) x -= kTurn_rad;
    std::uint32_t told = 0;
    for (std::uint32_t l = 0; l < kTries; ++l) {
      if (!finite(here_, l) || !finite(turned_, l)) continue;
      ++told;
      if (!alike(angle, l)) return false;
    }
    return told > 0;
  }

 private:
  struct Ends {
    double state[TILLER_MAX_STATES][kTries], effect[TILLER_MAX_EFFECT_STATES][kTries], cost[kTries];
  };

  void roll(Ends& to) const {
    RolloutJob<double> job;
    job.setup = &setup_;
    job.lanes = kTries;
    job.horizon = kPeriods;
    job.state = {start_[0], kTries};
    job.params = {param_, 0};
    job.effect_state = {effect_[0], kTries};
    job.controls = {control_, 0};
    job.history = history_;
    job.previous_input = history_;
    job.cost = &cost_;
    job.cost_out = to.cost;
    job.final_state = to.state[0];
    job.final_effect_state = setup_.effect_state_count > 0 ? to.effect[0] : nullptr;
    table_.rollout_f64(*config_.model, job);
  }
  bool finite(const Ends& e, std::uint32_t l) const {
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i)
      if (!std::isfinite(e.state[i][l])) return false;
    return std::isfinite(e.cost[l]);
  }
  static bool near(double a, double b) { return std::fabs(a - b) <= kAlike * (1.0 + std::fabs(a)); }
  bool alike(std::uint32_t angle, std::uint32_t l) const {
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i)
      if (!near(here_.state[i][l] + (i == angle ? kTurn_rad : 0.0), turned_.state[i][l])) return false;
    for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i)
      if (!near(here_.effect[i][l], turned_.effect[i][l])) return false;
    return near(here_.cost[l], turned_.cost[l]);
  }

  const tiller_config_t& config_;
  const StepSetup& setup_;
  const RolloutTable& table_;
  CostTerms<double> cost_;
  tiller_output_cost_t outputs_[TILLER_MAX_OUTPUTS];
  double start_[TILLER_MAX_STATES][kTries] = {}, effect_[TILLER_MAX_EFFECT_STATES][kTries] = {};
  double param_[TILLER_MAX_PARAMS] = {}, control_[TILLER_MAX_INPUTS * kPeriods] = {};
  double history_[(TILLER_MAX_DELAY_STEPS + 1) * TILLER_MAX_INPUTS] = {};
  Ends here_{}, turned_{};
};

}  // namespace

std::uint32_t periodic_angles(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table) {
  if (config.model->angle_mask == 0) return 0;
  std::uint32_t mask = config.model->angle_mask;
  for (std::uint32_t round = 0; round < kRounds; ++round) {
    Places places(config, setup, table, round);
    for (std::uint32_t i = 0; i < config.model->state_count; ++i)
      if (((mask >> i) & 1u) && !places.repeats(i)) mask &= ~(1u << i);
  }
  return mask;
}

template <class T>
void move_cost_terms(const tiller_cost_config_t& cost, std::uint32_t states, const double* origin,
                     CostTerms<T>& terms) {
  for (std::uint32_t i = 0; i < states; ++i) {
    if (!(element_or(cost.bound_weight, i, 0.0) > 0.0)) continue;
    terms.low[i] = static_cast<T>(element_or(cost.state_low, i, -HUGE_VAL) - origin[i]);
    terms.high[i] = static_cast<T>(element_or(cost.state_high, i, HUGE_VAL) - origin[i]);
  }
  take_catalogue(cost, origin, terms);
}
template void move_cost_terms<float>(const tiller_cost_config_t&, std::uint32_t, const double*, CostTerms<float>&);
template void move_cost_terms<double>(const tiller_cost_config_t&, std::uint32_t, const double*, CostTerms<double>&);

}  // namespace tiller
