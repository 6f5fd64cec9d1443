#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "planners/cost_frame.hpp"
#include "planners/planner.hpp"
#include "planners/scenario_risk.hpp"
#include "planners/sequence.hpp"
#include "rollout/cost.hpp"
#include "rollout/lq.hpp"
#include "rollout/path.hpp"

namespace tiller {

constexpr double kHold_rad = 1.5;  // PathPlan::hold_rad of a plan in closed loop

/// State that gradient planners share: a path (states of M scenarios under one input sequence), the linear-quadratic
/// problem around it, and the ways to go from one to the other. Angles are unwrapped along the path.
///
/// States of the linear-quadratic problem: z = (x, effect states), and behind it, where the cost has an input-rate
/// weight, the input of the period before (n = nz + nu).
struct PathPlan {
  // ---- what it was made from; constant
  const tiller_planner_config_t* settings = nullptr;
  const tiller_model_t* model = nullptr;
  const StepSetup* setup = nullptr;
  const RolloutTable* table = nullptr;
  const PathKernel* path = nullptr;
  CostTerms<double> cost{};
  InputLimit limits[TILLER_MAX_INPUTS];
  InputCones cones;
  double low[TILLER_MAX_INPUTS] = {}, high[TILLER_MAX_INPUTS] = {}, most_change[TILLER_MAX_INPUTS] = {};
  double fallback[TILLER_MAX_INPUTS] = {};  // the safe command
  std::uint32_t nx = 0, ns = 0, nz = 0, nu = 0, np = 0;
  std::uint32_t n = 0;  // states of the linear-quadratic problem
  std::uint32_t horizon = 0, most_scenarios = 0;
  bool rate_limited = false;  // an input has a rate limit that its range can meet
  bool rate = false;          // the cost has an input-rate weight

  double hold_rad = kHold_rad;  // by which angles hang on to their turn of the target

  // ---- the plan, kept from tick to tick
  double* state = nullptr;    // (N+1 x M x nz)
  double* control = nullptr;  // (N x nu) within limits
  float* sequence = nullptr;  // (N x nu)
  double* settled = nullptr;  // (N x nu) what multiple shooting sends in the place of control
  std::uint64_t last_tick = 0;
  std::uint64_t task_step = 0;
  CostFrame frame;             // of the path's angles
  bool has_sequence = false;   // control is a plan
  bool has_path = false;       // state fits control and the scenarios
  bool has_gain = false;       // factor.gain was made around the path
  std::uint32_t gain_age = 0;  // and by how many periods it was shifted since

  // ---- the belief
  ScenarioRisk risk;
  std::uint32_t scenarios = 0;                // M
  double* start = nullptr;                    // (M x nz) unwrapped towards the path
  double* params = nullptr;                   // (M x np)
  const StateSpread* spread = nullptr;        // the belief's; null: none is known
  double last_input[TILLER_MAX_INPUTS] = {};  // command in force, within limits

  // ---- the linear-quadratic problem around the path
  double* next = nullptr;  // (N x M x nz) f(state, control)
  double *a = nullptr, *b = nullptr, *c = nullptr, *qxx = nullptr, *qux = nullptr, *quu = nullptr, *qx = nullptr,
         *qu = nullptr, *box_low = nullptr, *box_high = nullptr;
  LqProblem problem;
  LqFactor factor;
  const LqKernel* lq = nullptr;
  double* cone_quu = nullptr;                   // (N x nu x nu) quu with the cones' curvature; null without cones
  const double* cone_curvature = nullptr;       // what of the factor's curvature cones added; null: nothing
  bool dynamics_stand = false;                  // the constant rows of a, b, c are written
  bool hessians_stand = false;                  // those of a quadratic cost are constant: written once
  bool exact = false;                           // the last solution is the box problem's, and `held` is the factor's
  double* dx = nullptr;                         // (N+1 x M x n) solution
  double* du = nullptr;                         // (N x nu)
  double path_cost[TILLER_MAX_SCENARIOS] = {};  // of each scenario at the last quadratisation

  // quadratisation in lanes, for costs with more than quadratic terms
  std::uint32_t lanes = 0;
  double *lane_state = nullptr, *lane_control = nullptr, *lane_before = nullptr;
  double *lane_value = nullptr, *lane_lx = nullptr, *lane_lu = nullptr, *lane_lb = nullptr, *lane_lxx = nullptr,
         *lane_luu = nullptr, *lane_lux = nullptr;

  // ---- candidates of the line search
  double* candidate_state = nullptr;    // (N+1 x M x nz x kCandidates)
  double* candidate_control = nullptr;  // (N x nu x kCandidates)
  double* candidate_cost = nullptr;     // (M x kCandidates)
};

/// With room for the planner's particles, but for no more than `most_scenarios`.
void lay_out_path_plan(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                       PathPlan& p, std::uint32_t most_scenarios = TILLER_MAX_SCENARIOS);
void reset_path_plan(PathPlan& p);

/// Takes the command in force, brought into limits and cones; the safe command if it is null.
void take_command(PathPlan& p, const double* last_command);
/// Takes the present goal; true if it has changed: what was prepared for the old one is void.
bool take_goal(PathPlan& p, const PlanRequest& request);
/// Moves the cost into the belief's frame; a path of another frame is dropped, its inputs stay. True if the frame
/// moved.
bool take_origin(PathPlan& p, const double* origin);
/// The first scenarios of the belief; false if there is nothing to plan over. A path for another number of scenarios is
/// dropped.
bool take_belief(PathPlan& p, const Belief* belief);
/// Hypothesis j of a belief alone, in `room` (np + nx + ns).
Belief one_hypothesis(const PathPlan& p, const Belief& belief, std::uint32_t j, float* room);
/// The path as many periods later as ticks went by.
void shift_path(PathPlan& p, std::uint64_t tick);

/// next = f(path), and a, b of the problem.
void linearise_path(PathPlan& p);
/// Gradients and Hessians of the cost along the path, weighted by risk; path_cost.
void quadratise_path(PathPlan& p);
/// c = next - state, and the first row of dx = start - state: what multiple shooting closes.
void take_defects(PathPlan& p);
/// No defects: the path is a motion of the model from the start.
void clear_defects(PathPlan& p);
/// Bounds of du: the limits, and for the first period the rate limit. True if they are not those of the call before.
bool take_box(PathPlan& p);
/// Solves the problem, exactly where `most_sweeps` suffice; fills dx, du, factor. False where it has no solution; the
/// gains are then zero. `factorised`: the factor is that of the present matrices already.
bool solve_path(PathPlan& p, std::uint32_t most_sweeps, bool factorised);

/// Rolls the linear system on under the solution's gains with rate limits and cones in the loop: what they take from
/// one input, the gains ask of the next. For plans whose inputs have some; changes dx, du.
void limit_solution(PathPlan& p);

/// Rolls candidates (alpha, beta) out from the start: u = control + alpha step + beta gain (z - state).
void roll_candidates(PathPlan& p, const double* alpha, const double* beta);
double candidate_risk(const PathPlan& p, std::uint32_t candidate);
/// Makes a candidate the path.
void take_candidate(PathPlan& p, std::uint32_t candidate);

/// The sequence, and the command in full precision, from `inputs` (N x nu) under limits and cones.
void write_sequence(PathPlan& p, const double* inputs, double* command);

/// PlannerTable::feedback around the path: the gains act on the same deviation of all scenarios.
bool path_feedback(const PathPlan& p, std::uint32_t step, double* gain, double* state, double* input);

}  // namespace tiller
