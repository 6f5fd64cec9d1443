#include "planners/prober.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planners/flush_to_zero.hpp"
#include "rollout/attitude.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr float kWorst = 1e30f;  // of a motion that is not finite
// A saving below this share of the plan's cost is within what sampled plans differ by from tick to tick.
constexpr double kLeastSaving = 0.01;
constexpr double kCautious = 0.03;   // share of a plan's cost that it may regret before another is looked for
constexpr std::uint32_t kRest = 3;   // periods between two looks where there is nothing to gain
constexpr double kFolds = 5.0;       // log2 from the widest to the finest of the samples
constexpr double kRefined = 0.15;    // width of the second round, of the first
constexpr float kLogistic = 1.702f;  // 1 / (1 + exp(-1.702 z)) is the normal distribution to 0.01, with heavier tails

constexpr float kFar = 6.0f;  // deviations from a bound that is never passed

/// Share of a normal variable that lies beyond a bound `z` deviations away. exp(x) is (1 + x/256)^256, by which the
/// share is 2 % high at 0.05: no calls, for lanes.
float beyond_bound(float z) {
  const float near = z > -kFar ? (z < 40.0f ? z : 40.0f) : -kFar;
  float odds = 1.0f + kLogistic / 256.0f * near;
  for (int doubling = 0; doubling < 8; ++doubling) odds *= odds;
  return 1.0f / (1.0f + odds);
}

void shift_sequence(float* sequence, std::uint32_t horizon, std::uint32_t nu, std::uint64_t ticks) {
  const std::uint32_t gone = static_cast<std::uint32_t>(std::min<std::uint64_t>(ticks, horizon - 1));
  std::copy(sequence + std::size_t{gone} * nu, sequence + std::size_t{horizon} * nu, sequence);
  for (std::uint32_t step = horizon - gone; step < horizon; ++step)
    std::copy(sequence + std::size_t{step - 1} * nu, sequence + std::size_t{step} * nu,
              sequence + std::size_t{step} * nu);
}

}  // namespace

std::uint32_t Prober::hypotheses_of(const tiller_config_t& config) {
  if (config.probe.hypotheses > 0) return config.probe.hypotheses;
  return config.planner.particles < 4 ? 8 : std::min(config.planner.particles, kMostProbeHypotheses);
}

void Prober::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table) {
  config_ = &config;
  setup_ = &setup;
  table_ = &table;
  nx_ = config.model->state_count;
  nu_ = config.model->input_count;
  np_ = param_rows(config, setup);
  ns_ = setup.effect_state_count;
  horizon_ = config.planner.horizon;
  knots_ = std::min({config.planner.knots, horizon_, kMostKnots});
  hypotheses_ = hypotheses_of(config);
  const std::size_t m = hypotheses_, signals = ProbeSight::most_signals(config);
  special_ = arena.take<float>(m * length());
  best_ = arena.take<float>(length());
  last_ = arena.take<float>(length());
  wish_ = arena.take<double>(length());
  margin_ = arena.take<double>(std::size_t{horizon_ + 1} * nx_);
  state_ = arena.take<float>(m * nx_);
  params_ = arena.take<float>(m * np_);
  effects_ = arena.take<float>(m * ns_);
  controls_ = arena.take<float>(length() * kBatch);
  trajectory_ = arena.take<float>(std::size_t{horizon_ + 1} * nx_ * kBatch);
  signal_ = arena.take<float>(m * horizon_ * signals * kBatch);
  beyond_ = arena.take<float>(std::size_t{horizon_ + 1} * kBatch);
  batch_cost_ = arena.take<float>(m * kBatch);
  told_cost_ = arena.take<float>(std::size_t{kStages} * kBatch);
  blind_ = arena.take<float>(length() * kBatch);
  reference_ = arena.take<float>(m * (horizon_ + 1) * nx_);
  apart_ = arena.take<float>(kStages * m * m * kBatch);
  table_cost_ = arena.take<double>((m + 1) * m);
  pad_ = (hypotheses_ + kLanePadding - 1) / kLanePadding * kLanePadding;
  lane_state_ = arena.take<float>(std::size_t{nx_} * pad_);
  lane_params_ = arena.take<float>(std::size_t{np_} * pad_);
  lane_effects_ = arena.take<float>(std::size_t{ns_} * pad_);
  lane_next_ = arena.take<float>(std::size_t{nx_} * pad_);
  lay_out_law(arena, config, setup, table, law_);
  gain_ = arena.take<float>(m * gains());
  cost_terms_.cost_to_go =
      config.cost.terminal == tiller_terminal_lqr ? arena.take<float>(std::size_t{nx_} * nx_) : nullptr;
  if (special_ == nullptr || !arena.fits()) return;
  (void)lay_out_cost(config, setup, table, nullptr, &cost_terms_);  // tiller_config_check has tried it
  frame_.lay_out(config);
  cones_ = make_input_cones(config.safety.cones, config.safety.cone_count);
  reset();
}

