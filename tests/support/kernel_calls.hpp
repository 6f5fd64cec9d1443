#pragma once

// One call of each kernel of a model, over arrays that fit every model: what the counts of instructions run, on a
// microcontroller's emulator (tests/cortex_m) and on this machine (tests/instructions).

#include <cstdint>

#include "effects/effect_info.hpp"
#include "rollout/path.hpp"
#include "rollout/residual.hpp"
#include "rollout/rollout.hpp"

namespace tiller::test {

class KernelCalls {
 public:
  static constexpr std::uint32_t kLanes = kLanePadding, kHorizon = 8;
  static constexpr std::uint32_t kSteps = kLanes * kHorizon;

  KernelCalls() {
    fill(f32_);
    fill(f64_);
    for (double& h : high_) h = 1.0;
    for (double& l : low_) l = -1.0;
  }

  /// kSteps integrator steps each.
  void rollout_f32(const tiller_model_t& model, const StepSetup& setup) {
    select_rollout(model).rollout_f32(model, rollout_job(setup, f32_, terms_f32_));
  }
  void rollout_f64(const tiller_model_t& model, const StepSetup& setup) {
    select_rollout(model).rollout_f64(model, rollout_job(setup, f64_, terms_f64_));
  }
  /// kLanes periods.
  void linearise(const tiller_model_t& model, const StepSetup& setup) {
    LineariseJob job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.state = {f64_.state, kLanes};
    job.params = {f64_.params, kLanes};
    job.effect_state = {f64_.effects, kLanes};
    job.control = {f64_.controls, 0};
    job.next_state = next_;
    job.a = a_;
    select_rollout(model).linearise(model, job);
  }
  /// kSteps transitions.
  void residual(const tiller_model_t& model, const StepSetup& setup) {
    ResidualJob job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.count = kHorizon;
    job.steps = measured_;
    job.params = {f32_.params, kLanes};
    job.squared = squared_;
    select_rollout(model).residual(model, job);
  }
  /// kHorizon periods with Jacobians.
  void path_linearise(const tiller_model_t& model, const StepSetup& setup) {
    PathJob job;
    job.setup = &setup;
    job.horizon = kHorizon;
    job.state = path_state_;
    job.control = zero_;
    job.params = f64_.params;
    job.param_count = kParams;
    job.next = next_;
    job.a = path_a_;
    job.b = path_b_;
    job.lq_states = model.state_count;
    select_path(select_rollout(model)).linearise(model, job);
  }
  /// kHorizon periods of kCandidates candidates.
  void path_feedback(const tiller_model_t& model, const StepSetup& setup) {
    FeedbackJob job;
    job.setup = &setup;
    job.horizon = kHorizon;
    job.start = f64_.state;
    job.params = f64_.params;
    job.param_count = kParams;
    job.state = path_state_;
    job.control = job.step = zero_;
    job.gain = gain_;
    job.lq_states = model.state_count;
    job.alpha = job.beta = alpha_;
    job.low = low_;
    job.high = high_;
    job.most_change = high_;
    job.previous_input = zero_;
    job.cost = &terms_f64_;
    job.cost_out = path_cost_;
    job.state_out = states_out_;
    job.control_out = path_control_;
    select_path(select_rollout(model)).feedback(model, job);
  }

 private:
  // every array at its largest
  template <class T>
  struct Arrays {
    T state[TILLER_MAX_STATES * kLanes], params[TILLER_MAX_PARAMS * kLanes], effects[TILLER_MAX_EFFECT_STATES * kLanes];
    T controls[kHorizon * TILLER_MAX_INPUTS * kLanes], cost[kLanes];
  };
  template <class T>
  static void fill(Arrays<T>& arrays) {
    for (T& x : arrays.state) x = T(0.1);
    for (T& p : arrays.params) p = T(1.0);
    for (T& e : arrays.effects) e = T(0.0);
    for (T& u : arrays.controls) u = T(0.2);
  }
  template <class T>
  static RolloutJob<T> rollout_job(const StepSetup& setup, Arrays<T>& arrays, const CostTerms<T>& terms) {
    RolloutJob<T> job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = kHorizon;
    job.state = {arrays.state, 0};
    job.params = {arrays.params, 0};
    job.effect_state = {arrays.effects, 0};
    job.controls = {arrays.controls, kLanes};
    job.cost = &terms;
    job.cost_out = arrays.cost;
    return job;
  }

  static constexpr std::uint32_t kParams = 24;  // of any model and its effect, as many whatever the limit is
  static constexpr std::uint32_t kSquare = TILLER_MAX_STATES * TILLER_MAX_STATES;
  static constexpr std::uint32_t kOblong = TILLER_MAX_STATES * TILLER_MAX_INPUTS;
  Arrays<float> f32_;
  Arrays<double> f64_;
  CostTerms<float> terms_f32_;
  CostTerms<double> terms_f64_;
  MeasuredStep measured_[kHorizon];
  double squared_[TILLER_MAX_STATES * kLanes] = {};
  double next_[TILLER_MAX_STATES * kLanes] = {}, a_[kSquare * kLanes] = {};
  double path_state_[(kHorizon + 1) * TILLER_MAX_STATES *
                     kCandidates] = {},
                     path_a_[kHorizon * kSquare] = {}, path_b_[kHorizon * kOblong] = {}, gain_[kHorizon * kOblong] = {},
                     zero_[kHorizon * TILLER_MAX_INPUTS] = {},
                     path_control_[kHorizon * TILLER_MAX_INPUTS * kCandidates] = {}, low_[TILLER_MAX_INPUTS] = {},
                     high_[TILLER_MAX_INPUTS] = {}, path_cost_[kCandidates] = {}, alpha_[kCandidates] = {},
                     states_out_[(kHorizon + 1) * TILLER_MAX_STATES * kCandidates] = {};
};

/// Dry friction at the first joint, or a gain at the first input where there is no joint that bears it.
inline void add_one_effect(const tiller_model_t& model, StepSetup& setup) {
  std::uint32_t kind = tiller_effect_coulomb_friction;
  if (!port_fits(effect_info(kind), 0, model)) kind = tiller_effect_actuator_gain;
  setup.effects[0] = {static_cast<std::uint16_t>(kind), 0, static_cast<std::uint16_t>(model.param_count), 0};
  setup.effect_count = 1;
}

}  // namespace tiller::test
