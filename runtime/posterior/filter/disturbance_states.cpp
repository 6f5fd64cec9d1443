#include "posterior/filter/disturbance_states.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "rollout/attitude.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// A force that is small against any that matters and large against rounding.
constexpr double kSmall = 1e-4;
/// Prior deviation of a force that the model lacks, in what accelerates its joint as half of the inputs' range does: a
/// robot that works is stronger than its friction. Of a viscous one at the speed that this range reaches in kReach_s.
constexpr double kSpread = 0.2;
constexpr double kReach_s = 0.2;
/// Below this share of the usual speed a joint that dry friction would stop says nothing.
constexpr double kSlow = 0.2;
/// Ticks over which the usual speed is averaged.
constexpr double kSpeedTicks = 256.0;
/// Sizes of the forces, as logarithms over one that matters: from nothing that a sensor shows to two fifths of what
/// half of the inputs' range can hold (one deviation). The lower half is a world without: its likelihood is flat there.
constexpr double kSmallest = -6.0, kLargest = 0.7;
/// A world is still unless the data say otherwise: the deviation of the half normal law that the sizes have.
constexpr double kStill = 2.0;
/// Times that a wandering force lasts, in s, as logarithms: from a gust to what is as good as constant.
constexpr double kShortest = -2.3, kLongest = 4.1;
/// How fast it swings, in rad/s, as logarithms: from once in ten minutes, which is not at all, to 5 Hz or a radian a
/// period.
constexpr double kSteadiest = -4.6, kQuickest = 3.4;
/// It does not swing unless the data say so: the deviation of the half normal law of that.
constexpr double kSteady = 4.0;
/// Of a force that is looked out for: its deviation over the limit beyond which it is a contact, and how long it lasts.
/// It then walks by a tenth of the limit in a period of 20 ms.
constexpr double kContact = 0.7, kContact_s = 2.0;
/// Of a force at a joint of a robot without such limits: over what matters there. It walks by a fifth of it in 20 ms.
constexpr double kShove = 1.4;
/// A viscous or dry force's random walk per square root of a second, in its own deviations: friction is no constant,
/// and a filter that takes it for one never gets over what it once believed.
constexpr double kDrift = 0.01;
/// Rates of a parameter's drift, as logarithms of deviations of its prior per square root of a second: from a twentieth
/// of one in an hour, which no sensor shows, to a whole one in a second. The lower half is a parameter that stays. Even
/// odds: who names a parameter as one that may drift does not know that it stays.
constexpr double kSlowest = -7.0, kFastest = 0.0;
/// Share of the strongest change by the inputs below which they do not reach a joint that none drives, or a state: a
/// drone's sideways. What matters there is what matters elsewhere.
constexpr double kOutOfReach = 0.1;
/// Two forces whose effects on a step differ by less do the same: within a period a velocity changes by about as much.
constexpr double kAlike = 0.05;
/// Share of the inputs' range that moves a joint by a hundredth of kReach_s's speed within a period of 20 ms.
constexpr double kNudge = 0.05;

/// Mean direction of dry friction over a step, as the velocity and as the position feel it.
struct DryShare {
  double velocity, position;
};

/// A joint that begins at velocity v, would change it by `free` without dry friction, and by `dry` at most with it
/// alone. Where it reverses, friction turns round, and holds it if it is the stronger.
DryShare dry_share(double v, double free, double dry) {
  const double sign = v != 0.0 ? std::copysign(1.0, v) : -std::copysign(1.0, free);
  const double slowing = dry - free * sign;  // of the speed over a whole step
  if (!(dry > 0.0) || !(slowing > std::fabs(v))) return {sign, sign};
  const double until = std::fabs(v) / slowing, rest = 1.0 - until;  // shares of the step before and after the reversal
  const double after = std::fmin(1.0, std::fabs(free) / dry);
  return {sign * (until - after * rest), sign * (1.0 - (1.0 + after) * rest * rest)};
}

/// Of a force of deviation 1 that wanders, over a period of `a` times tau, given where it begins: the variance of its
/// end, of its mean, and what they have in common.
struct Wandering {
  double end, mean, both;
};
Wandering wandering_over(double a) {
  const double kept = math::exp(-a);
  // the mean's terms cancel to third order: below, their series
  const double mean = a > 0.01 ? (2.0 * a - 3.0 + kept * (4.0 - kept)) / (a * a) : a * (2.0 / 3.0 - 0.5 * a);
  return {1.0 - kept * kept, mean, a > 1e-8 ? (1.0 - kept) * (1.0 - kept) / a : a};
}

}  // namespace