void Prober::reset() {
  has_last_ = has_best_ = sent_ = false;
  usual_cost_ = 0.0;
  searches_ = 0;
  resting_ = 0;
  reset_path_plan(law_.path);
}

// ---- before the rollouts ------------------------------------------------------------------------

void Prober::take_belief(const PlanRequest& request) {
  const Belief& belief = *request.belief;
  const auto take = [&](const float* rows, std::uint32_t count, float* splats, float* lanes) {
    for (std::uint32_t r = 0; r < count; ++r)
      for (std::uint32_t j = 0; j < pad_; ++j) {
        const float x = rows[r * belief.count + (j < hypotheses_ ? j : 0)];
        lanes[r * pad_ + j] = x;
        if (j < hypotheses_) splats[j * count + r] = x;
      }
  };
  take(belief.state, nx_, state_, lane_state_);
  take(belief.params, np_, params_, lane_params_);
  take(belief.effect_state, ns_, effects_, lane_effects_);
  align();
}

/// All hypotheses on the first one's turn of the angles, with its attitudes' signs: feedback takes plain differences.
void Prober::align() {
  const tiller_model_t& model = *config_->model;
  const float* const first = state_;
  for (std::uint32_t m = 0; m < hypotheses_; ++m) {
    float* const x = state_ + std::size_t{m} * nx_;
    for (std::uint32_t i = 0; i < nx_; ++i)
      if ((model.angle_mask >> i) & 1u)
        x[i] = static_cast<float>(static_cast<double>(first[i]) +
                                  state_difference(model, i, static_cast<double>(x[i]), static_cast<double>(first[i])));
    for_quaternions(model.quaternion_mask, [&](std::uint32_t q) {
      float along = 0.0f;
      for (std::uint32_t i = q; i < q + 4; ++i) along += x[i] * first[i];
      for (std::uint32_t i = q; along < 0.0f && i < q + 4; ++i) x[i] = -x[i];
    });
    for (std::uint32_t i = 0; i < nx_; ++i) lane_state_[i * pad_ + m] = x[i];
  }
}

/// How each hypothesis moves under its own sequence, and feedback about that motion.
void Prober::take_laws() {
  for (std::uint32_t j = 0; j < hypotheses_; ++j) {
    const std::size_t at = j;
    const Belief alone = {1, params_ + at * np_, state_ + at * nx_, effects_ + at * ns_, nullptr};
    compute_law(law_, *task_->plan, alone, special(j));
    std::copy(law_.gain, law_.gain + gains(), gain_ + at * gains());
    place_all(special(j));
    float cost[kBatch];
    roll(j, cost, trajectory_);
    float* const reference = reference_ + at * (horizon_ + 1) * nx_;
    for (std::size_t row = 0; row < std::size_t{horizon_ + 1} * nx_; ++row) reference[row] = trajectory_[row * kBatch];
  }
}

/// The law of who takes hypothesis j for true from a period on.
RolloutFeedback<float> Prober::law_of(std::size_t j, std::uint32_t from) const {
  RolloutFeedback<float> law = law_.law;
  law.from = from;
  law.gain = gain_ + j * gains();
  law.reference = {reference_ + j * (horizon_ + 1) * nx_, 0};
  return law;
}

/// The batch's inputs until a stage, then hypothesis m's own under its law, on m: the costs.
void Prober::answer(std::uint32_t m, std::uint32_t stage, float* cost) {
  const std::size_t until = std::size_t{stage_[stage]} * nu_;
  std::copy(blind_, blind_ + until * kBatch, controls_);
  const float* const own = special(m);
  for (std::size_t at = until; at < length(); ++at)
    std::fill(controls_ + at * kBatch, controls_ + (at + 1) * kBatch, own[at]);
  const RolloutFeedback<float> law = law_of(m, stage_[stage]);
  roll(m, cost, nullptr, &law);
}

