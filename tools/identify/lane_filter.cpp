#include "tools/identify/lane_filter.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "posterior/attitude_measurement.hpp"
#include "rollout/attitude.hpp"
#include "rollout/measurement.hpp"

namespace tiller::tools {
namespace {

constexpr double kGate = 8.0;  // as the posterior's
constexpr std::uint32_t kGateRun = 5;

}  // namespace

LaneFilter::LaneFilter(const tiller_config_t& config, std::uint32_t lanes)
    : config_(config),
      model_(*config.model),
      table_(select_rollout(model_)),
      filter_(filter_table()),
      lanes_(lanes),
      nx_(model_.state_count),
      nu_(model_.input_count),
      ny_(config.measurement_count) {
  if (make_step_setup(config, setup_) != tiller_status_ok) std::abort();  // the configuration was checked
  ns_ = setup_.effect_state_count;
  const std::size_t n = lanes;
  params_.assign(std::max(1u, config.param_count) * n, 0.0);
  process_share_.assign(n, 1.0);
  state_.resize(nx_ * n);
  covariance_.resize(triangle_rows(nx_) * n);
  effect_state_.resize((ns_ + 1) * n);
  next_state_.resize(nx_ * n);
  next_effect_state_.resize((ns_ + 1) * n);
  jacobian_.resize(std::size_t{nx_} * nx_ * n);
  history_.resize(std::size_t{setup_.delay_steps + 1} * nu_);
  squared_error_.resize(n);
  log_variance_.resize(n);
  for (std::uint32_t k = 0; k < ny_; ++k)
    measurement_variance_[k] = config.measurement_sd[k] * config.measurement_sd[k];
  for (std::uint32_t k = 0; k < ny_; ++k) rate_state_[k] = velocity_of(model_, config.measured_state[k]);
}

void LaneFilter::map_sensors(const double* before, double period_s) {
  if (!has_sensor_effects(config_)) return;
  gain_.resize(std::size_t{ny_} * lanes_);
  offset_.resize(gain_.size());
  rate_gain_.resize(gain_.size());
  for (std::uint32_t k = 0; k < ny_; ++k)
    for (std::uint32_t l = 0; l < lanes_; ++l) {
      const std::uint32_t i = config_.measured_state[k];
      const SensorSight<double> at =
          sight_of(model_, i, &state_[l], lanes_, before ? before + l : nullptr, lanes_, period_s);
      const MeasurementMap map = measurement_map(config_, i, at, params_.data() + l, lanes_);
      gain_[k * lanes_ + l] = map.gain;
      offset_[k * lanes_ + l] = map.offset;
      rate_gain_[k * lanes_ + l] = map.rate_gain;
    }
}

void LaneFilter::begin(const double* measured) {
  std::fill(covariance_.begin(), covariance_.end(), 0.0);
  std::fill(effect_state_.begin(), effect_state_.end(), 0.0);
  for (std::uint32_t i = 0; i < nx_; ++i)
    for (std::uint32_t l = 0; l < lanes_; ++l) {
      state_[i * lanes_ + l] = config_.initial_state[i];
      covariance_[triangle_row(nx_, i, i) * lanes_ + l] =
          (model_.quaternion_mask >> i) & 1u ? 0.0 : config_.initial_state_sd[i] * config_.initial_state_sd[i];
    }
  for (std::size_t j = 0; j < history_.size(); ++j) history_[j] = config_.safety.safe_command[j % nu_];
  std::fill(std::begin(gated_in_a_row_), std::end(gated_in_a_row_), 0u);
  double first[TILLER_MAX_MEASUREMENTS];
  std::copy_n(measured, ny_, first);
  take_attitudes(config_, first);
  map_sensors(nullptr, 0.0);
  correct(first);
  // the first measurement tells of the start, of no parameter
  std::fill(squared_error_.begin(), squared_error_.end(), 0.0);
  std::fill(log_variance_.begin(), log_variance_.end(), 0.0);
  values_ = 0;
}

void LaneFilter::step(const Transition& transition, double noise_scale) {
  predict(transition);
  map_sensors(next_state_.data(), transition.period_s);
  double measured[TILLER_MAX_MEASUREMENTS];
  std::copy_n(transition.measured, ny_, measured);
  take_attitudes(config_, measured);
  gate(measured, noise_scale);
  correct(measured);
  std::rotate(history_.begin(), history_.end() - nu_, history_.end());
  std::copy_n(transition.input, nu_, history_.begin());
}

void LaneFilter::predict(const Transition& transition) {
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = lanes_;
  job.period_s = transition.period_s;
  job.state = {state_.data(), lanes_};
  job.params = {params_.data(), lanes_};
  job.effect_state = {effect_state_.data(), lanes_};
  job.control = {transition.input, 0};
  job.history = history_.data();
  job.next_state = next_state_.data();
  job.next_effect_state = next_effect_state_.data();
  job.a = jacobian_.data();
  table_.linearise(model_, job);
  const std::uint32_t turns = model_.quaternion_mask;
  for (std::uint32_t l = 0; turns != 0 && l < lanes_; ++l) {
    to_tangent_columns(turns, &state_[l], lanes_, nx_, nx_, &jacobian_[l], lanes_);
    to_tangent_rows(turns, &next_state_[l], lanes_, nx_, &jacobian_[l], lanes_);
  }
  state_.swap(next_state_);
  effect_state_.swap(next_effect_state_);

  double process[triangle_rows(TILLER_MAX_STATES)] = {};
  for (std::uint32_t i = 0; i < nx_; ++i)
    process[triangle_row(nx_, i, i)] =
        (turns >> i) & 1u ? 0.0 : config_.process_sd[i] * config_.process_sd[i] * transition.period_s;
  PredictJob spread;
  spread.nx = nx_;
  spread.lanes = lanes_;
  spread.a = jacobian_.data();
  spread.a_stride = lanes_;
  spread.covariance = spread.predicted = covariance_.data();
  spread.covariance_stride = spread.predicted_stride = lanes_;
  spread.process = process;
  spread.process_scale = process_share_.data();
  filter_.predict(spread);
}

void LaneFilter::correct(const double* measured) {
  CorrectJob job;
  job.nx = nx_;
  job.ns = ns_;
  job.ny = ny_;
  job.lanes = lanes_;
  job.angle_mask = model_.angle_mask;
  job.quaternion_mask = model_.quaternion_mask;
  job.measured_state = config_.measured_state;
  job.measured = measured;
  job.variance = measurement_variance_;
  job.gain = gain_.empty() ? nullptr : gain_.data();
  job.offset = offset_.empty() ? nullptr : offset_.data();
  if (has_late_readings(config_)) job.rate_gain = rate_gain_.data();
  job.rate_state = rate_state_;
  job.from = job.to = {state_.data(), covariance_.data(), effect_state_.data(), lanes_};
  job.squared_error = squared_error_.data();
  job.log_variance = log_variance_.data();
  filter_.correct(job);
  for (std::uint32_t k = 0; k < ny_; ++k) values_ += std::isnan(measured[k]) ? 0u : 1u;
}

void LaneFilter::gate(double* measured, double noise_scale) {
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (std::isnan(measured[k])) continue;
    if (gated_in_a_row_[k] >= kGateRun || is_explained(k, measured, noise_scale)) {
      gated_in_a_row_[k] = 0;
      continue;
    }
    measured[k] = NAN;
    ++gated_in_a_row_[k];
  }
  drop_parts(config_, measured);
}