DisturbanceStates::DisturbanceStates(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                                     std::uint64_t drift)
    : config_(&config), table_(&table), setup_(setup), nx_(config.model->state_count) {
  // of a configuration with as many effects as there can be, the responses are those without the last one
  slot_ = std::min<std::uint32_t>(setup.effect_count, TILLER_MAX_EFFECTS - 1);
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
    if (config.model->joints[j].position != TILLER_NO_POSITION) is_position_[config.model->joints[j].position] = true;
  if (config.model->joint_count > 0)
    add_forces();
  else
    add_slips();
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    if (((drift >> i) & 1u) == 0) continue;
    sd_[states_] = prior_spread(config.priors[i]);
    add_source(i, 1, sizes_ + times() + drifts_);
    ++drifts_;
  }
}

void DisturbanceStates::add_source(std::uint32_t index, std::uint32_t states, std::uint32_t size) {
  source_[sources()] = {static_cast<std::uint16_t>(index), static_cast<std::uint16_t>(states_),
                        static_cast<std::uint16_t>(size)};
  states_ += states;
}

std::uint32_t DisturbanceStates::room(const tiller_config_t& config) {
  return kMaxFilterStates - config.model->state_count - TILLER_MAX_DRIFTS;
}

std::uint32_t DisturbanceStates::joints_of(const tiller_config_t& config) {
  return config.posterior.disturbance ? std::min(config.model->joint_count, room(config)) : 0;
}

/// A few joints have a size each; of many those with a position share one, and those without: a body's forces and
/// moments.
void DisturbanceStates::add_forces() {
  const std::uint32_t joints = joints_of(*config_);
  const bool few = joints <= kDiscrepancyJoints;
  per_joint_ = few && joints * kAllKinds <= room(*config_) ? kAllKinds : 1;
  bool placed = false, loose = false;
  for (std::uint32_t j = 0; j < joints; ++j) {
    const bool has_place = config_->model->joints[j].position != TILLER_NO_POSITION;
    placed = placed || has_place;
    loose = loose || !has_place;
    add_source(j, per_joint_, few ? j : (has_place || !placed ? 0 : 1));
    ++joints_;
  }
  sizes_ = few ? joints : static_cast<std::uint32_t>(placed) + static_cast<std::uint32_t>(loose);
}

/// No more than a plan has room for, of whatever wanders.
std::uint32_t DisturbanceStates::slips_of(const tiller_config_t& config) {
  if (!config.posterior.disturbance || config.model->joint_count > 0) return 0;
  const std::uint32_t taken = quaternion_states(config.model->quaternion_mask);
  const std::uint32_t most = std::min<std::uint32_t>(room(config), TILLER_MAX_JOINTS);
  std::uint32_t slips = 0, count = 0;
  for (std::uint32_t i = 0; i < config.model->state_count && count < most; ++i) {
    if (!(config.process_sd[i] > 0.0) || ((taken >> i) & 1u) != 0) continue;
    slips |= 1u << i;
    ++count;
  }
  return slips;
}

void DisturbanceStates::add_slips() {
  const std::uint32_t slips = slips_of(*config_);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (((slips >> i) & 1u) == 0) continue;
    add_source(i, 1, 0);
    ++slips_;
  }
  sizes_ = slips_ > 0 ? 1 : 0;
}

std::uint32_t DisturbanceStates::source_of(std::uint32_t state) const {
  const std::uint32_t by_force = joints_ * per_joint_;
  return state < by_force ? state / per_joint_ : joints_ + state - by_force;
}

std::uint32_t DisturbanceStates::drift_of(std::uint32_t param) const {
  std::uint32_t drift = 0;
  while (drift < drifts_ && drift_param(drift) != param) ++drift;
  return drift;
}

void DisturbanceStates::take_sizes(const DisturbanceStates& other) {
  std::copy(other.sd_, other.sd_ + states_ - drifts_, sd_);
}

void DisturbanceStates::clear() {
  for (double& square : speed_square_) square = 0.0;
  seen_ = 0.0;
}