void Prober::set_stages() {
  constexpr double kShare[kStages] = {0.04, 0.1, 0.25, 0.6};  // of the horizon
  stages_ = calibrates_ ? 1 : kStages;
  motion_ = std::max(static_cast<std::uint32_t>(std::lround(kShare[kMotion] * horizon_)), std::uint32_t{1});
  for (std::uint32_t a = 0; a < stages_; ++a) {
    const auto periods = static_cast<std::uint32_t>(std::lround(kShare[a] * horizon_));
    stage_[a] = calibrates_ ? horizon_ : std::max(periods, a > 0 ? stage_[a - 1] : std::uint32_t{1});
  }
}

/// The sequences of the tick before, as many periods later as ticks went by.
void Prober::follow_time(const ProbeTask& task) {
  const std::uint64_t tick = task.plan->tick;
  if (!has_last_ || tick < last_tick_) {
    for (std::uint32_t m = 0; m < hypotheses_; ++m)
      std::copy(task.sequence, task.sequence + length(), special_ + m * length());
    has_best_ = false;
  } else if (tick > last_tick_) {
    for (std::uint32_t m = 0; m < hypotheses_; ++m)
      shift_sequence(special_ + m * length(), horizon_, nu_, tick - last_tick_);
    if (has_best_) shift_sequence(best_, horizon_, nu_, tick - last_tick_);
  }
  last_tick_ = tick;
  has_last_ = true;
}

void Prober::take_limits(const ProbeTask& task) {
  for (std::uint32_t i = 0; i < nu_; ++i) {
    InputLimit& limit = limits_[i];
    limit.low = task.box ? task.box->input_low[i] : config_->safety.input_low[i];
    limit.high = task.box ? task.box->input_high[i] : config_->safety.input_high[i];
    limit.step = config_->safety.input_rate_per_s[i] * config_->period_s;
  }
  // a command in force that lies outside of a box is led back as its rate allows
  for (std::uint32_t i = 0; i < nu_; ++i) {
    wish_low_[i] = limits_[i].low;
    wish_high_[i] = limits_[i].high;
    const double last = task.plan->last_command ? task.plan->last_command[i] : config_->safety.safe_command[i];
    if (!(last >= config_->safety.input_low[i] && last <= config_->safety.input_high[i])) continue;
    limits_[i].low = std::fmin(limits_[i].low, last);
    limits_[i].high = std::fmax(limits_[i].high, last);
  }
  admit_commands(limits_, cones_, nu_, task.plan->last_command, config_->safety.safe_command, start_);
  for (std::uint32_t i = 0; i < nu_; ++i)
    start_lanes_[i] = static_cast<float>(task.plan->last_command ? task.plan->last_command[i] : start_[i]);
  const double* const low = task.box ? task.box->state_low : config_->cost.state_low;
  const double* const high = task.box ? task.box->state_high : config_->cost.state_high;
  bounded_ = 0;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (!std::isfinite(low[i]) && !std::isfinite(high[i])) continue;
    const double turns = task.plan->origin ? task.plan->origin[i] : 0.0;
    low_[bounded_] = low[i] - turns;
    high_[bounded_] = high[i] - turns;
    bounded_state_[bounded_++] = i;
  }
}

/// How far the state may stray from a hypothesis' motion: the estimate's error and the noise of the periods that a
/// probing motion takes, after which what was planned is planned again. A joint's position goes with its velocity.
void Prober::design_margins() {
  const StateSpread& spread = *task_->plan->belief->spread;
  const tiller_model_t& model = *config_->model;
  const double dt = config_->period_s;
  for (std::uint32_t i = 0; i < nx_; ++i)
    for (std::uint32_t step = 0; step <= horizon_; ++step)
      margin_[std::size_t{step} * nx_ + i] =
          std::sqrt(spread.covariance[i * nx_ + i] + std::min(step, motion_) * spread.process[i * nx_ + i]);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t p = model.joints[j].position, v = model.joints[j].velocity;
    if (p == TILLER_NO_POSITION) continue;
    double pp = spread.covariance[p * nx_ + p], pv = spread.covariance[p * nx_ + v],
           vv = spread.covariance[v * nx_ + v];
    for (std::uint32_t step = 0; step <= horizon_; ++step) {
      margin_[std::size_t{step} * nx_ + p] = std::sqrt(pp);
      if (step >= motion_) continue;
      pp += dt * (2.0 * pv + dt * vv) + spread.process[p * nx_ + p];
      pv += dt * vv + spread.process[p * nx_ + v];
      vv += spread.process[v * nx_ + v];
    }
  }
}

