#include "tools/view/view_row.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

constexpr std::size_t kMostSteps = 48;       // of a plan that is drawn
constexpr std::size_t kMostParticles = 128;  // more of them is no other picture

/// Smallest stride with which `count` gives no more than `most`.
std::size_t stride_of(std::size_t count, std::size_t most) { return (count + most - 1) / most; }

}  // namespace

ViewRow::ViewRow(const RobotFile& robot)
    : robot_(robot),
      config_(robot.config),
      nx_(robot.names.states.size()),
      nu_(robot.names.inputs.size()),
      stride_(stride_of(robot.config.planner.horizon, kMostSteps)),
      particles_(robot.config.posterior.particles / stride_of(robot.config.posterior.particles, kMostParticles)),
      plan_(robot.config.planner.horizon * robot.names.inputs.size()),
      target_(robot.config.cost.target, robot.config.cost.target + robot.names.states.size()) {
  if (config_.cost.reference) target_.assign(nx_, std::nan(""));
  steps_ = config_.planner.horizon / stride_;
  Words inferred;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (config_.priors[i].kind == tiller_prior_fixed) continue;
    inferred_.push_back(i);
    inferred.push_back(robot.names.params[i]);
  }
  const Words forces = felt_forces(config_);
  forces_ = forces.size();
  add("tick", {"time_s", "tick", "state", "status", "tick_us", "effective_samples", "noise_scale", "plan_cost",
               "adequacy_statistic"});
  add("measured", robot.names.measurements);
  add("command", robot.names.inputs);
  for (const char* name : {"mean", "sd", "true", "target", "slip", "slip_sd"}) add(name, robot.names.states);
  add("outputs", config_.cost.outputs ? robot.names.outputs : Words());
  for (const char* name : {"parameter", "parameter_sd", "q05", "q95"}) add(name, inferred);
  for (const char* name : {"force", "force_sd"}) add(name, forces);
  for (const char* name : {"foreseen", "foreseen_sd"})
    add(name, config_.planner.predict_spread != 0 ? robot.names.states : Words());
  add("plan", robot.names.inputs, steps_);
  for (const char* name : {"predicted", "predicted_sd"})
    add(name, config_.planner.predict_spread != 0 ? robot.names.states : Words(), steps_);
  Words cloud = {"weight"};
  cloud.insert(cloud.end(), inferred.begin(), inferred.end());
  add("particles", inferred.empty() ? Words() : cloud, particles_);
}

/// Fields without columns are left out.
void ViewRow::add(const std::string& name, const Words& columns, std::size_t rows) {
  if (columns.empty() || rows == 0) return;
  fields_.push_back({name, rows, columns});
  size_ += rows * columns.size();
}

void ViewRow::put(const double* values, std::size_t count) { at_ = std::copy(values, values + count, at_); }

void ViewRow::put_nothing(std::size_t count) { at_ = std::fill_n(at_, count, std::nan("")); }

void ViewRow::put_inferred(const double* values) {
  for (const std::size_t i : inferred_) *at_++ = values[i];
}

void ViewRow::put_plan(const tiller_t* controller) {
  const std::uint32_t known = tiller_get_plan(controller, plan_.data(), config_.planner.horizon);
  for (std::size_t k = 0; k < steps_; ++k) {
    if (k * stride_ < known)
      put(plan_.data() + k * stride_ * nu_, nu_);
    else
      put_nothing(nu_);
  }
}

void ViewRow::put_prediction(const tiller_t* controller) {
  double* const sd = at_ + steps_ * nx_;
  for (std::size_t k = 0; k < steps_; ++k, at_ += nx_) {
    const auto step = static_cast<std::uint32_t>(k * stride_);
    if (tiller_get_prediction(controller, step, at_, sd + k * nx_) == tiller_status_ok) continue;
    std::fill_n(at_, nx_, std::nan(""));
    std::fill_n(sd + k * nx_, nx_, std::nan(""));
  }
  at_ += steps_ * nx_;
}

void ViewRow::put_particles(const tiller_t* controller) {
  const std::size_t stride = config_.posterior.particles / particles_;
  double params[TILLER_MAX_PARAMS], weight = 0;
  for (std::size_t k = 0; k < particles_; ++k) {
    if (tiller_get_particle(controller, static_cast<std::uint32_t>(k * stride), params, nullptr, &weight) !=
        tiller_status_ok) {
      put_nothing(1 + inferred_.size());
      continue;
    }
    *at_++ = weight;
    put_inferred(params);
  }
}

void ViewRow::put_forces(const tiller_info_t& info) {
  put(info.force_mean, forces_);
  put(info.force_sd, forces_);
}

/// Estimate, truth, goal, and what changes the states beyond the model.
void ViewRow::put_states(const LoggedTick& tick) {
  const tiller_info_t& info = tick.info;
  put(info.state_mean, nx_);
  put(info.state_sd, nx_);
  if (tick.has_truth)
    put(tick.true_state, nx_);
  else
    put_nothing(nx_);
  if ((tick.entry.goal & kGoalStates) != 0) std::copy(tick.entry.target, tick.entry.target + nx_, target_.begin());
  put(target_.data(), nx_);
  for (const double* slips : {info.slip_mean, info.slip_sd})
    for (std::size_t i = 0; i < nx_; ++i) *at_++ = (info.slip_states >> i & 1u) != 0 ? slips[i] : std::nan("");
}

void ViewRow::put_foreseen(const LoggedTick& tick) {
  if (config_.planner.predict_spread == 0) return;
  for (const double* values : {tick.foreseen_mean, tick.foreseen_sd}) {
    if (tick.was_foreseen)
      put(values, nx_);
    else
      put_nothing(nx_);
  }
}

void ViewRow::fill(const tiller_t* controller, const LoggedTick& tick, double* row) {
  at_ = row;
  const tiller_info_t& info = tick.info;
  const tiller_record_t& record = tick.entry.record;
  for (const double value :
       {tick.time_s, static_cast<double>(info.ticks) - 1, static_cast<double>(record.command.state),
        static_cast<double>(tick.status), tick.tick_us, info.effective_samples, info.noise_scale, info.plan_cost,
        info.adequacy == tiller_adequacy_untested ? std::nan("") : info.adequacy_statistic})
    *at_++ = value;
  const std::size_t ny = robot_.names.measurements.size();
  if (record.has_measurement != 0)
    put(record.measurement.value, ny);
  else
    put_nothing(ny);
  put(record.command.value, nu_);
  put_states(tick);
  if (config_.cost.outputs) {
    double outputs[TILLER_MAX_OUTPUTS] = {};
    (void)tiller_get_outputs(controller, outputs);
    put(outputs, robot_.names.outputs.size());
  }
  for (const double* values : {info.param_mean, info.param_sd, tick.q05, tick.q95}) put_inferred(values);
  put_forces(info);
  put_foreseen(tick);
  put_plan(controller);
  if (config_.planner.predict_spread != 0) put_prediction(controller);
  if (!inferred_.empty()) put_particles(controller);
}

}  // namespace tiller::tools