RolloutJob<double> DisturbanceStates::rollout_of(const Lanes16& job) const {
  RolloutJob<double> rollout;
  rollout.setup = &setup_;
  rollout.lanes = job.lanes;
  rollout.horizon = 1;
  rollout.period_s = job.period_s;
  rollout.state = job.state;
  rollout.params = {job.params, job.lanes};
  rollout.effect_state = job.effect_state;
  rollout.controls = {job.input, 0};
  rollout.history = job.history;
  return rollout;
}

/// Never beyond the prior's bounds.
double DisturbanceStates::drifted(std::uint32_t param, double value, double by) const {
  if (by == 0.0) return value;
  const tiller_prior_t& prior = config_->priors[param];
  const double to = to_coordinate(prior, value) + by;
  return from_coordinate(prior, std::clamp(to, coordinate_low(prior), coordinate_high(prior)));
}

void DisturbanceStates::drift(const Lanes16& job) const {
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    double* row = job.params + drift_param(i) * job.lanes;
    const double* by = job.state.data + (nx_ + drift_state(i)) * job.state.stride;
    for (std::uint32_t l = 0; l < job.lanes; ++l) row[l] = drifted(drift_param(i), row[l], by[l]);
  }
}

void DisturbanceStates::step(const Lanes16& job) const {
  for (std::uint32_t l = 0; l < job.lanes; ++l) {
    const double rate = rate_of(job, l), turn = law_of(job, turn_row(), l);
    job.kept[l] = turn_after(rate, turn, job.period_s);
    job.mean[l] = mean_kept(rate, turn, job.period_s);
  }
  respond_to_forces(job);
  respond_to_drifts(job);
  // what is there pushes only once all responses are taken about the free step
  for (std::uint32_t l = 0; l < job.lanes; ++l) {
    for (std::uint32_t j = 0; j < joints_; ++j) push_force(job, j, l);
    for (std::uint32_t i = 0; i < slips_; ++i) push_slip(job, joints_ + i, l);
    for (std::uint32_t i = 0; i < drifts_; ++i) push_drift(job, joints_ + slips_ + i, l);
  }
}

void DisturbanceStates::respond_to_forces(const Lanes16& job) const {
  if (joints_ == 0) return;
  const std::uint32_t lanes = job.lanes, np = config_->param_count;
  StepSetup with = setup_;
  with.effect_count = slot_ + 1;
  RolloutJob<double> rollout = rollout_of(job);
  rollout.setup = &with;
  for (std::uint32_t l = 0; l < lanes; ++l) job.params[np * lanes + l] = kSmall;
  for (std::uint32_t j = 0; j < joints_; ++j) {
    double* unit = job.unit + std::size_t{j} * nx_ * lanes;
    with.effects[slot_] = {tiller_effect_constant_offset, static_cast<std::uint16_t>(j), static_cast<std::uint16_t>(np),
                           0};
    rollout.final_state = unit;
    table_->rollout_f64(*config_->model, rollout);
    for (std::uint32_t i = 0; i < nx_ * lanes; ++i) unit[i] = (unit[i] - job.next[i]) / kSmall;
  }
}

/// By the parameter's coordinate, away from a bound that it stands at.
void DisturbanceStates::respond_to_drifts(const Lanes16& job) const {
  const std::uint32_t lanes = job.lanes;
  RolloutJob<double> rollout = rollout_of(job);
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    const std::uint32_t param = drift_param(i);
    double* const row = job.params + param * lanes;
    double* const unit = job.unit + std::size_t{joints_ + slips_ + i} * nx_ * lanes;
    const double step = kSmall * sd_[drift_state(i)];
    double before[Lanes16::kMost], by[Lanes16::kMost];
    for (std::uint32_t l = 0; l < lanes; ++l) {
      before[l] = row[l];
      const bool at_top =
          to_coordinate(config_->priors[param], row[l]) + step > coordinate_high(config_->priors[param]);
      by[l] = at_top ? -step : step;
      row[l] = drifted(param, row[l], by[l]);
    }
    rollout.final_state = unit;
    table_->rollout_f64(*config_->model, rollout);
    for (std::uint32_t l = 0; l < lanes; ++l) {
      row[l] = before[l];
      for (std::uint32_t r = 0; r < nx_; ++r)
        unit[r * lanes + l] = (unit[r * lanes + l] - job.next[r * lanes + l]) / by[l];
    }
  }
}