// ---- sequences ----------------------------------------------------------------------------------

/// What is wished for (horizon x nu) becomes a lane's inputs, under limits, rates and cones.
void Prober::place_wish(std::uint32_t lane) {
  double last[TILLER_MAX_INPUTS];
  std::copy(start_, start_ + nu_, last);
  for (std::uint32_t step = 0; step < horizon_; ++step) {
    double within[TILLER_MAX_INPUTS];
    for (std::uint32_t i = 0; i < nu_; ++i)
      within[i] = std::fmin(std::fmax(wish_[std::size_t{step} * nu_ + i], wish_low_[i]), wish_high_[i]);
    limit_commands(limits_, cones_, nu_, within, last);
    for (std::uint32_t i = 0; i < nu_; ++i)
      controls_[(std::size_t{step} * nu_ + i) * kBatch + lane] = static_cast<float>(last[i]);
  }
}

void Prober::place(std::uint32_t lane, const float* sequence) {
  std::copy(sequence, sequence + length(), wish_);
  place_wish(lane);
}

/// Every lane gets the first one's inputs.
void Prober::repeat_first() {
  for (std::size_t at = 0; at < length(); ++at)
    std::fill(controls_ + at * kBatch + 1, controls_ + (at + 1) * kBatch, controls_[at * kBatch]);
}

void Prober::place_all(const float* sequence) {
  place(0, sequence);
  repeat_first();
}

/// A sample around a sequence: at knots over the horizon (most lanes), or while a probing motion lasts. The lanes'
/// widths run geometrically over the batch.
void Prober::draw(Rng& rng, std::uint32_t lane, const float* around, double widest) {
  double knot[kMostKnots];
  const std::uint32_t end = lane % 3 == 1 ? std::min(motion_ + 1, horizon_) : horizon_;
  const bool square = calibrates_ && lane % 3 == 2;
  const double width = widest * math::exp(-0.6931471805599453 * kFolds * (lane % 8) / 7.0);
  for (std::uint32_t i = 0; i < nu_; ++i) {
    const double most = 0.5 * width * (wish_high_[i] - wish_low_[i]);
    for (std::uint32_t k = 0; k < knots_; ++k) knot[k] = most * rng.normal();
    // what tells most of parameters is often a square wave
    const double waves = math::exp(rng.uniform() * math::log(0.25 * end + 1.0)), phase = rng.uniform();
    for (std::uint32_t step = 0; step < horizon_; ++step) {
      const std::size_t index = std::size_t{step} * nu_ + i;
      wish_[index] = static_cast<double>(around[index]);
      if (step >= end) continue;
      const double share = static_cast<double>(step) / end, at = share * (knots_ - 1), turn = phase + waves * share;
      const std::uint32_t k = std::min(static_cast<std::uint32_t>(at), knots_ - 2);
      const double line = knot[k] + (at - k) * (knot[k + 1] - knot[k]);
      wish_[index] += !square ? line : turn - std::floor(turn) < 0.5 ? most : -most;
    }
  }
  place_wish(lane);
}

// ---- rollouts -----------------------------------------------------------------------------------

RolloutJob<float> Prober::common_job() const {
  RolloutJob<float> job;
  job.setup = setup_;
  job.horizon = horizon_;
  job.history = task_->plan->belief->history;
  job.previous_input = start_lanes_;
  job.cost = &cost_terms_;
  job.task_step = task_->plan->task_step;
  return job;
}

void Prober::roll(std::size_t m, float* cost, float* trajectory, const RolloutFeedback<float>* law) {
  RolloutJob<float> job = common_job();
  job.lanes = kBatch;
  job.state = {state_ + m * nx_, 0};
  job.params = {params_ + m * np_, 0};
  job.effect_state = {effects_ + m * ns_, 0};
  job.controls = {controls_, kBatch};
  job.cost_out = cost;
  job.trajectory = trajectory;
  job.feedback = law;
  table_->rollout_f32(*config_->model, job);
  for (std::uint32_t l = 0; l < kBatch; ++l)
    if (!(cost[l] < kWorst)) cost[l] = kWorst;
}

