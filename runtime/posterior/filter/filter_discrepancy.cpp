#include "posterior/filter/filter_discrepancy.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

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
/// Sizes of the forces, as logarithms over one that matters: from nothing that a sensor shows to two fifths of what half
/// of the inputs' range can hold (one deviation). The lower half is a world without: its likelihood is flat there.
constexpr double kSmallest = -6.0, kLargest = 0.7;
/// Times that a wandering force lasts, in s, as logarithms: from a gust to what is as good as constant.
constexpr double kShortest = -2.3, kLongest = 4.1;
/// Of a force that is looked out for: its deviation over the limit beyond which it is a contact, and how long it lasts.
/// It then walks by a tenth of the limit in a period of 20 ms.
constexpr double kContact = 0.7, kContact_s = 2.0;
/// A viscous or dry force's random walk per square root of a second, in its own deviations: friction is no constant,
/// and a filter that takes it for one never gets over what it once believed.
constexpr double kDrift = 0.01;

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
Wandering wandering(double a) {
  const double kept = math::exp(-a);
  // the mean's terms cancel to third order: below, their series
  const double mean = a > 0.01 ? (2.0 * a - 3.0 + kept * (4.0 - kept)) / (a * a) : a * (2.0 / 3.0 - 0.5 * a);
  return {1.0 - kept * kept, mean, a > 1e-8 ? (1.0 - kept) * (1.0 - kept) / a : a};
}

}  // namespace

FilterDiscrepancy::FilterDiscrepancy(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table)
    : config_(&config), table_(&table), setup_(setup), nx_(config.model->state_count) {
  if (!config.posterior.disturbance) return;
  // of a configuration with as many effects as there can be, the responses are those without the last one
  slot_ = std::min<std::uint32_t>(setup.effect_count, TILLER_MAX_EFFECTS - 1);
  setup_.effect_count = slot_ + 1;
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
    if (config.model->joints[j].position != TILLER_NO_POSITION) is_position_[config.model->joints[j].position] = true;
  joints_ = joints_of(config);
}

std::uint32_t FilterDiscrepancy::joints_of(const tiller_config_t& config) {
  if (!config.posterior.disturbance) return 0;
  const std::uint32_t room = (kMaxFilterStates - config.model->state_count) / kDiscrepancyBasis;
  return std::min({config.model->joint_count, kDiscrepancyJoints, room});
}

void FilterDiscrepancy::clear() {
  for (double& square : speed_square_) square = 0.0;
  seen_ = 0.0;
}

double FilterDiscrepancy::rate_of(const Lanes16& job, std::uint32_t lane) const {
  return job.law.data[joints_ * job.law.stride + lane];
}

RolloutJob<double> FilterDiscrepancy::rollout_of(const Lanes16& job) const {
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

void FilterDiscrepancy::step(const Lanes16& job) const {
  const std::uint32_t lanes = job.lanes, np = config_->param_count;
  StepSetup with = setup_;
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
  // the forces push only once all responses are taken about the free step
  for (std::uint32_t j = 0; j < joints_; ++j)
    for (std::uint32_t l = 0; l < lanes; ++l) push_lane(job, j, l);
}

void FilterDiscrepancy::push_lane(const Lanes16& job, std::uint32_t j, std::uint32_t l) const {
  const tiller_joint_t& joint = config_->model->joints[j];
  const std::uint32_t lanes = job.lanes, all = forces(), first = nx_ + j * kDiscrepancyBasis;
  const double* unit = job.unit + std::size_t{j} * nx_ * lanes;
  double beta[kDiscrepancyBasis];
  for (std::uint32_t k = 0; k < kDiscrepancyBasis; ++k) {
    beta[k] = job.state.data[(first + k) * job.state.stride + l];
    job.next[(first + k) * lanes + l] = beta[k] * (k == 0 ? kept(rate_of(job, l), job.period_s) : 1.0);
  }
  const double mean = mean_kept(rate_of(job, l) * job.period_s);
  const double v = job.state.data[joint.velocity * job.state.stride + l], g = unit[joint.velocity * lanes + l];
  const double unforced = job.next[joint.velocity * lanes + l] - v, middle = v + 0.5 * unforced;
  const double free = unforced + g * (mean * beta[0] - beta[1] * middle);
  const DryShare dry = dry_share(v, free, std::fabs(g) * beta[2]);
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double share[kDiscrepancyBasis] = {mean, -middle, -(is_position_[r] ? dry.position : dry.velocity)};
    for (std::uint32_t k = 0; k < kDiscrepancyBasis; ++k) {
      const double push = unit[r * lanes + l] * share[k];
      job.next[r * lanes + l] += push * beta[k];
      job.push[(r * all + j * kDiscrepancyBasis + k) * lanes + l] = push;
    }
  }
}

double FilterDiscrepancy::kept(double rate, double period_s) { return math::exp(-rate * period_s); }

double FilterDiscrepancy::mean_kept(double periods) {
  return periods > 1e-8 ? (1.0 - math::exp(-periods)) / periods : 1.0;
}