void DisturbanceStates::push_force(const Lanes16& job, std::uint32_t j, std::uint32_t l) const {
  const tiller_joint_t& joint = config_->model->joints[j];
  const std::uint32_t lanes = job.lanes, first = nx_ + source_[j].first;
  const double* unit = job.unit + std::size_t{j} * nx_ * lanes;
  double beta[kAllKinds] = {};
  for (std::uint32_t k = 0; k < per_joint_; ++k) {
    beta[k] = job.state.data[(first + k) * job.state.stride + l];
    job.next[(first + k) * lanes + l] = beta[k];
  }
  const Turn<double>&end = job.kept[l], &mean = job.mean[l];
  job.next[(first + kWandering) * lanes + l] = end.along * beta[kWandering] - end.across * beta[kTurning];
  if (turns()) job.next[(first + kTurning) * lanes + l] = end.across * beta[kWandering] + end.along * beta[kTurning];
  const double v = job.state.data[joint.velocity * job.state.stride + l], g = unit[joint.velocity * lanes + l];
  const double unforced = job.next[joint.velocity * lanes + l] - v, middle = v + 0.5 * unforced;
  const double wandering = mean.along * beta[kWandering] - mean.across * beta[kTurning];
  const double free = unforced + g * (wandering - beta[kViscous] * middle);
  const DryShare dry = dry_share(v, free, std::fabs(g) * beta[kDry]);
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double share[kAllKinds] = {mean.along, -mean.across, -middle,
                                     -(is_position_[r] ? dry.position : dry.velocity)};
    for (std::uint32_t k = 0; k < per_joint_; ++k) {
      const double push = unit[r * lanes + l] * share[k];
      job.next[r * lanes + l] += push * beta[k];
      job.push[(r * states_ + source_[j].first + k) * lanes + l] = push;
    }
  }
}

void DisturbanceStates::push_slip(const Lanes16& job, std::uint32_t source, std::uint32_t l) const {
  const std::uint32_t lanes = job.lanes, first = source_[source].first, slipping = source_[source].index;
  const double slip = job.state.data[(nx_ + first) * job.state.stride + l];
  const double push = job.period_s * job.mean[l].along;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    job.unit[(std::size_t{source} * nx_ + r) * lanes + l] = r == slipping ? job.period_s : 0.0;
    job.push[(r * states_ + first) * lanes + l] = r == slipping ? push : 0.0;
  }
  job.next[slipping * lanes + l] += push * slip;
  job.next[(nx_ + first) * lanes + l] = slip * job.kept[l].along;
}

/// The step was taken with the parameter as it has drifted.
void DisturbanceStates::push_drift(const Lanes16& job, std::uint32_t source, std::uint32_t l) const {
  const std::uint32_t lanes = job.lanes, first = source_[source].first;
  for (std::uint32_t r = 0; r < nx_; ++r)
    job.push[(r * states_ + first) * lanes + l] = job.unit[(std::size_t{source} * nx_ + r) * lanes + l];
  job.next[(nx_ + first) * lanes + l] = job.state.data[(nx_ + first) * job.state.stride + l];
}

/// (1 - exp(-c t)) / (c t), c = rate - i turn.
Turn<double> DisturbanceStates::mean_kept(double rate, double turn, double time_s) {
  const double a = rate * time_s, b = turn * time_s, square = a * a + b * b;
  if (square < 1e-16) return {1.0, 0.0};
  const Turn<double> end = turn_after(rate, turn, time_s);
  const double gone = 1.0 - end.along;
  return {(gone * a + end.across * b) / square, (gone * b - end.across * a) / square};
}

void DisturbanceStates::fill_slopes(const Lanes16& job, double* rows, std::uint32_t n) const {
  const std::uint32_t lanes = job.lanes, own = n - states_;
  std::fill(rows, rows + std::size_t{states_} * n * lanes, 0.0);
  const auto at = [&](std::uint32_t r, std::uint32_t c) { return rows + (std::size_t{r} * n + own + c) * lanes; };
  for (std::uint32_t f = 0; f < states_; ++f) std::fill(at(f, f), at(f, f) + lanes, 1.0);
  for (std::uint32_t s = 0; s < joints_ + slips_; ++s) {
    const std::uint32_t real = source_[s].first + kWandering, imaginary = source_[s].first + kTurning;
    for (std::uint32_t l = 0; l < lanes; ++l) {
      at(real, real)[l] = job.kept[l].along;
      if (s >= joints_ || !turns()) continue;
      at(real, imaginary)[l] = -job.kept[l].across;
      at(imaginary, real)[l] = job.kept[l].across;
      at(imaginary, imaginary)[l] = job.kept[l].along;
    }
  }
}

