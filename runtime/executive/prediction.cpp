#include "executive/prediction.hpp"

#include <algorithm>
#include <cmath>

#include "planners/belief_weights.hpp"
#include "planners/predicted_spread.hpp"
#include "rollout/turn.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr double kRevisions = 20.0;  // plans over which their revisions are averaged

}  // namespace

void Prediction::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                         const RolloutTable& table) {
  const bool diverges = config.cost.demonstration_divergence == tiller_divergence_kl;
  if (config.planner.predict_spread == 0 && !diverges) return;
  config_ = &config;
  setup_ = &setup;
  table_ = &table;
  nx_ = config.model->state_count;
  nu_ = config.model->input_count;
  np_ = param_rows(config, setup);
  all_ = nx_ + setup.fading;
  ns_ = setup.effect_state_count;
  const std::size_t m = config.planner.particles, square = std::size_t{nx_} * nx_;
  lanes_ = static_cast<std::uint32_t>((m + kLanePadding - 1) / kLanePadding * kLanePadding);
  const auto rows = [&](std::size_t count) { return arena.take<double>(count * lanes_); };
  state_ = rows(nx_);
  params_ = rows(np_);
  effects_ = rows(ns_);
  control_ = rows(nu_);
  next_ = rows(nx_);
  a_ = rows(square);
  b_ = rows(std::size_t{nx_} * nu_);
  history_ = arena.take<double>(std::size_t{setup.delay_steps} * nu_);
  weight_ = arena.take<double>(m);
  error_ = arena.take<double>(m * all_ * all_);
  estimate_ = arena.take<double>(m * all_ * all_);
  work_ = arena.take<double>(square + std::size_t{nx_} * (nu_ + setup.fading) + spread_scratch_size(all_));
  if (setup.fading > 0) {
    push_ = rows(std::size_t{nx_} * setup.fading);
    pushed_ = rows(nx_);
    force_ = rows(1);
  }
  gain_ = arena.take<double>(std::size_t{nx_} * nu_);
  reference_ = arena.take<double>(nx_);
  input_ = arena.take<double>(nu_);
  expected_ = arena.take<double>(nu_);
  expected_gain_ = arena.take<double>(std::size_t{nx_} * nu_);
  expected_state_ = arena.take<double>(nx_);
  revision_ = arena.take<double>(nu_);
  mean_ = arena.take<double>((std::size_t{config.planner.horizon} + 1) * nx_);
  sd_ = arena.take<double>((std::size_t{config.planner.horizon} + 1) * nx_);
  if (diverges) covariance_ = arena.take<double>((std::size_t{config.planner.horizon} + 1) * square);
}

/// The belief as lanes; the padding repeats hypothesis 0. Angles stand on hypothesis 0's turn.
void Prediction::take_start(const Belief& belief) {
  hypotheses_ = hypotheses_within(belief, config_->planner.particles);
  fill_relative_weights(belief, hypotheses_, weight_);
  const auto take = [&](const float* from, std::uint32_t rows, double* to) {
    for (std::uint32_t r = 0; r < rows; ++r)
      for (std::uint32_t l = 0; l < lanes_; ++l)
        to[r * lanes_ + l] = static_cast<double>(from[r * belief.count + (l < hypotheses_ ? l : 0)]);
  };
  take(belief.params, np_, params_);
  take(belief.state, nx_, state_);
  take(belief.effect_state, ns_, effects_);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (((config_->model->angle_mask >> i) & 1u) == 0) continue;
    double* row = state_ + i * lanes_;
    for (std::uint32_t l = 1; l < lanes_; ++l) row[l] = row[0] + state_difference(*config_->model, i, row[l], row[0]);
  }
  for (std::uint32_t i = 0; i < setup_->delay_steps * nu_; ++i)
    history_[i] = belief.history ? static_cast<double>(belief.history[i]) : 0.0;
  for (std::uint32_t j = 0; j < hypotheses_; ++j) {
    const std::size_t square = std::size_t{all_} * all_;
    begin_spread(*belief.spread, nx_, error_ + j * square, estimate_ + j * square);
  }
}