tiller_prior_t FilterDiscrepancy::law_prior(std::uint32_t row) const {
  if (row == joints_) return {tiller_prior_uniform, 0, kShortest, 0.0, kShortest, kLongest};
  return {tiller_prior_uniform, 0, kSmallest, 0.0, kSmallest, kLargest};
}

void FilterDiscrepancy::read_law(const double* coordinate, std::uint32_t stride, double* law,
                                 std::uint32_t law_stride) const {
  for (std::uint32_t j = 0; j < joints_; ++j)
    law[j * law_stride] = math::exp(2.0 * coordinate[std::size_t{j} * stride]);
  law[joints_ * law_stride] = math::exp(-coordinate[std::size_t{joints_} * stride]);
}

void FilterDiscrepancy::fixed_law(double* law, std::uint32_t stride) const {
  for (std::uint32_t row = 0; row <= joints_; ++row) law[row * stride] = 1.0;
}

void FilterDiscrepancy::contact_law(double* law, std::uint32_t stride) const {
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const double limit = config_->safety.contact_force[config_->model->joints[j].velocity];
    const double size = kContact * limit / sd_[j * kDiscrepancyBasis];
    law[j * stride] = std::isfinite(size) ? size * size : 0.0;
  }
  law[joints_ * stride] = 1.0 / kContact_s;
}

void FilterDiscrepancy::prior_variance(const double* law, std::uint32_t stride, double* variance) const {
  for (std::uint32_t f = 0; f < forces(); ++f) variance[f] = law[f / kDiscrepancyBasis * stride] * sd_[f] * sd_[f];
}

void FilterDiscrepancy::add_process(const Lanes16& job, double* covariance) const {
  const std::uint32_t lanes = job.lanes, n = nx_ + forces();
  const auto at = [&](std::uint32_t r, std::uint32_t c) { return covariance + triangle_row(n, r, c) * lanes; };
  for (std::uint32_t l = 0; l < lanes; ++l) {
    const Wandering w = wandering(rate_of(job, l) * job.period_s);
    for (std::uint32_t j = 0; j < joints_; ++j) {
      const double* unit = job.unit + std::size_t{j} * nx_ * lanes + l;
      const std::uint32_t first = j * kDiscrepancyBasis;
      const double size = job.law.data[j * job.law.stride + l];
      const double variance = size * sd_[first] * sd_[first];
      at(nx_ + first, nx_ + first)[l] += variance * w.end;
      for (std::uint32_t r = 0; r < nx_; ++r) {
        at(r, nx_ + first)[l] += variance * w.both * unit[r * lanes];
        for (std::uint32_t c = r; c < nx_; ++c) at(r, c)[l] += variance * w.mean * unit[r * lanes] * unit[c * lanes];
      }
      for (std::uint32_t k = 1; k < kDiscrepancyBasis; ++k)
        at(nx_ + first + k, nx_ + first + k)[l] +=
            kDrift * kDrift * size * sd_[first + k] * sd_[first + k] * job.period_s;
    }
  }
}

void FilterDiscrepancy::measure_reach(const Lanes16& job) {
  // what half of each input's range does to the velocities over a period
  double reach[kDiscrepancyJoints] = {}, input[TILLER_MAX_INPUTS];
  RolloutJob<double> rollout = rollout_of(job);
  double *idle = job.push, *driven = job.push + std::size_t{nx_} * job.lanes;
  for (std::uint32_t l = 0; l < job.lanes; ++l) job.params[config_->param_count * job.lanes + l] = 0.0;
  rollout.final_state = idle;
  table_->rollout_f64(*config_->model, rollout);
  for (std::uint32_t i = 0; i < config_->model->input_count; ++i) {
    std::copy(job.input, job.input + config_->model->input_count, input);
    input[i] += 0.5 * (config_->safety.input_high[i] - config_->safety.input_low[i]);
    rollout.controls = {input, 0};
    rollout.final_state = driven;
    table_->rollout_f64(*config_->model, rollout);
    for (std::uint32_t j = 0; j < joints_; ++j) {
      const std::uint32_t rate = config_->model->joints[j].velocity;
      const double change = driven[rate * job.lanes] - idle[rate * job.lanes];
      reach[j] = std::hypot(reach[j], std::isfinite(change) ? change : 0.0);
    }
  }
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const std::uint32_t rate = config_->model->joints[j].velocity;
    const double push = std::fabs(job.unit[(std::size_t{j} * nx_ + rate) * job.lanes]);
    const double one = push > 0.0 && std::isfinite(push) ? kSpread * reach[j] / push : 0.0;
    const double speed = reach[j] * kReach_s / job.period_s;
    sd_[j * kDiscrepancyBasis] = sd_[j * kDiscrepancyBasis + 2] = one;
    sd_[j * kDiscrepancyBasis + 1] = speed > 0.0 ? one / speed : 0.0;
  }
}

bool FilterDiscrepancy::sticks(const Lanes16& job, std::uint32_t lane) {
  bool any = false;
  seen_ = std::fmin(kSpeedTicks, seen_ + 1.0);
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const std::uint32_t rate = config_->model->joints[j].velocity, dry = nx_ + j * kDiscrepancyBasis + 2;
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
