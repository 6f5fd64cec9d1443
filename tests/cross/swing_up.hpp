#pragma once

// One closed loop for every target: a pendulum of unknown mass, damping and dry friction is swung up or held, with a
// posterior of 64 particles, in lockstep. Two builds that agree on its commands to the last bit print the same lines.
// No heap, no C library beyond <cmath>, so that it runs where there is no operating system.

#include <cstddef>
#include <cstdint>

#include "tiller/config.hpp"

namespace swing_up {

/// A bob on a massless rod with damping and dry friction, angle 0 hanging; semi-implicit Euler at 1 ms, with equations
/// of its own. Sine from the runtime's portable functions: the plant must have the same bits everywhere, too.
struct Plant {
  double mass_kg = 0.45, length_m = 0.5, damping_Nms = 0.03, friction_Nm = 0.0;
  double angle_rad = 0.0, rate_rad_s = 0.0;
  void step(double torque_Nm, double time_s);
};

/// What is steered, and by whom.
struct Task {
  const char* name;
  tiller_planner_kind_t kind;
  double start_rad;    // where the pendulum is let go
  double push_rad_s;   // given to it every kPush ticks, in turn to either side, so that the loop never only stands
  double friction_Nm;  // of the plant; 0: the model has no dry friction either
};
/// Sampling swings up from rest and after each fall; a gradient planner, which sees no reason to swing back first, is
/// let go near upright and keeps the pendulum there.
constexpr Task kSwingUp = {"mppi", tiller_planner_mppi, 0.0, 5.0, 0.02};
constexpr Task kHold = {"ilqr", tiller_planner_ilqr, 2.7, 0.5, 0.0};
/// What holds it without planning: a network that was taught by such a planner.
constexpr Task kHoldByPolicy = {"policy", tiller_planner_policy, 2.7, 0.5, 0.0};
constexpr Task kTasks[] = {kSwingUp, kHold, kHoldByPolicy};
constexpr std::uint32_t kPush = 500;

/// 64 particles; small enough for 256 KiB of RAM.
tiller::Config config(const Task& task);

/// FNV-1a over the bits of numbers.
constexpr std::uint64_t kHashStart = 14695981039346656037ull;
void hash_bits(std::uint64_t& hash, double value);

/// What a run leaves behind.
struct Result {
  tiller_status_t status = tiller_status_ok;  // of tiller_init
  std::uint64_t hash = kHashStart;            // of every command and estimate
  std::uint32_t ticks = 0;
  std::uint32_t upright_ticks = 0;  // within 0.3 rad of upright
  std::uint32_t safe_ticks = 0;     // in SAFE
  double mass_mean_kg = 0.0, mass_sd_kg = 0.0;
  std::int64_t plan_ns = 0, longest_plan_ns = 0;  // in planning, of all ticks and of one; zero without a clock
};

/// Called after every tick; nullable.
using Watch = void (*)(void* context, std::uint32_t tick);

/// Runs `ticks` periods in `memory`. `hooks`, nullable, may bring a clock; no deadline goes by it.
Result run(const Task& task, const tiller_config_t& config, void* memory, std::size_t size, std::uint32_t ticks,
           Watch watch, void* context, const tiller_hooks_t* hooks = nullptr);
/// Ready, never in SAFE, and upright for most of the time.
bool good(const Result& result);

/// "mppi ticks 1000 hash 0123456789abcdef upright 612 safe 0 mass 450.1 g": the line that targets compare. `text` holds
/// kLine characters.
constexpr std::size_t kLine = 128;
void describe(const char* name, const Result& result, char* text);

}  // namespace swing_up