/// How each force that wanders moves the states on, from the difference that a deviation of it makes.
void Prediction::take_pushes(const StateSpread& spread, LineariseJob job) {
  job.next_effect_state = nullptr;
  job.a = job.b = nullptr;
  for (std::uint32_t i = 0; i < spread.forces; ++i) {
    double* const force = params_ + std::size_t{setup_->fading_param + i} * lanes_;
    const double width = spread.force_sd[i] > 0.0 ? spread.force_sd[i] : 1.0;
    std::copy(force, force + lanes_, force_);
    for (const double way : {-width, width}) {
      for (std::uint32_t l = 0; l < lanes_; ++l) force[l] = force_[l] + way;
      job.next_state = way < 0.0 ? pushed_ : next_;
      table_->linearise(*config_->model, job);
    }
    std::copy(force_, force_ + lanes_, force);
    for (std::uint32_t r = 0; r < nx_; ++r)
      for (std::uint32_t l = 0; l < lanes_; ++l)
        push_[(r * spread.forces + i) * lanes_ + l] = (next_[r * lanes_ + l] - pushed_[r * lanes_ + l]) / (2.0 * width);
  }
}

/// The plan's inputs of a step; whether they are answered.
void Prediction::take_inputs(const PlannerTable& table, const void* planner, std::uint32_t step, bool& answers) {
  const float* sequence = table.sequence(planner);
  for (std::uint32_t i = 0; i < nu_; ++i) input_[i] = static_cast<double>(sequence[std::size_t{step} * nu_ + i]);
  double unused[TILLER_MAX_INPUTS];
  answers = step > 0 && table.feedback && table.feedback(planner, step, gain_, reference_, unused);
  for (std::uint32_t l = 0; l < lanes_; ++l)
    for (std::uint32_t i = 0; i < nu_; ++i) {
      double u = input_[i];
      for (std::uint32_t c = 0; answers && c < nx_; ++c)
        u += gain_[i * nx_ + c] * state_difference(*config_->model, c, state_[c * lanes_ + l], reference_[c]);
      control_[i * lanes_ + l] = std::fmin(std::fmax(u, config_->safety.input_low[i]), config_->safety.input_high[i]);
    }
}

void Prediction::advance(const Belief& belief, bool answers) {
  LineariseJob job;
  job.setup = setup_;
  job.lanes = lanes_;
  job.state = {state_, lanes_};
  job.params = {params_, lanes_};
  job.effect_state = {effects_, lanes_};
  job.control = {control_, lanes_};
  job.history = history_;
  job.next_state = next_;
  job.next_effect_state = ns_ > 0 ? effects_ : nullptr;
  job.a = a_;
  job.b = b_;
  take_pushes(*belief.spread, job);
  table_->linearise(*config_->model, job);
  std::copy(next_, next_ + std::size_t{nx_} * lanes_, state_);
  double* const force = params_ + std::size_t{setup_->fading_param} * lanes_;
  for (std::uint32_t l = 0; setup_->fading > 0 && l < lanes_; ++l) {
    const double* const rates = force + std::size_t{2} * setup_->fading * lanes_ + l;
    turn_forces(turn_after(rates[0], rates[lanes_], 1.0), setup_->fading, force + l, lanes_);
  }
  for (std::uint32_t i = setup_->delay_steps * nu_; i-- > nu_;) history_[i] = history_[i - nu_];
  for (std::uint32_t i = 0; setup_->delay_steps > 0 && i < nu_; ++i) history_[i] = input_[i];

  const std::size_t square = std::size_t{nx_} * nx_, spread = std::size_t{all_} * all_, forces = all_ - nx_;
  double* const a = work_;
  double* const b = a + square;
  double* const push = b + std::size_t{nx_} * nu_;
  SpreadStage stage;
  stage.size = nx_;
  stage.inputs = nu_;
  stage.a = a;
  stage.stride = nx_;
  stage.b = b;
  // the feedback acts on what is estimated of the model's states
  stage.gain = answers ? gain_ : nullptr;
  stage.gain_stride = nx_;
  stage.input_variance = revision_;
  stage.push = push;
  for (std::uint32_t j = 0; j < hypotheses_; ++j) {
    for (std::size_t i = 0; i < square; ++i) a[i] = a_[i * lanes_ + j];
    for (std::size_t i = 0; i < std::size_t{nx_} * nu_; ++i) b[i] = b_[i * lanes_ + j];
    for (std::size_t i = 0; i < nx_ * forces; ++i) push[i] = push_[i * lanes_ + j];
    step_spread(*belief.spread, stage, error_ + j * spread, estimate_ + j * spread, push + nx_ * forces);
  }
}