/// A round of sampling for each hypothesis alone, around its own sequence of the tick before and the planner's.
void Prober::specialise(Rng& rng) {
  for (std::uint32_t m = 0; m < hypotheses_; ++m) {
    float* const own = special(m);
    place(0, own);
    place(1, task_->sequence);
    for (std::uint32_t lane = 2; lane < kBatch; ++lane) draw(rng, lane, lane % 4 == 3 ? task_->sequence : own);
    float cost[kBatch];
    roll(m, cost, nullptr);
    const std::uint32_t least = static_cast<std::uint32_t>(std::min_element(cost, cost + kBatch) - cost);
    for (std::size_t at = 0; at < length(); ++at) own[at] = controls_[at * kBatch + least];
  }
}

/// What it costs to take one hypothesis for another: each one's own sequence, under its law, on every hypothesis; and
/// first the planner's own sequence.
void Prober::cross() {
  for (std::uint32_t plan = 0; plan <= hypotheses_; ++plan) {
    place_all(plan == 0 ? task_->sequence : special(plan - 1));
    RolloutFeedback<float> law;
    if (plan > 0) law = law_of(plan - 1, 1);
    RolloutJob<float> job = common_job();
    job.lanes = pad_;
    job.state = {lane_state_, pad_};
    job.params = {lane_params_, pad_};
    job.effect_state = {lane_effects_, pad_};
    job.controls = {controls_, kBatch};
    float cost[kMostProbeHypotheses];
    job.cost_out = cost;
    job.feedback = plan > 0 ? &law : nullptr;
    table_->rollout_f32(*config_->model, job);
    for (std::uint32_t m = 0; m < hypotheses_; ++m)
      table_cost_[plan * hypotheses_ + m] = static_cast<double>(cost[m] < kWorst ? cost[m] : kWorst);
  }
  regrets_.fill(hypotheses_, table_cost_);
  ignorant_ = regrets_.hedged > 0.0 ? regrets_.ignorance / regrets_.hedged : 0.0;
}

// ---- what a motion tells, and where it leads ----------------------------------------------------

/// A calibration's motion must not end at a speed that leads out of the box: where a horizon ends, positions are tried
/// half a horizon further on.
void Prober::measure_beyond() {
  const auto dt = static_cast<float>(config_->period_s), further_s = 0.5f * static_cast<float>(horizon_) * dt;
  for (std::uint32_t step = 1; bounded_ > 0 && step <= horizon_; ++step) {
    const float* const row = trajectory_ + std::size_t{step} * nx_ * kBatch;
    for (std::uint32_t b = 0; b < bounded_; ++b) {
      measure_beyond(step, b, row + bounded_state_[b] * kBatch);
      const std::uint32_t rate = rate_of(bounded_state_[b]);
      if (!calibrates_ || step < horizon_ || rate == TILLER_NO_POSITION) continue;
      float led[kBatch];
      for (std::uint32_t l = 0; l < kBatch; ++l)
        led[l] = row[bounded_state_[b] * kBatch + l] + further_s * row[rate * kBatch + l];
      measure_beyond(step, b, led);
    }
  }
}

/// State of the velocity whose position a state is; TILLER_NO_POSITION: it is none.
std::uint32_t Prober::rate_of(std::uint32_t state) const {
  const tiller_model_t& model = *config_->model;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position == state) return model.joints[j].velocity;
  return TILLER_NO_POSITION;
}

void Prober::measure_beyond(std::uint32_t step, std::uint32_t b, const float* x) {
  float* const row = beyond_ + std::size_t{step} * kBatch;
  const double sd = std::fmax(margin_[std::size_t{step} * nx_ + bounded_state_[b]], 1e-12);
  const auto each = static_cast<float>(share()), per_sd = static_cast<float>(1.0 / sd);
  const auto low = static_cast<float>(low_[b]), high = static_cast<float>(high_[b]);
  float under[kBatch], over[kBatch], least = kFar;
  for (std::uint32_t l = 0; l < kBatch; ++l) {
    under[l] = (x[l] - low) * per_sd;
    over[l] = (high - x[l]) * per_sd;
    const float nearest = under[l] < over[l] ? under[l] : over[l];
    least = nearest < least ? nearest : least;
  }
  if (!(least < kFar)) return;
  for (std::uint32_t l = 0; l < kBatch; ++l) {
    const float out = beyond_bound(under[l]) + beyond_bound(over[l]);
    row[l] += each * (out < 1.0f ? out : 1.0f);
    // how far outside, for what is: deviations, added up over the steps
    beyond_[l] += (under[l] < 0.0f ? -under[l] : 0.0f) + (over[l] < 0.0f ? -over[l] : 0.0f);
  }
}

