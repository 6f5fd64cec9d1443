#pragma once

#include <string>

namespace tiller::tools::test {

/// A right and complete robot file; tests break one thing at a time in it.
inline const char* const kGoodRobot = R"([robot]
name = "bench"
seed = 7
[model]
name = "cart_pole"
period_s = 0.02
substeps = 2
integrator = "midpoint"
[parameters]
cart_mass_kg = 1.0
pole_mass_kg = { uniform = [0.05, 0.15] }
half_length_m = { normal = [0.5, 0.1], low = 0.2 }
[[effects]]
kind = "viscous_friction"
port = "cart"
damping_SI = { log_normal = [0.2, 0.5], high = 2 }
[[effects]]
kind = "actuator_lag"
port = "force_N"
time_constant_s = 0.01
[measurement]
position_m = { sd = 0.001, low = -2, high = 2, rate_per_s = 20 }
angle_rad = { sd = 0.002 }
[noise]
process_sd = { velocity_m_s = 0.01, rate_rad_s = 0.02 }
[start]
state = { angle_rad = 3.14 }
sd = { position_m = 0.01, angle_rad = 0.01, velocity_m_s = 0.01, rate_rad_s = 0.01 }
[posterior]
particles = 128
window = 32
moves_per_tick = 16
[planner]
kind = "cem"
horizon = 40
knots = 8
rollouts = 64
particles = 4
iterations = 2
risk = "cvar"
cvar_alpha = 0.5
noise_sd = { force_N = 8 }
[probe]
budget = 0.2
until_sd = { pole_mass_kg = 0.01 }
box = { rate_rad_s = [-5, 5], force_N = [-5, 5] }
[cost]
target = { angle_rad = 0 }
state_weight = { angle_rad = 4.0 }
terminal_weight = { angle_rad = 100.0 }
input_weight = { force_N = 0.001 }
[limits]
force_N = { low = -20, high = 18, rate_per_s = 400, safe = 1 }
[safety]
sensor_timeout_s = 0.1
frozen_ticks = 20
hold_gain = { force_N = { velocity_m_s = 4 } }
[recorder]
ticks = 100
[transport]
kind = "socketcan"
interface = "can7"
nodes = { force_N = 3 }
wheel_radius_m = { force_N = 0.05 }
channels = { position_m = "position:force_N", angle_rad = "board:0" }
[realtime]
pace = "clock"
priority = 55
cpus = [1, 3]
[sim]
plant = "cart_pole"
parameters = { cart_mass_kg = 1.0 }
sensors.position_m = { sd = 0.0005, step = 0.0002 }
watchdog_s = 0.2
plan_timeout_s = 0.5
[[sim.effects]]
kind = "viscous_friction"
port = "cart"
coefficient = 0.1
[log]
units = { angle_rad = "deg" }
)";

/// The text with the first `from` replaced by `to`; empty if it is not there, which no test survives.
inline std::string with(const std::string& from, const std::string& to) {
  std::string text = kGoodRobot;
  const std::size_t at = text.find(from);
  if (at == std::string::npos) return "";
  return text.replace(at, from.size(), to);
}

/// 1-based line on which `part` begins.
inline int line_of(const std::string& text, const std::string& part) {
  const std::size_t at = text.find(part);
  int line = 1;
  for (std::size_t i = 0; i < at && i < text.size(); ++i) line += text[i] == '\n' ? 1 : 0;
  return line;
}

}  // namespace tiller::tools::test
