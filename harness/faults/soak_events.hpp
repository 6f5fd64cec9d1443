#pragma once

#include <cstdint>

#include "harness/faults/fault_world.hpp"
#include "harness/faults/soak.hpp"

namespace tiller::faults {

/// A bob on a massless rod, angle 0 hangs.
struct Bob {
  double mass_kg = 0.45, length_m = 0.5, damping_Nms = 0.05, push_Nm = 0.0;
  double x[2] = {3.14159265358979323846, 0.0};

  void derivative(const double* s, double torque_Nm, double* dxdt) const {
    dxdt[0] = s[1];
    dxdt[1] =
        (torque_Nm + push_Nm - damping_Nms * s[1]) / (mass_kg * length_m * length_m) - 9.81 / length_m * std::sin(s[0]);
  }
  void step(double torque_Nm, double h) {
    double k[4][2], at[2];
    derivative(x, torque_Nm, k[0]);
    for (int i = 1; i < 4; ++i) {
      const double reach = i == 3 ? h : 0.5 * h;
      at[0] = x[0] + reach * k[i - 1][0];
      at[1] = x[1] + reach * k[i - 1][1];
      derivative(at, torque_Nm, k[i]);
    }
    for (int i = 0; i < 2; ++i) x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
  }
};

/// The stamp and the value of a reading on its way, whether there is one, and the tick's clock.
struct Reading {
  std::int64_t now_us = 0, stamp_us = 0;
  double angle_rad = 0.0;
  bool sent = true;
};

/// What happens to robot and readings of an eventful soak, one event after the other, and how the run takes it.
class SoakEvents {
 public:
  SoakEvents(tiller_t* controller, const tiller_config_t& config, Bob& bob, SoakOutcome& out)
      : controller_(controller), config_(config), bob_(bob), out_(out), random_(12) {}

  /// Before a tick.
  void disturb(Reading& reading, std::uint32_t state);
  /// After it.
  void judge(const tiller_command_t& command);

 private:
  void begin();
  void host(std::uint32_t state);
  void act(std::uint32_t age, Reading& reading);
  void aim(double angle_rad);
  void call_badly();

  tiller_t* controller_;
  const tiller_config_t& config_;
  Bob& bob_;
  SoakOutcome& out_;
  Random random_;
  SoakEvent event_ = SoakEvent::count;
  std::uint32_t wait_ = 1000, age_ = UINT32_MAX, still_ = 0;  // the first event after ten seconds
  std::int64_t clock_us_ = 0;
  std::uint64_t begun_ = 0;
  bool calm_ = false;
};

}  // namespace tiller::faults