/// Of each pair of hypotheses half the squared distance of their signals, up to each stage; of a calibration the Gram
/// matrix of the signals about their mean.
void Prober::accumulate() {
  const std::size_t row = std::size_t{sight_.signals()} * kBatch, size = stage_[stages_ - 1] * row;
  for (std::size_t at = 0; calibrates_ && at < size; ++at) {
    float mean = 0.0f;
    for (std::uint32_t m = 0; m < hypotheses_; ++m) mean += signal_[m * size + at];
    mean /= static_cast<float>(hypotheses_);
    for (std::uint32_t m = 0; m < hypotheses_; ++m) signal_[m * size + at] -= mean;
  }
  for (std::uint32_t i = 0; i < hypotheses_; ++i)
    for (std::uint32_t j = calibrates_ ? i : i + 1; j < hypotheses_; ++j) {
      float sum[kBatch] = {};
      const float* const a = signal_ + i * size;
      const float* const b = signal_ + j * size;
      std::size_t at = 0;
      for (std::uint32_t stage = 0; stage < stages_; ++stage) {
        for (; at < stage_[stage] * row; at += kBatch)
          for (std::uint32_t l = 0; l < kBatch; ++l) {
            const float x = a[at + l], y = b[at + l];
            sum[l] += calibrates_ ? x * y : 0.5f * (x - y) * (x - y);
          }
        std::copy(sum, sum + kBatch, apart_ + ((std::size_t{stage} * hypotheses_ + i) * hypotheses_ + j) * kBatch);
      }
    }
}

/// Rolls the batch out on every hypothesis; costs, distances and chances of leaving the bounds.
void Prober::judge() {
  std::fill(beyond_, beyond_ + std::size_t{horizon_ + 1} * kBatch, 0.0f);
  const std::size_t size = std::size_t{stage_[stages_ - 1]} * sight_.signals() * kBatch;
  for (std::uint32_t m = 0; m < hypotheses_; ++m) {
    roll(m, batch_cost_ + m * kBatch, trajectory_);
    sight_.whiten(trajectory_, stage_[stages_ - 1], kBatch, signal_ + m * size);
    measure_beyond();
  }
  accumulate();
  if (calibrates_) return;
  std::copy(controls_, controls_ + length() * kBatch, blind_);
  std::fill(told_cost_, told_cost_ + std::size_t{kStages} * kBatch, 0.0f);
  for (std::uint32_t m = 0; m < hypotheses_; ++m)
    for (std::uint32_t stage = 0; stage < stages_; ++stage) {
      float cost[kBatch];
      answer(m, stage, cost);
      for (std::uint32_t l = 0; l < kBatch; ++l)
        told_cost_[stage * kBatch + l] += static_cast<float>(share()) * cost[l];
    }
  std::copy(blind_, blind_ + length() * kBatch, controls_);
}

/// The numbers of pairs at a stage, as a full matrix; false where one is not finite.
bool Prober::read_pairs(std::uint32_t stage, std::uint32_t lane, double* pairs) const {
  const std::size_t m = hypotheses_;
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = calibrates_ ? i : i + 1; j < m; ++j) {
      const double value = static_cast<double>(apart_[((stage * m + i) * m + j) * kBatch + lane]);
      if (!std::isfinite(value)) return false;
      pairs[i * m + j] = pairs[j * m + i] = value;
    }
  return true;
}

/// Nats about which hypothesis it is, by when a probing motion is over.
double Prober::told_nats(std::uint32_t lane) const {
  double pairs[kMostProbeHypotheses * kMostProbeHypotheses];
  return read_pairs(kMotion, lane, pairs) ? mixture_information(hypotheses_, pairs).low : 0.0;
}

