#include "tools/gap/fit/scales.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::uint32_t kLanes = kLanePadding;

// Inertia that a force at joint j moves: the velocity that a small force makes in one period, by the kernel itself.
double inertia_at(const tiller_config_t& nominal, std::uint32_t j, const std::vector<Window>& windows,
                  const double* params, double period_s) {
  Config config = nominal;
  config.effect_count = 1;
  config.effects[0] = {tiller_effect_constant_offset, j};
  config.param_count = config.model->param_count + 1;
  config.priors[config.param_count - 1] = {tiller_prior_fixed, 0, 0, 0, -INFINITY, INFINITY};
  StepSetup setup;
  if (make_step_setup(config, setup) != tiller_status_ok) return 1;
  const tiller_model_t& model = *config.model;
  double p[TILLER_MAX_PARAMS * kLanes] = {}, x[TILLER_MAX_STATES * kLanes] = {}, next[TILLER_MAX_STATES * kLanes] = {},
                               u[TILLER_MAX_INPUTS] = {};
  for (std::uint32_t i = 0; i < model.param_count; ++i)
    for (std::uint32_t l = 0; l < kLanes; ++l) p[i * kLanes + l] = params[i];
  constexpr double kForce = 1e-3;
  for (std::uint32_t l = 0; l < kLanes; l += 2) p[model.param_count * kLanes + l] = kForce;
  // eight typical states, each with and without the force
  for (std::uint32_t l = 0; l < kLanes; ++l)
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      x[i * kLanes + l] = windows[windows.size() * (l / 2) / (kLanes / 2)].x0[i];
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.horizon = 1;
  job.period_s = period_s;
  job.state = {x, kLanes};
  job.params = {p, kLanes};
  job.controls.data = u;
  job.history = u;
  const double none[1] = {};
  job.effect_state.data = none;
  job.final_state = next;
  select_rollout(model).rollout_f64(model, job);
  constexpr double kPairs = kLanes / 2.0;  // of lanes with and without the force
  double sum = 0;
  const std::uint32_t v = model.joints[j].velocity;
  for (std::uint32_t l = 0; l < kLanes; l += 2)
    sum += std::fabs(next[v * kLanes + l] - next[v * kLanes + l + 1]) / (kForce * period_s);
  const double inertia = kPairs / sum;
  return std::isfinite(inertia) && inertia > 0 ? inertia : 1;
}

struct Moments {
  double sum = 0, squares = 0, low = INFINITY, high = -INFINITY;
  std::size_t count = 0;
  void add(double v) {
    if (!std::isfinite(v)) return;
    sum += v, squares += v * v, ++count;
    low = std::min(low, v), high = std::max(high, v);
  }
  double rms() const { return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0; }
  double deviation() const {
    if (count == 0) return 0;
    const double n = static_cast<double>(count), mean = sum / n;
    return std::sqrt(std::max(0.0, squares / n - mean * mean));
  }
};

double positive(double v, double otherwise) { return std::isfinite(v) && v > 0 ? v : otherwise; }

}  // namespace

std::uint32_t joint_of(const tiller_model_t& model, std::uint32_t kind, std::uint32_t port) {
  if (kind == kChangedParameter) return model.joint_count;
  const PortKind at = effect_info(kind).port;
  port = first_port(effect_info(kind), port, model);
  if (at == PortKind::joint) return port;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    if (at == PortKind::input && model.joints[j].drive == port + 1) return j;
    if (at == PortKind::sensor && (model.joints[j].position == port || model.joints[j].velocity == port)) return j;
  }
  return at == PortKind::body ? 0 : model.joint_count;
}

