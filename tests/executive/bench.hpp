#pragma once

#include <cstdint>
#include <vector>

#include "executive/executive.hpp"
#include "fakes.hpp"
#include "tiller/config.hpp"

namespace bench {

/// A pendulum whose parameters are known: mass and length one half, damping one half.
inline tiller::Config known_pendulum() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("pendulum"));
  for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.5, 0.0, 0.5, 0.5};
  c.safety.input_low[0] = -10.0;
  c.safety.input_high[0] = 10.0;
  c.hold_gain[0] = 2.0;
  c.safety.frozen_ticks = 0;
  c.planner.horizon = 8;
  c.planner.particles = 3;
  c.record_ticks = 16;
  return c;
}

/// A base whose parameters are known, a tenth each, and which may slip. It is seen to a millimetre, or a milliradian.
inline tiller::Config slipping_base() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("skid_steer"));
  for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.1, 0.0, 0.1, 0.1};
  c.measurement_count = c.model->state_count;
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = 0.001;
    c.process_sd[i] = 0.01;
  }
  for (int i = 0; i < 2; ++i) {
    c.safety.input_low[i] = -10.0;
    c.safety.input_high[i] = 10.0;
  }
  c.safety.frozen_ticks = 0;
  c.period_s = 0.05;
  c.planner.horizon = 8;
  c.planner.particles = 3;
  c.posterior.disturbance = 1;
  return c;
}

/// Storage of an arena, aligned.
class Storage {
 public:
  explicit Storage(std::size_t size) : bytes_(size + tiller::Arena::kAlignment), size_(size) {}
  tiller::Arena arena() {
    const auto at = reinterpret_cast<std::uintptr_t>(bytes_.data());
    const std::size_t skip = (tiller::Arena::kAlignment - at % tiller::Arena::kAlignment) % tiller::Arena::kAlignment;
    return tiller::Arena(bytes_.data() + skip, size_);
  }

 private:
  std::vector<unsigned char> bytes_;
  std::size_t size_;
};

/// The executive by itself, ticked in lockstep with whatever readings the test makes up.
class Bench {
 public:
  explicit Bench(const tiller_config_t& config = known_pendulum(), const tiller_hooks_t* hooks = nullptr)
      : storage_(measure(config)) {
    tiller::Arena arena = storage_.arena();
    executive = tiller::Executive::lay_out(arena, config, hooks);
    period_us = static_cast<std::int64_t>(config.period_s * 1e6 + 0.5);
  }

  tiller_measurement_t reading(double angle_rad) const {
    tiller_measurement_t m = {};
    m.stamp_us = now_us;
    m.value[0] = angle_rad;
    return m;
  }
  tiller_status_t tick(const tiller_measurement_t* m) {
    const tiller_status_t status = executive->tick(now_us, m, command);
    now_us += period_us;
    return status;
  }
  tiller_status_t tick(double angle_rad = 0.1) {
    const tiller_measurement_t m = reading(angle_rad);
    return tick(&m);
  }
  /// ACTIVE, with the first plan answered.
  void activate() {
    (void)executive->arm();
    (void)tick();
  }
  tiller_state_t state() const { return static_cast<tiller_state_t>(command.state); }

  tiller::Executive* executive = nullptr;
  tiller_command_t command = {};
  std::int64_t now_us = 1000000;
  std::int64_t period_us = 0;

 private:
  static std::size_t measure(const tiller_config_t& config) {
    fakes::reset();
    tiller::Arena arena;
    (void)tiller::Executive::lay_out(arena, config, nullptr);
    return arena.used();
  }
  Storage storage_;
};

}  // namespace bench