Prober::Score Prober::score(std::uint32_t lane) const {
  Score s{};
  s.beyond = 1.0;
  s.gain = -std::numeric_limits<double>::infinity();
  double pairs[kMostProbeHypotheses * kMostProbeHypotheses], blind = 0.0, learnt = 0.0;
  for (std::uint32_t m = 0; m < hypotheses_; ++m)
    blind += share() * static_cast<double>(batch_cost_[m * kBatch + lane]);
  for (std::uint32_t stage = 0; stage < stages_; ++stage) {
    if (!read_pairs(stage, lane, pairs)) return s;
    if (calibrates_) continue;
    const double by_now = std::fmax(learnt, std::fmin(config_->probe.weight * told_share(regrets_, pairs), 1.0));
    s.cost += (by_now - learnt) * static_cast<double>(told_cost_[stage * kBatch + lane]);
    learnt = by_now;
  }
  s.beyond = 0.0;
  for (std::uint32_t step = 1; step <= horizon_; ++step)
    s.beyond = std::fmax(s.beyond, static_cast<double>(beyond_[std::size_t{step} * kBatch + lane]));
  if (calibrates_) {
    s.gain = gaussian_information(hypotheses_, pairs);
    return s;
  }
  const double last = static_cast<double>(told_cost_[(kStages - 1) * kBatch + lane]);
  s.told = static_cast<double>(told_cost_[kMotion * kBatch + lane]);
  s.ignorance = ignorant_ * std::fmax(blind - static_cast<double>(told_cost_[lane]), 0.0);
  s.cost += (1.0 - learnt) * (last + ignorant_ * std::fmax(blind - last, 0.0));
  s.gain = -s.cost;
  return s;
}

/// The best of a batch becomes the chosen one, if it is better.
void Prober::consider(std::uint32_t first, std::uint32_t end) {
  for (std::uint32_t l = first; l < end; ++l) {
    Score s = score(l);
    if (!std::isfinite(s.gain)) continue;
    const bool inside = s.beyond <= std::fmax(config_->probe.risk, calibrates_ ? 0.0 : own_.beyond);
    if (!calibrates_ && (!inside || s.told - own_.told > task_->most_cost + task_->budget * std::fabs(own_.cost)))
      continue;
    const double nats = calibrates_ ? s.gain : 0.0;
    // from outside of the box the way back comes first: every motion inside is better than any that is not
    if (calibrates_ && !inside) s.gain = -1.0 - static_cast<double>(beyond_[l]);
    // what is under way goes on unless another is better by more than samples differ: two that take turns tell nothing
    const double ahead = !calibrates_ && goes_on_ ? kLeastSaving * std::fabs(own_.cost) : 0.0;
    if (has_best_ && !(s.gain > chosen_.gain + ahead)) continue;
    if (has_best_) goes_on_ = false;
    chosen_ = s;
    chosen_nats_ = calibrates_ ? nats : told_nats(l);
    has_best_ = true;
    for (std::size_t at = 0; at < length(); ++at) best_[at] = controls_[at * kBatch + l];
  }
}

/// Mean cost of the best one's first period and then the planner's sequence, told as late.
double Prober::switched_cost() {
  std::copy(task_->sequence, task_->sequence + length(), wish_);
  std::copy(best_, best_ + nu_, wish_);
  place_wish(0);
  repeat_first();
  std::copy(controls_, controls_ + length() * kBatch, blind_);
  double sum = 0.0;
  for (std::uint32_t m = 0; m < hypotheses_; ++m) {
    float cost[kBatch];
    answer(m, kMotion, cost);
    sum += share() * static_cast<double>(cost[0]);
  }
  return sum;
}

/// A saving that is worth a change of plan: of what plans cost on average, for at rest at its goal a robot has a small
/// cost, whose hundredth is nothing.
double Prober::least_saving(double cost) const { return kLeastSaving * std::fmax(std::fabs(cost), usual_cost_); }

/// Whether perfect information would save enough; if not, nothing is looked for until some periods later, and what was
/// found before is forgotten.
bool Prober::needs_to_know(ProbeResult& result) {
  double planned = 0.0;
  for (std::uint32_t m = 0; m < hypotheses_; ++m) planned += share() * table_cost_[m];
  result.plan_cost = planned;
  // one that is not finite on a hypothesis says nothing of what plans cost
  if (planned * hypotheses_ < static_cast<double>(kWorst))
    usual_cost_ += (std::fabs(planned) - usual_cost_) / static_cast<double>(++searches_);
  if (regrets_.ignorance > least_saving(planned) || regrets_.hedged > kCautious * std::fabs(planned)) return true;
  resting_ = kRest;
  sent_ = has_best_ = false;
  return false;
}

