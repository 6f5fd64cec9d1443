#include "executive/planning_belief.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_roles.hpp"
#include "planners/planner.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr double kLeastShare = 0.01;  // of a period that is worth a step

StepSetup without_delays(const StepSetup& setup) {
  StepSetup result = setup;
  result.effect_count = 0;
  result.delay_steps = 0;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (!has_role(setup.effects[e].kind, kDelay)) result.effects[result.effect_count++] = setup.effects[e];
  return result;
}

}  // namespace

void PlanningBelief::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                             const RolloutTable& table, bool over_delays) {
  const bool weighted = config.planner.hypotheses == tiller_hypotheses_sigma_points;
  const std::uint32_t count = weighted ? SigmaPoints::count(config) : config.planner.particles;
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count;
  const std::uint32_t ns = setup.effect_state_count;
  config_ = &config;
  setup_ = &setup;
  table_ = &table;
  over_delays_ = over_delays;
  forces_ = PlannedForces(config, setup);
  undelayed_ = without_delays(forces_.setup());
  lanes_ = (count + kLanePadding - 1) / kLanePadding * kLanePadding;
  params_ = arena.take<float>(std::size_t{param_rows(config, forces_.setup())} * count + kLanePadding);
  state_ = arena.take<float>(std::size_t{nx} * count + kLanePadding);
  effect_state_ = arena.take<float>(std::size_t{ns} * count + kLanePadding);
  history_ = arena.take<float>(std::size_t{setup.delay_steps} * nu + 1);
  controls_ = arena.take<float>(std::size_t{nu} * lanes_);
  final_state_ = arena.take<float>(std::size_t{nx} * lanes_);
  final_effect_ = arena.take<float>(std::size_t{ns} * lanes_);
  lookahead_ = arena.take<Lookahead>(count);
  const bool spreads = config.cost.bound_risk > 0.0 || config.planner.predict_spread != 0 ||
                       config.planner.noisy_rollouts != 0 ||
                       config.cost.demonstration_divergence == tiller_divergence_kl;
  if (spreads) spread_ = arena.take<StateSpread>(1);
  points_.lay_out(arena, config, ns);
  belief_ = {count, params_, state_, effect_state_, over_delays ? nullptr : history_, points_.weight(), spread_};
}

void PlanningBelief::draw(const Posterior& posterior, const CommandTimeline& timeline, std::uint64_t tick,
                          std::int64_t stamp_us, double ahead_s) {
  take_hypotheses(posterior, tick);
  compute_lookahead(ahead_s);
  // steps no longer than the period: that is the step for which the substeps were chosen
  step_parts(timeline, stamp_us);
  std::uint32_t most = 0;
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane) most = std::max(most, lookahead_[lane].whole);
  for (std::uint32_t left = most; left > 0; --left) step_whole(timeline, stamp_us, left);
  if (!over_delays_) fill_history(timeline, stamp_us, ahead_s);
  if (spread_) take_spread(posterior);
}

void PlanningBelief::take_hypotheses(const Posterior& posterior, std::uint64_t tick) {
  if (belief_.weight)
    points_.draw(posterior, params_, state_, effect_state_);
  else
    posterior.draw(belief_.count, tick, params_, state_, effect_state_, nullptr);
  // All hypotheses have the mean's forces. How far these may be off is no bet to hedge: a force is seen as it comes,
  // and one sequence of inputs for several forces lets every pole fall. Where bounds are to be kept it is a part of the
  // spread.
  forces_.fill(posterior, belief_.count, params_);
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane)
    lookahead_[lane].late_s = (belief_.weight ? points_.delay(lane) : posterior.drawn_delay(lane)) * config_->period_s;
}

/// Noise as it is estimated: the process's where the engine tells it by state, else by its common scale.
void PlanningBelief::take_spread(const Posterior& posterior) {
  const std::uint32_t nx = config_->model->state_count;
  PosteriorReport report;
  posterior.report(report);
  const double scale = posterior.noise_scale();
  double sd[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx; ++i)
    sd[i] = report.noise_sd[i] > 0.0 ? report.noise_sd[i] : scale * config_->process_sd[i];
  spread_->states = nx;
  posterior.state_covariance(nx, spread_->covariance);
  fill_process_covariance(*config_->model, sd, config_->period_s, spread_->process);
  for (std::uint32_t i = 0; i < nx * nx; ++i) spread_->covariance[i] += lead_periods_ * spread_->process[i];
  std::fill(spread_->sensor_variance, spread_->sensor_variance + nx, HUGE_VAL);
  for (std::uint32_t k = 0; k < config_->measurement_count; ++k) {
    const double noise = scale * config_->measurement_sd[k];
    spread_->sensor_variance[config_->measured_state[k]] = noise * noise;
  }
  spread_->forces = forces_.count();
  if (spread_->forces == 0) return;
  spread_->force_kept = math::exp(-config_->period_s * posterior.forces(0.0, nullptr, spread_->force_sd).rate);
  posterior.force_sizes(spread_->force_size);
}

/// A hypothesis's own delay; one that is not a number, or outside of what the setup provides for, has none.
double PlanningBelief::delay_s(const EffectSlot& slot, std::uint32_t lane) const {
  const double delay_s = static_cast<double>(params_[std::size_t{slot.param} * belief_.count + lane]);
  const double longest_s = (setup_->delay_steps + 1) * config_->period_s;
  return delay_s > 0.0 ? std::min(delay_s, longest_s) : 0.0;
}