tiller_prior_t DisturbanceStates::law_prior(std::uint32_t coordinate) const {
  if (coordinate < sizes_) return {tiller_prior_normal, 0, kSmallest, kStill, kSmallest, kLargest};
  if (coordinate == sizes_ && times() > 0) return {tiller_prior_uniform, 0, kShortest, 0.0, kShortest, kLongest};
  if (coordinate == sizes_ + 1 && times() > 1) {
    const double quickest = std::fmin(kQuickest, -math::log(config_->period_s));
    return {tiller_prior_normal, 0, kSteadiest, kSteady, kSteadiest, quickest};
  }
  return {tiller_prior_uniform, 0, kSlowest, 0.0, kSlowest, kFastest};
}

void DisturbanceStates::read_law(const double* coordinate, std::uint32_t stride, double* law,
                                 std::uint32_t law_stride) const {
  for (std::uint32_t s = 0; s < sources(); ++s) {
    const double size = math::exp(2.0 * coordinate[std::size_t{source_[s].size} * stride]);
    law[s * law_stride] = s < joints_ + slips_ ? size : size * sd_[source_[s].first] * sd_[source_[s].first];
  }
  law[rate_row() * law_stride] = times() > 0 ? math::exp(-coordinate[std::size_t{sizes_} * stride]) : 1.0;
  law[turn_row() * law_stride] = times() > 1 ? math::exp(coordinate[std::size_t{sizes_ + 1} * stride]) : 0.0;
}

void DisturbanceStates::fixed_law(double* law, std::uint32_t stride) const {
  for (std::uint32_t s = 0; s < sources(); ++s) law[s * stride] = s < joints_ + slips_ ? 1.0 : 0.0;
  law[rate_row() * stride] = 1.0;
  law[turn_row() * stride] = 0.0;
}

bool feels_contacts(const tiller_config_t& config) {
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
    if (std::isfinite(config.safety.contact_force[config.model->joints[j].velocity])) return true;
  return false;
}

void DisturbanceStates::sudden_law(double* law, std::uint32_t stride) const {
  const double unlimited = feels_contacts(*config_) ? 0.0 : kShove;
  for (std::uint32_t s = 0; s < sources(); ++s) law[s * stride] = 0.0;
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const double limit = config_->safety.contact_force[config_->model->joints[j].velocity];
    const double one = sd_[source_[j].first];
    const double size = !std::isfinite(limit) ? unlimited : one > 0.0 ? kContact * limit / one : 0.0;
    law[j * stride] = size * size;
  }
  law[rate_row() * stride] = 1.0 / kContact_s;
  law[turn_row() * stride] = 0.0;
}

void DisturbanceStates::prior_variance(const double* law, std::uint32_t stride, double* variance) const {
  for (std::uint32_t f = 0; f < states_; ++f)
    variance[f] = f < states_ - drifts_ ? law[source_of(f) * stride] * sd_[f] * sd_[f] : 0.0;
}

double DisturbanceStates::friction_variance(std::uint32_t state, double law, double after_s) const {
  return law * sd_[state] * sd_[state] * (1.0 + kDrift * kDrift * after_s);
}

