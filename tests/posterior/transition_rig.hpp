#pragma once

#include "effects/effect_roles.hpp"
#include "linear_rig.hpp"
#include "rollout/residual.hpp"
#include "tiller/config.hpp"

namespace rig {

/// The input within a period: the older level for a share of it, then the newer.
struct Levels {
  double share = 0.0, older = 0.0, newer = 0.0;
};
/// As an input_delay of at most one period has them; without one the command acts for the whole period.
template <class Rows>
Levels levels(const tiller::StepSetup* setup, const Rows& params, std::uint32_t lane, double input,
              const double* history, double period_s) {
  Levels now{0.0, input, input};
  for (std::uint32_t e = 0; setup && e < setup->effect_count; ++e) {
    if (!tiller::has_role(setup->effects[e].kind, tiller::kDelay)) continue;
    const double delay_s = static_cast<double>(params.data[setup->effects[e].param * params.stride + lane]);
    now.share = std::fmin(std::fmax(delay_s / period_s, 0.0), 1.0);
    now.older = history[0];
  }
  return now;
}

/// One-step residuals of the mass on a rail, both states measured, in plain loops and double: the library's kernels
/// have no part in it.
inline void linear_residual(const tiller_model_t&, const tiller::ResidualJob& job) {
  for (std::uint32_t k = 0; k < job.count; ++k) {
    const tiller::MeasuredStep& s = job.steps[k];
    for (std::uint32_t l = 0; l < job.lanes; ++l) {
      const double gain = static_cast<double>(job.params.data[l]);
      const double damping = static_cast<double>(job.params.data[job.params.stride + l]);
      const Levels input = levels(job.setup, job.params, l, s.input[0], s.history, s.period_s);
      const double first_s = input.share * s.period_s, rest_s = s.period_s - first_s, v = s.state[1];
      const double gained = first_s * (gain * input.older - damping * v);
      const double changed = gained + rest_s * (gain * input.newer - damping * (v + gained));
      const double e[2] = {s.change[0] - s.period_s * v - rest_s * gained, s.change[1] - changed};
      for (std::uint32_t r = 0; r < 2; ++r) {
        if (job.residual) job.residual[(k * 2 + r) * job.lanes + l] = static_cast<float>(e[r]);
        if (job.squared && !std::isnan(e[r])) job.squared[r * job.lanes + l] += s.weight * e[r] * e[r];
      }
    }
  }
}

/// With what acts at the joint beside the model.
inline void linear_rollout(const tiller_model_t&, const tiller::RolloutJob<double>& job) {
  for (std::uint32_t l = 0; l < job.lanes; ++l) {
    const double gain = job.params.data[l], damping = job.params.data[job.params.stride + l];
    const Levels input = levels(job.setup, job.params, l, job.controls.data[0], job.history, job.period_s);
    const double before = job.state.data[1], first_s = input.share * job.period_s, rest_s = job.period_s - first_s;
    const double between = before + first_s * (gain * input.older - damping * before);
    job.final_state[l] = job.state.data[0] + first_s * before + rest_s * between;
    double velocity = between + rest_s * (gain * input.newer - damping * between);
    for (std::uint32_t e = 0; job.setup && e < job.setup->effect_count; ++e) {
      const tiller::EffectSlot& slot = job.setup->effects[e];
      const double impulse = job.period_s * job.params.data[slot.param * job.params.stride + l];
      if (slot.kind == tiller_effect_constant_offset) velocity += impulse;
      if (slot.kind == tiller_effect_viscous_friction) velocity -= impulse * before;
      if (slot.kind == tiller_effect_coulomb_friction) velocity -= std::fmax(-impulse, std::fmin(impulse, velocity));
    }
    job.final_state[job.lanes + l] = velocity;
  }
}

inline const tiller::RolloutTable& transition_table() {
  static const tiller::RolloutTable t = [] {
    tiller::RolloutTable made;
    made.residual = &linear_residual;
    made.rollout_f64 = &linear_rollout;
    return made;
  }();
  return t;
}

/// The same with a joint, so that its velocity may have a discrepancy.
inline const tiller_model_t& transition_model() {
  static const tiller_joint_t joints[] = {{"cart", 0, 1, 0, 0}};
  static const tiller_model_t m = [] {
    tiller_model_t made = model();
    made.joint_count = 1;
    made.joints = joints;
    return made;
  }();
  return m;
}

/// Gain and damping unknown, both states measured, noise nearly unknown.
inline tiller::Config transition_config() {
  tiller::Config c = config();
  c.model = &transition_model();
  c.priors[1] = uniform(0.0, 1.0);
  c.measurement_count = 2;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = c.measurement_sd[1] = 1e-9;
  c.process_sd[0] = 0.01;
  c.process_sd[1] = 0.1;
  c.posterior.kind = tiller_posterior_transition;
  c.posterior.particles = 1024;
  c.posterior.window = 64;
  c.posterior.moves_per_tick = 128;
  c.posterior.noise_scale_shape = 0.5;
  c.posterior.robust = 0;
  c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 1.0;
  return c;
}

struct TransitionLog {
  double first[2];
  std::vector<tiller::Transition> transitions;
};

/// `coulomb` acts on the velocity as it changes within the step, and is no part of the model.
inline TransitionLog simulate_transitions(const tiller_config_t& c, double gain, double damping, int steps,
                                          unsigned seed, double noise = 1.0, double coulomb = 0.0) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  TransitionLog log{{0.1 * n(random), 0.1 * n(random)}, {}};
  double position = log.first[0], velocity = log.first[1], u = 0.0;
  const double root_dt = std::sqrt(c.period_s);
  for (int k = 0; k < steps; ++k) {
    if (k % 5 == 0) u = n(random);
    const double next = position + c.period_s * velocity + noise * root_dt * c.process_sd[0] * n(random);
    const double push = gain * u - damping * velocity;
    const int parts = coulomb > 0.0 ? 50 : 1;
    for (int part = 0; part < parts; ++part)
      velocity += c.period_s / parts * (push - coulomb * std::tanh(velocity / 0.002));
    velocity += noise * root_dt * c.process_sd[1] * n(random);
    position = next;
    tiller::Transition t;
    t.period_s = c.period_s;
    t.input[0] = u;
    t.measured[0] = position;
    t.measured[1] = velocity;
    log.transitions.push_back(t);
  }
  return log;
}

}  // namespace rig
