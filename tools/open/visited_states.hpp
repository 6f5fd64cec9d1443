#pragma once

#include <cstdint>
#include <vector>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Where a robot goes at its task: one point a control period, rows in the order of time.
struct VisitedStates {
  std::uint32_t count = 0;
  std::vector<double> state;         // (count x nx)
  std::vector<double> input;         // (count x nu) in force from there
  std::vector<double> effect_state;  // (count x ns)
  std::vector<double> history;       // (count x rows x nu) commands before it, newest first
  std::uint32_t effect_states = 0;   // ns, at least one
  std::uint32_t history_numbers = 0;
};

/// A short closed loop on the configuration's own model at the priors' centre, from the start state toward the task:
/// between 50 and 200 periods, and two horizons or the reference's length where these lie between. The controller is an
/// iLQR of one hypothesis, cheap whatever planner is configured, and stays within the limits of [limits]; where the
/// task has no such plan, the configured planner steers with few samples. The path ends early where the controller
/// would latch SAFE, so every point lies within the sensors' limits. At least one point: the start. Deterministic.
VisitedStates visit_states(const tiller_config_t& config);

}  // namespace tiller::tools