void Prediction::summarise(std::uint32_t step) {
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double* row = state_ + i * lanes_;
    double mean = 0.0, between = 0.0, within = 0.0;
    for (std::uint32_t j = 0; j < hypotheses_; ++j) mean += weight_[j] * row[j] / hypotheses_;
    for (std::uint32_t j = 0; j < hypotheses_; ++j) {
      const std::size_t at = (std::size_t{j} * all_ + i) * all_ + i;
      between += weight_[j] * (row[j] - mean) * (row[j] - mean) / hypotheses_;
      within += weight_[j] * (error_[at] + estimate_[at]) / hypotheses_;
    }
    mean_[std::size_t{step} * nx_ + i] = mean;
    sd_[std::size_t{step} * nx_ + i] = std::sqrt(between + std::fmax(0.0, within));
  }
  if (covariance_) mix_covariance(step);
}

/// Within the hypotheses and between them.
void Prediction::mix_covariance(std::uint32_t step) {
  const std::size_t square = std::size_t{nx_} * nx_;
  const double* const mean = mean_ + std::size_t{step} * nx_;
  double* const out = covariance_ + step * square;
  std::fill(out, out + square, 0.0);
  for (std::uint32_t j = 0; j < hypotheses_; ++j)
    for (std::uint32_t r = 0; r < nx_; ++r)
      for (std::uint32_t c = 0; c < nx_; ++c) {
        const std::size_t at = (std::size_t{j} * all_ + r) * all_ + c;
        const double between = (state_[r * lanes_ + j] - mean[r]) * (state_[c * lanes_ + j] - mean[c]);
        out[r * nx_ + c] += weight_[j] * (between + error_[at] + estimate_[at]) / hypotheses_;
      }
}

/// How far the first input is from what the plan before and its feedback make of the present state; then the same of
/// the second input, for the next plan.
void Prediction::weigh_revision(const PlannerTable& table, const void* planner) {
  const float* sequence = table.sequence(planner);
  for (std::uint32_t i = 0; expects_ && i < nu_; ++i) {
    double u = expected_[i];
    for (std::uint32_t c = 0; c < nx_; ++c)
      u += expected_gain_[i * nx_ + c] * state_difference(*config_->model, c, mean_[c], expected_state_[c]);
    u = std::fmin(std::fmax(u, config_->safety.input_low[i]), config_->safety.input_high[i]);
    const double off = static_cast<double>(sequence[i]) - u;
    revision_[i] += (off * off - revision_[i]) / kRevisions;
  }
  for (std::uint32_t i = 0; i < nu_; ++i) expected_[i] = static_cast<double>(sequence[nu_ + i]);
  double unused[TILLER_MAX_INPUTS];
  if (!table.feedback || !table.feedback(planner, 1, expected_gain_, expected_state_, unused))
    std::fill(expected_gain_, expected_gain_ + std::size_t{nx_} * nu_, 0.0);
  expects_ = true;
}

void Prediction::predict(const Belief& belief, const PlannerTable& table, const void* planner,
                         std::uint64_t task_step) {
  if (!mean_ || !belief.spread || belief.count == 0) return;
  task_step_ = task_step;
  take_start(belief);
  summarise(0);
  weigh_revision(table, planner);
  for (std::uint32_t step = 0; step < config_->planner.horizon; ++step) {
    bool answers = false;
    take_inputs(table, planner, step, answers);
    advance(belief, answers);
    summarise(step + 1);
  }
  made_ = true;
}

}  // namespace tiller
