#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "tiller/config.hpp"

namespace rig {

/// A plant with equations of its own: nothing here comes from the runtime's models. Stepped by RK4 at 1 ms, two orders
/// below the fastest motion, so that its own error is no part of any result.
class Plant {
 public:
  virtual ~Plant() = default;
  virtual void step(const double* command, double time_s) = 0;
  virtual void measure(double* value) const = 0;
};

/// Bob on a massless rod; angle 0 hangs.
class PendulumPlant : public Plant {
 public:
  double mass_kg = 1.2, length_m = 0.5, damping_Nms = 0.08;
  double angle_rad = 0.0, rate_rad_s = 0.0;
  void step(const double* command, double time_s) override;
  void measure(double* value) const override { value[0] = angle_rad; }
};

/// Uniform rod on a cart; angle 0 stands. Mass matrix solved at every evaluation.
class CartPolePlant : public Plant {
 public:
  double cart_kg = 1.0, pole_kg = 0.12, half_length_m = 0.45;
  double x[4] = {0.0, 3.141592653589793, 0.0, 0.0};  // position, angle, velocity, rate
  void step(const double* command, double time_s) override;
  void measure(double* value) const override {
    value[0] = x[0];
    value[1] = x[1];
  }

 private:
  void derivative(const double* state, double force_N, double* dxdt) const;
};

/// Swing-up of the pendulum with half the torque it would take at once; mass and damping unknown. Sizes are small:
/// the tests are about what happens, not about how well it steers. Its policy knows the neighbourhood of upright alone;
/// everywhere else its fallback plans.
tiller::Config pendulum_config();
/// Swing-up of the cart-pole, pole mass and half length unknown.
tiller::Config cart_pole_config();

/// A block of exactly `size` bytes at the right alignment, with canaries on both sides.
class Block {
 public:
  explicit Block(std::size_t size);
  void* memory() { return memory_; }
  std::size_t size() const { return size_; }
  bool canaries_alive() const;

 private:
  std::unique_ptr<unsigned char[]> storage_;
  unsigned char* memory_;
  std::size_t size_;
};

/// A controller on a plant in lockstep: now is the stamp, the command holds until the next tick.
class Loop {
 public:
  Loop(const tiller_config_t& config, Plant& plant, const tiller_hooks_t* hooks = nullptr);
  bool ready() const { return status_ == tiller_status_ok; }
  tiller_t* controller() { return t_; }
  const tiller_config_t& config() const { return config_; }
  Block& block() { return block_; }

  /// What the sensors say now.
  tiller_measurement_t measure();
  /// One period with these sensors; null: nothing new.
  tiller_status_t tick(const tiller_measurement_t* m);
  /// One period with true sensors.
  tiller_status_t tick() {
    const tiller_measurement_t m = measure();
    return tick(&m);
  }
  void run(int ticks) {
    for (int i = 0; i < ticks; ++i) (void)tick();
  }
  /// Time passes and the last command stays in force.
  void wait(std::int64_t time_us);
  /// Time passes for the controller alone: the test steps the plant itself.
  void pass(std::int64_t time_us) { now_us_ += time_us; }
  /// Brings the controller to ACTIVE with `ticks` good ticks.
  void activate(int ticks = 5);

  tiller_info_t info() const;
  tiller_state_t state() const { return static_cast<tiller_state_t>(command_.state); }
  const tiller_command_t& command() const { return command_; }
  std::int64_t now_us() const { return now_us_; }
  std::int64_t period_us() const { return period_us_; }
  /// Every command of this loop was finite and within its limits, and within its rate limit while in motion.
  bool commands_allowed() const { return allowed_; }

 private:
  void judge(const tiller_command_t& before);

  tiller::Config config_;
  Plant& plant_;
  Block block_;
  tiller_t* t_ = nullptr;
  tiller_status_t status_;
  tiller_command_t command_ = {};
  std::int64_t now_us_ = 1000000;
  std::int64_t period_us_;
  std::uint32_t sequence_ = 0;
  bool allowed_ = true;
};

}  // namespace rig