Scales measure_scales(const WindowData& data, const std::vector<Window>& windows, const tiller_config_t& config,
                      const double* params) {
  const tiller_model_t& model = *config.model;
  Scales s;
  s.period_s = data.grids[windows[0].grid].period_s;
  Moments input[TILLER_MAX_INPUTS], state[TILLER_MAX_STATES], acceleration[TILLER_MAX_JOINTS], step[TILLER_MAX_JOINTS];
  for (const Window& w : windows) {
    const Grid& grid = data.grids[w.grid];
    for (std::size_t k = w.start; k < w.start + w.points; ++k)
      for (std::uint32_t i = 0; i < model.input_count; ++i) input[i].add(grid.input[i][k]);
    const std::size_t stride = 5;
    double before[TILLER_MAX_STATES] = {};
    bool have = false;
    for (std::size_t k = w.start; k < w.start + w.points; k += stride) {
      double x[TILLER_MAX_STATES] = {};
      if (!estimate_state(grid, config, k, kStateHalfWidth_s * grid.time_scale, x)) {
        have = false;
        continue;
      }
      for (std::uint32_t i = 0; i < model.state_count; ++i) state[i].add(x[i]);
      for (std::uint32_t j = 0; have && j < model.joint_count; ++j) {
        const std::uint32_t v = model.joints[j].velocity;
        acceleration[j].add((x[v] - before[v]) / (static_cast<double>(stride) * grid.period_s));
        step[j].add(x[v] * grid.period_s);
      }
      std::copy(x, x + model.state_count, before);
      have = true;
    }
  }
  for (std::uint32_t i = 0; i < model.input_count; ++i) s.input[i] = positive(input[i].rms(), 1);
  for (std::uint32_t i = 0; i < model.state_count; ++i) s.channel[i] = positive(state[i].deviation(), 1e-3);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const tiller_joint_t& joint = model.joints[j];
    Scales::Joint& out = s.joint[j];
    out.inertia = inertia_at(config, j, windows, params, s.period_s);
    out.force = positive(out.inertia * acceleration[j].rms(), 1e-3);
    if (joint.drive != 0 && !is_goal(config, joint.drive - 1u))
      out.force = std::max(out.force, s.input[joint.drive - 1]);
    out.velocity = positive(state[joint.velocity].rms(), 1e-3);
    if (joint.position != TILLER_NO_POSITION) {
      out.position = positive(state[joint.position].deviation(), 1e-3);
      out.reach = positive(std::max(std::fabs(state[joint.position].high), std::fabs(state[joint.position].low)), 1e-2);
      out.low = std::isfinite(state[joint.position].low) ? state[joint.position].low : 0;
      out.range = positive(state[joint.position].high - state[joint.position].low, 1e-2);
    }
    out.step = positive(step[j].rms(), 1e-4);
  }
  // a body's mass: the largest that the model names; without one, what the first joint moves
  s.mass = 0;
  for (std::uint32_t i = 0; i < model.param_count; ++i)
    if (std::strstr(model.param_names[i], "mass_kg") != nullptr) s.mass = std::max(s.mass, params[i]);
  if (!(s.mass > 0)) s.mass = model.joint_count > 0 ? s.joint[0].inertia : 1;
  return s;
}

bool is_strength(Scale scale) {
  switch (scale) {
    case Scale::force:
    case Scale::force_per_velocity:
    case Scale::force_per_velocity2:
    case Scale::force_per_position:
    case Scale::force_per_position2:
    case Scale::force_per_position3:
    case Scale::per_input:
    case Scale::mass:
    case Scale::inertia:
    case Scale::none: return true;
    default: return false;
  }
}

bool is_spatial_period(const EffectParam& param) {
  return param.scale == Scale::spatial_period || std::strcmp(param.name, "spatial_period_SI") == 0;
}

double travel_of(const Scales& s, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port) {
  const std::uint32_t j = joint_of(model, kind, port);
  const bool sensor = effect_info(kind).port == PortKind::sensor;
  if (sensor && (j >= model.joint_count || model.joints[j].position != port))
    return std::sqrt(12.0) * s.channel[port];  // of an even spread
  return j < model.joint_count && model.joints[j].position != TILLER_NO_POSITION ? s.joint[j].range : 0;
}

double turn_of(const Scales& s, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port) {
  constexpr double kTurn = 6.283185307179586;
  const std::uint32_t j = joint_of(model, kind, port);
  if (j >= model.joint_count || model.joints[j].position == TILLER_NO_POSITION) return 0;
  if (effect_info(kind).port == PortKind::sensor && model.joints[j].position != port) return 0;
  const bool turns = (model.angle_mask >> model.joints[j].position & 1u) != 0;
  return turns && s.joint[j].range >= kLeastRepeats * kTurn ? kTurn : 0;
}

double scale_of(const Scales& s, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port, int param) {
  const EffectInfo& info = effect_info(kind);
  port = first_port(info, port, model);
  const std::uint32_t j = joint_of(model, kind, port);
  const Scales::Joint joint = j < model.joint_count ? s.joint[j] : Scales::Joint{};
  const double position = info.port == PortKind::sensor ? s.channel[port] : joint.position;
  const double reach = joint.reach;  // springs are about position 0
  const double force = info.port == PortKind::input ? s.input[port] : joint.force;
  switch (info.params[param].scale) {
    case Scale::force: return force;
    case Scale::force_per_velocity: return force / joint.velocity;
    case Scale::force_per_velocity2: return force / (joint.velocity * joint.velocity);
    case Scale::force_per_position: return force / reach;
    case Scale::force_per_position2: return force / (reach * reach);
    case Scale::force_per_position3: return force / (reach * reach * reach);
    case Scale::stiffness: return joint.force / joint.position;
    case Scale::position: return position;
    case Scale::place: return joint.range;
    case Scale::velocity: return joint.velocity;
    case Scale::input: return info.port == PortKind::input ? s.input[port] : 1;
    case Scale::per_input: return info.port == PortKind::input ? 1 / s.input[port] : 1;
    case Scale::period: return s.period_s;
    case Scale::mass: return s.mass;
    case Scale::inertia: return joint.inertia;
    case Scale::spatial_period: return joint.range;
    default: return 1;
  }
}

double start_of(const Scales& s, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port, int param,
                int k) {
  const EffectParam& p = effect_info(kind).params[param];
  const std::uint32_t j = joint_of(model, kind, port);
  const double from = p.scale == Scale::place && j < model.joint_count ? s.joint[j].low : 0.0;
  return from + (k < p.start_count ? p.start[k] : 0.0) * scale_of(s, model, kind, port, param);
}

}  // namespace tiller::tools::gap