bool LaneFilter::is_explained(std::uint32_t channel, const double* measured, double noise_scale) const {
  const std::uint32_t state = config_.measured_state[channel];
  const double scale = std::fmax(1.0, noise_scale * noise_scale);
  for (std::uint32_t l = 0; l < lanes_; ++l) {
    const std::size_t at = channel * lanes_ + l;
    const MeasurementMap map =
        gain_.empty() ? MeasurementMap{} : MeasurementMap{gain_[at], offset_[at], rate_gain_[at]};
    const double error = innovation_of(config_, measured, channel, state_.data() + l, lanes_, map);
    const double sum = reading_variance(model_, map, state,
                                        [&](std::uint32_t i, std::uint32_t j) {
                                          return covariance_[triangle_row(nx_, i, j) * lanes_ + l];
                                        }) +
                       measurement_variance_[channel];
    if (error * error <= kGate * kGate * scale * sum) return true;
  }
  return false;
}

void LaneFilter::root(std::uint32_t lane, double* root) const {
  std::fill_n(root, nx_ * nx_, 0.0);
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = covariance_[triangle_row(nx_, c, r) * lanes_ + lane];
      for (std::uint32_t k = 0; k < c; ++k) sum -= root[r * nx_ + k] * root[c * nx_ + k];
      if (r == c)
        root[r * nx_ + r] = std::sqrt(std::fmax(sum, 0.0));  // a state that is known has none
      else
        root[r * nx_ + c] = root[c * nx_ + c] > 0.0 ? sum / root[c * nx_ + c] : 0.0;
    }
}

}  // namespace tiller::tools
