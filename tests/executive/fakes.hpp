#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "planners/planner.hpp"
#include "posterior/posterior.hpp"

namespace fakes {

/// Answers of the fake planner, and the requests that it got.
struct Planner {
  double command[TILLER_MAX_INPUTS] = {};
  tiller::PlanResult result = {tiller_status_ok, 1, 0.0};
  std::function<void()> before_answer;  // may change the two above
  int plans = 0, resets = 0, preparations = 0;
  std::uint64_t tick = 0, task_step = 0;                    // of the last plan
  std::uint64_t expected_tick = 0, expected_task_step = 0;  // of the last preparation
  std::uint32_t iterations_asked = 0;
  std::int64_t deadline_ns = 0;
  double last_command[TILLER_MAX_INPUTS] = {};
  bool steady = false;  // the request had a steady target:
  double steady_state[TILLER_MAX_STATES] = {}, steady_input[TILLER_MAX_INPUTS] = {};
  std::vector<float> belief_state;  // (nx x M)
  std::vector<float> sequence;      // (horizon x nu)
};
extern Planner planner;

/// Answers of the fake posterior, and the data that it got. Its state mean is the last measurement and zero
/// velocities, its parameters are one half.
struct Posterior {
  tiller_status_t start_status = tiller_status_ok, update_status = tiller_status_ok;
  tiller_status_t skip_status = tiller_status_ok;
  int starts = 0;
  std::vector<tiller::Transition> transitions, skipped;
  double state[TILLER_MAX_STATES] = {};
  double state_sd = 0.0, param_sd = 0.0;
  double param[TILLER_MAX_PARAMS] = {};
  bool tested = false;      // the adequacy test below is shown; it is fed a constant of four deviations
  float param_step = 0.0f;  // particle i of a draw has param + i * param_step
  double force[TILLER_MAX_JOINTS] = {}, force_imaginary = 0.0,
         force_sd = 0.0;            // at every joint, where the configuration looks for them; of a model without, slips
  double viscous = 0.0, dry = 0.0;  // likewise
  std::vector<double> delay;        // periods, of the columns of a draw; none: 0
};
extern Posterior posterior;

/// Both as new.
void reset();

}  // namespace fakes