void DisturbanceStates::add_process(const Lanes16& job, double* covariance) const {
  const std::uint32_t lanes = job.lanes, n = nx_ + states_;
  const auto at = [&](std::uint32_t r, std::uint32_t c) { return covariance + triangle_row(n, r, c) * lanes; };
  Wandering wandering[Lanes16::kMost];
  for (std::uint32_t l = 0; l < lanes; ++l) wandering[l] = wandering_over(rate_of(job, l) * job.period_s);
  constexpr Wandering kWalk = {1.0, 1.0 / 3.0, 0.5};  // of a walk: its end, its mean, and what they have in common
  for (std::uint32_t s = 0; s < sources(); ++s) {
    const bool drifts = s >= joints_ + slips_;
    const std::uint32_t first = source_[s].first;
    const double* const unit = job.unit + std::size_t{s} * nx_ * lanes;
    const double sd = sd_[first], scale = drifts ? job.period_s : sd * sd;
    double mean[Lanes16::kMost], both[Lanes16::kMost];
    for (std::uint32_t l = 0; l < lanes; ++l) {
      const Wandering& w = drifts ? kWalk : wandering[l];
      const double size = law_of(job, s, l), variance = size * scale;
      mean[l] = variance * w.mean;
      both[l] = variance * w.both;
      at(nx_ + first, nx_ + first)[l] += variance * w.end;
      if (s >= joints_ || !turns()) continue;
      at(nx_ + first + kTurning, nx_ + first + kTurning)[l] += variance * w.end;
      for (std::uint32_t k : {kViscous, kDry})
        at(nx_ + first + k, nx_ + first + k)[l] +=
            kDrift * kDrift * size * sd_[first + k] * sd_[first + k] * job.period_s;
    }
    for (std::uint32_t r = 0; r < nx_; ++r) {
      double push[Lanes16::kMost];
      for (std::uint32_t l = 0; l < lanes; ++l) {
        at(r, nx_ + first)[l] += both[l] * unit[r * lanes + l];
        push[l] = mean[l] * unit[r * lanes + l];
      }
      for (std::uint32_t c = r; c < nx_; ++c)
        for (std::uint32_t l = 0; l < lanes; ++l) at(r, c)[l] += push[l] * unit[c * lanes + l];
    }
  }
}

std::uint32_t DisturbanceStates::pushed_state(std::uint32_t source) const {
  const std::uint32_t index = source_[source].index;
  return source < joints_ ? config_->model->joints[index].velocity : index;
}

void DisturbanceStates::measure_reach(const Lanes16& job) {
  const std::uint32_t sources = joints_ + slips_;
  if (sources == 0) return;
  // what half of each input's range does over a period
  double reach[kMaxFilterStates] = {}, input[TILLER_MAX_INPUTS];
  RolloutJob<double> rollout = rollout_of(job);
  double *idle = job.push, *driven = job.next;  // nobody wants them any more
  rollout.final_state = idle;
  table_->rollout_f64(*config_->model, rollout);
  for (std::uint32_t i = 0; i < config_->model->input_count; ++i) {
    std::copy(job.input, job.input + config_->model->input_count, input);
    input[i] += 0.5 * (config_->safety.input_high[i] - config_->safety.input_low[i]);
    rollout.controls = {input, 0};
    rollout.final_state = driven;
    table_->rollout_f64(*config_->model, rollout);
    for (std::uint32_t s = 0; s < sources; ++s) {
      const double change = driven[pushed_state(s) * job.lanes] - idle[pushed_state(s) * job.lanes];
      reach[s] = std::hypot(reach[s], std::isfinite(change) ? change : 0.0);
    }
  }
  for (std::uint32_t s = 0; s < sources; ++s) {
    const bool driven_itself = s < joints_ && config_->model->joints[source_[s].index].drive != 0;
    double farthest = reach[s];
    for (std::uint32_t other = 0; other < sources && !driven_itself; ++other)
      if (source_[s].size == source_[other].size && reach[s] < kOutOfReach * reach[other])
        farthest = std::fmax(farthest, reach[other]);
    const std::uint32_t first = source_[s].first;
    const double push = std::fabs(job.unit[(std::size_t{s} * nx_ + pushed_state(s)) * job.lanes]);
    const double one = push > 0.0 && std::isfinite(push) ? kSpread * farthest / push : 0.0;
    const double speed = farthest * kReach_s / job.period_s;
    sd_[first] = one;
    if (s >= joints_ || !turns()) continue;
    sd_[first + kTurning] = sd_[first + kDry] = one;
    sd_[first + kViscous] = speed > 0.0 ? one / speed : 0.0;
    drop_known(job, s, speed);
  }
}

