#include "executive/probing.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {

Probing* Probing::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table) {
  if (!(config.probe.weight > 0.0)) return nullptr;
  auto* const placed = arena.take<Probing>(1);
  Probing stand_in;
  Probing& self = placed ? *placed : stand_in;
  self.config_ = config;
  self.config_.planner.particles = Prober::hypotheses_of(config);
  self.config_.planner.hypotheses = tiller_hypotheses_drawn;
  self.config_.planner.predict_spread = 1;
  self.until_sd_ = config.probe.until_sd;
  // a plan's first command acts where its delay ends, and so do the hypotheses begin
  self.belief_.lay_out(arena, self.config_, setup, table, true);
  // the goal changes in the controller's own configuration
  self.prober_.lay_out(arena, config, self.belief_.planner_setup(), table);
  return placed;
}

void Probing::begin(tiller_info_t& info) {
  prober_.reset();
  info.probe_spent = info.probe_allowed = 0.0;
}

void Probing::pass_period(tiller_info_t& info) {
  if (left_ > 0) info.calibration_left = --left_;
}

void Probing::keep_in_box(double* command) const {
  for (std::uint32_t i = 0; left_ > 0 && i < config_.model->input_count; ++i)
    command[i] = std::fmin(std::fmax(command[i], box_.input_low[i]), box_.input_high[i]);
}

void Probing::end(tiller_info_t& info) {
  left_ = info.calibration_left = 0;
  info.probing = tiller_probing_none;
}

void Probing::calibrate(const ProbeBox& box, std::uint32_t periods) {
  box_ = box;
  left_ = periods;
  prober_.reset();
}

/// Whether nothing is left to be known, or to be known better than is wished; without wishes, what plans gain decides.
bool Probing::known(const tiller_info_t& info) const {
  bool wishes = false, unknown = false;
  if (config_.posterior.enabled == 0) return true;  // what is found out would be forgotten
  for (std::uint32_t i = 0; i < config_.param_count; ++i) {
    unknown = unknown || info.param_sd[i] > 0.0;
    if (!until_sd_ || !std::isfinite(until_sd_[i])) continue;
    wishes = true;
    if (info.param_sd[i] > until_sd_[i]) return false;
  }
  return wishes || !unknown;
}

const float* Probing::choose(const Posterior& posterior, const CommandTimeline& timeline, const Moment& moment,
                             const PlanRequest& request, const float* sequence, double* command, tiller_info_t& info) {
  info.probing = tiller_probing_none;
  info.probe_value = info.probe_cost = info.probe_information = 0.0;
  // the box is kept under the model, so not under one that is rejected
  if (known(info) || request.doubted) left_ = 0;
  info.calibration_left = left_;
  const bool calibrates = left_ > 0;
  const bool probes = config_.probe.weight > TILLER_SMALLEST_WEIGHT && !known(info) && !request.doubted;
  if (!calibrates && !probes) return sequence;
  // of the planner's stream: as many as it has are the same ones
  belief_.draw(posterior, timeline, request.tick, moment.stamp_us, moment.ahead_s);
  PlanRequest own = request;
  own.belief = &belief_.belief();
  // these are brought forward over delays, and the planner's may be
  own.task_step = request.task_step + belief_.lead_periods();
  own.task_step -= std::min<std::uint64_t>(own.task_step, moment.lead_periods);
  ProbeTask task;
  task.plan = &own;
  task.sequence = sequence;
  task.box = calibrates ? &box_ : nullptr;
  task.budget = config_.probe.budget;
  task.most_cost = info.probe_allowed - info.probe_spent;
  const ProbeResult result = prober_.search(task);
  info.probe_value = result.value;
  info.probe_cost = result.cost;
  info.probe_information = result.information;
  if (result.probes) {
    info.probing = calibrates ? tiller_probing_calibrate : tiller_probing_plan;
    info.probed_ticks += calibrates ? 0 : 1;
    info.probe_spent += result.step_cost;
    for (std::uint32_t i = 0; i < config_.model->input_count; ++i)
      command[i] = static_cast<double>(prober_.sequence()[i]);
  }
  if (calibrates && !result.probes) keep_in_box(command);
  if (!calibrates) info.probe_allowed += config_.probe.budget * prober_.stage_cost(command, own.task_step);
  return result.probes ? prober_.sequence() : sequence;
}

}  // namespace tiller