ProbeResult Prober::search(const ProbeTask& task) {
  const FlushToZero flush;
  task_ = &task;
  calibrates_ = task.box != nullptr;
  const PlanRequest& request = *task.plan;
  (void)frame_.take_goal(request, cost_terms_);
  (void)frame_.move_to(request.origin, cost_terms_);
  set_stages();
  take_belief(request);
  sight_.design(*config_->model, config_->period_s, *request.belief->spread);
  take_limits(task);
  design_margins();
  follow_time(task);
  Rng rng(config_->seed, kRngProbe, request.tick);
  ProbeResult result;
  if (!calibrates_) {
    if (resting_ > 0) {
      --resting_;
      return result;
    }
    specialise(rng);
    take_laws();
    cross();
    if (!needs_to_know(result)) return result;
  }
  float* const last = last_;
  const bool had = has_best_;
  std::copy(had ? best_ : task.sequence, (had ? best_ : task.sequence) + length(), last);
  has_best_ = false;
  for (std::uint32_t first = 0; first < config_->probe.rollouts; first += kBatch) {
    // one batch a tick is enough for a motion that is planned anew in each: widely and finely in turn
    const bool refines = calibrates_ && had && request.tick % 2 == 1;
    for (std::uint32_t l = 0; l < kBatch; ++l)
      draw(rng, l, refines || (l % 2 == 1 && had) ? last : task.sequence, refines ? kRefined : 1.0);
    if (first == 0) {
      place(0, task.sequence);
      place(1, last);
      // to act as if one were true: half of the batch at most
      for (std::uint32_t m = 0; !calibrates_ && m < hypotheses_ && m < kBatch / 2; ++m) place(2 + m, special(m));
    }
    judge();
    if (first == 0) {
      own_ = score(0);
      goes_on_ = sent_ && had;
      if (goes_on_) consider(1, 2);
      goes_on_ = goes_on_ && has_best_;
    }
    consider(0, kBatch);
  }
  if (has_best_ && !calibrates_) {
    std::copy(best_, best_ + length(), last);
    for (std::uint32_t l = 0; l < kBatch; ++l) draw(rng, l, last, kRefined);
    judge();
    consider(0, kBatch);
  }
  result.plan_cost = own_.cost;
  const bool was_sent = sent_;
  sent_ = false;
  if (!has_best_) return result;
  result.information = chosen_nats_;
  if (calibrates_) {
    result.probes = true;
    return result;
  }
  result.cost = std::fmax(chosen_.told - own_.told, 0.0);
  result.value = own_.cost - chosen_.cost + result.cost;
  const double least = least_saving(own_.cost);
  const bool needs = own_.ignorance > least || regrets_.hedged > kCautious * std::fabs(own_.cost);
  result.probes = sent_ = needs && own_.cost - chosen_.cost > (was_sent ? 0.0 : least);
  if (result.probes) result.step_cost = std::fmin(std::fmax(switched_cost() - own_.told, 0.0), result.cost);
  return result;
}

double Prober::stage_cost(const double* input, std::uint64_t task_step) {
  float control[TILLER_MAX_INPUTS], whole[kMostProbeHypotheses], end[kMostProbeHypotheses];
  for (std::uint32_t i = 0; i < nu_; ++i) control[i] = static_cast<float>(input[i]);
  RolloutJob<float> job = common_job();
  job.lanes = pad_;
  job.horizon = 1;
  job.task_step = task_step;
  job.state = {lane_state_, pad_};
  job.params = {lane_params_, pad_};
  job.effect_state = {lane_effects_, pad_};
  job.controls = {control, 0};
  job.cost_out = whole;
  job.final_state = lane_next_;
  table_->rollout_f32(*config_->model, job);
  job.horizon = 0;
  job.task_step = task_step + 1;
  job.state = {lane_next_, pad_};
  job.cost_out = end;
  job.final_state = nullptr;
  table_->rollout_f32(*config_->model, job);
  double sum = 0.0;
  for (std::uint32_t m = 0; m < hypotheses_; ++m)
    sum += share() * (static_cast<double>(whole[m]) - static_cast<double>(end[m]));
  return std::isfinite(sum) ? std::fmax(sum, 0.0) : 0.0;
}

}  // namespace tiller