/// Friction that the model has as a parameter which is learnt is not looked for twice: two that do the same could not
/// be told apart, and both would be as good as unknown. What a parameter does to the step at rest and at three speeds
/// of a joint says whether it is one. The lanes' states and parameters are lane 0's from then on.
void DisturbanceStates::drop_known(const Lanes16& job, std::uint32_t j, double speed) {
  constexpr double kSpeeds[] = {0.0, 1.0, -1.0, 2.0};
  constexpr std::uint32_t kRest = 0, kOn = 1, kBack = 2, kTwice = 3;
  const std::uint32_t lanes = job.lanes, rate = config_->model->joints[j].velocity, first = source_[j].first;
  double *state = job.next, *before = job.push, *after = job.push + std::size_t{nx_} * lanes;
  const auto level = [lanes](double* to, const double* from) { std::fill(to, to + lanes, *from); };
  for (std::uint32_t r = 0; r < nx_; ++r) level(state + r * lanes, job.state.data + r * job.state.stride);
  for (std::uint32_t i = 0; i < config_->param_count; ++i) level(job.params + i * lanes, job.params + i * lanes);
  for (std::uint32_t l = 0; l < lanes; ++l) state[rate * lanes + l] = speed * kSpeeds[l % 4];
  RolloutJob<double> rollout = rollout_of(job);
  rollout.state = {state, lanes};
  // under an input an inertia, which divides a friction as well, does not turn round with the speed
  double input[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < config_->model->input_count; ++i)
    input[i] = job.input[i] + kNudge * (config_->safety.input_high[i] - config_->safety.input_low[i]);
  rollout.controls = {input, 0};
  rollout.final_state = before;
  table_->rollout_f64(*config_->model, rollout);
  rollout.final_state = after;
  const double* const unit = job.unit + std::size_t{j} * nx_ * lanes;
  for (std::uint32_t i = 0; i < config_->param_count; ++i) {
    const tiller_prior_t& prior = config_->priors[i];
    if (prior.kind == tiller_prior_fixed) continue;
    double* const row = job.params + i * lanes;
    const double own = *row, moved = drifted(i, own, kSmall * prior_spread(prior));
    std::fill(row, row + lanes, moved != own ? moved : drifted(i, own, -kSmall * prior_spread(prior)));
    table_->rollout_f64(*config_->model, rollout);
    std::fill(row, row + lanes, own);
    // the share of a unit force in what it does, and what is left
    double force[4] = {}, rest[4] = {}, all[4] = {}, square = 0.0;
    for (std::uint32_t r = 0; r < nx_; ++r) square += unit[r * lanes] * unit[r * lanes];
    for (std::uint32_t l = 0; l < 4; ++l) {
      for (std::uint32_t r = 0; r < nx_; ++r)
        force[l] += (after[r * lanes + l] - before[r * lanes + l]) * unit[r * lanes];
      force[l] /= square;
      for (std::uint32_t r = 0; r < nx_; ++r) {
        const double change = after[r * lanes + l] - before[r * lanes + l];
        rest[l] = std::fmax(rest[l], std::fabs(change - force[l] * unit[r * lanes]));
        all[l] = std::fmax(all[l], std::fabs(change));
      }
    }
    const double on = force[kOn], growth = force[kTwice] / on;
    const bool turns_round = rest[kOn] < kAlike * all[kOn] && rest[kBack] < kAlike * all[kBack] &&
                             std::fabs(force[kBack] + on) < kAlike * std::fabs(on);
    if (!turns_round) continue;
    if (std::fabs(growth - 2.0) < kAlike && std::fabs(force[kRest]) < kAlike * std::fabs(on))
      sd_[first + kViscous] = 0.0;
    if (std::fabs(growth - 1.0) < kAlike) sd_[first + kDry] = 0.0;
  }
}

bool DisturbanceStates::sticks(const Lanes16& job, std::uint32_t lane) {
  if (!turns()) return false;
  bool any = false;
  seen_ = std::fmin(kSpeedTicks, seen_ + 1.0);
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const std::uint32_t rate = config_->model->joints[j].velocity, dry = nx_ + source_[j].first + kDry;
    const double v = job.state.data[rate * job.state.stride + lane];
    const double g = job.unit[(std::size_t{j} * nx_ + rate) * job.lanes + lane];
    const double push = g * job.state.data[dry * job.state.stride + lane];
    speed_square_[j] += (v * v - speed_square_[j]) / seen_;
    const double next = job.next[rate * job.lanes + lane];
    const double free = next + std::copysign(push, v);  // the velocity at the step's end without the dry force
    const bool reverses = v * next < 0.0;
    const bool held = v * v < kSlow * kSlow * speed_square_[j] && std::fabs(free) < std::fabs(push);
    any = any || reverses || held;
  }
  return any;
}

}  // namespace tiller