void PlanningBelief::compute_lookahead(double ahead_s) {
  const double period_s = config_->period_s;
  double sum_s = 0.0;
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane) {
    double longest_s = 0.0;
    for (std::uint32_t e = 0; e < setup_->effect_count && over_delays_; ++e)
      if (has_role(setup_->effects[e].kind, kDelay)) longest_s = std::max(longest_s, delay_s(setup_->effects[e], lane));
    Lookahead& ahead = lookahead_[lane];
    ahead.total_s = std::max(ahead_s, 0.0) + longest_s + ahead.late_s;
    // a period less a rounding is a period
    ahead.whole = static_cast<std::uint32_t>(ahead.total_s / period_s + kLeastShare);
    ahead.part_s = ahead.total_s - ahead.whole * period_s;
    if (ahead.part_s < kLeastShare * period_s) ahead.part_s = 0.0;
    // weighted by M times the weight, so that hypotheses that are alike add up as they are
    sum_s += ahead.total_s * (belief_.weight ? static_cast<double>(belief_.weight[lane]) * belief_.count : 1.0);
  }
  lead_periods_ = static_cast<std::uint32_t>(std::lround(sum_s / (belief_.count * period_s)));
}

/// The parts of periods that come first, a rollout for each of the lengths that a register of hypotheses has.
void PlanningBelief::step_parts(const CommandTimeline& timeline, std::int64_t stamp_us) {
  for (std::uint32_t first = 0; first < belief_.count; first += kLanePadding) {
    const std::uint32_t end = std::min(first + kLanePadding, belief_.count);
    for (std::uint32_t lane = first; lane < end; ++lane)
      fill_controls(timeline, stamp_us, lane, 0.0, lookahead_[lane].part_s);
    for (std::uint32_t lane = first; lane < end; ++lane) {
      const double part_s = lookahead_[lane].part_s;
      if (!(part_s > 0.0)) continue;
      step(first, kLanePadding, part_s);
      for (std::uint32_t same = lane; same < end; ++same) {
        if (lookahead_[same].part_s != part_s) continue;
        take_final(first, kLanePadding, same);
        lookahead_[same].part_s = 0.0;
      }
    }
  }
}

/// One whole period of those hypotheses that have `left` or more to go, counted from their ends.
void PlanningBelief::step_whole(const CommandTimeline& timeline, std::int64_t stamp_us, std::uint32_t left) {
  const double period_s = config_->period_s;
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane) {
    const double from_s = lookahead_[lane].total_s - left * period_s;
    fill_controls(timeline, stamp_us, lane, from_s, from_s + period_s);
  }
  step(0, lanes_, period_s);
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane)
    if (lookahead_[lane].whole >= left) take_final(0, lanes_, lane);
}

/// Each hypothesis has its own delay, so each sees another piece of the same timeline.
void PlanningBelief::fill_controls(const CommandTimeline& timeline, std::int64_t stamp_us, std::uint32_t lane,
                                   double from_s, double to_s) {
  const std::uint32_t nu = config_->model->input_count;
  double command[TILLER_MAX_INPUTS];
  const double late_s = lookahead_[lane].late_s;
  timeline.mean(stamp_us, from_s - late_s, to_s - late_s, command);
  for (std::uint32_t i = 0; i < nu; ++i) controls_[i * lanes_ + lane] = static_cast<float>(command[i]);
  for (std::uint32_t e = 0; e < setup_->effect_count; ++e) {
    const EffectSlot& slot = setup_->effects[e];
    if (!has_role(slot.kind, kDelay)) continue;
    const double back_s = delay_s(slot, lane) + late_s;
    timeline.mean(stamp_us, from_s - back_s, to_s - back_s, command);
    controls_[slot.port * lanes_ + lane] = static_cast<float>(command[slot.port]);
  }
}

/// One step of `lanes` lanes from `first_lane` on, into the final arrays.
void PlanningBelief::step(std::uint32_t first_lane, std::uint32_t lanes, double period_s) {
  const std::uint32_t count = belief_.count;
  RolloutJob<float> job;
  job.setup = &undelayed_;
  job.lanes = lanes;
  job.horizon = 1;
  job.period_s = period_s;
  job.state = {state_ + first_lane, count};
  job.params = {params_ + first_lane, count};
  job.effect_state = {effect_state_ + first_lane, count};
  job.controls = {controls_ + first_lane, lanes_};
  job.final_state = final_state_;
  job.final_effect_state = setup_->effect_state_count > 0 ? final_effect_ : nullptr;
  table_->rollout_f32(*config_->model, job);
}

void PlanningBelief::take_final(std::uint32_t first_lane, std::uint32_t lanes, std::uint32_t lane) {
  const std::size_t from = lane - first_lane, count = belief_.count;
  for (std::uint32_t i = 0; i < config_->model->state_count; ++i)
    state_[i * count + lane] = final_state_[i * lanes + from];
  for (std::uint32_t i = 0; i < setup_->effect_state_count; ++i)
    effect_state_[i * count + lane] = final_effect_[i * lanes + from];
}

/// Commands before the first planned one, in steps of the nominal period, newest first.
void PlanningBelief::fill_history(const CommandTimeline& timeline, std::int64_t stamp_us, double ahead_s) {
  const std::uint32_t nu = config_->model->input_count;
  double command[TILLER_MAX_INPUTS];
  for (std::uint32_t row = 0; row < setup_->delay_steps; ++row) {
    const double end_s = ahead_s - row * config_->period_s;
    timeline.mean(stamp_us, end_s - config_->period_s, end_s, command);
    for (std::uint32_t i = 0; i < nu; ++i) history_[row * nu + i] = static_cast<float>(command[i]);
  }
}

}  // namespace tiller
