#pragma once

#include <cstdint>

#include "core/input_cone.hpp"
#include "rollout/cost.hpp"
#include "scalar/isa.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Rows of lanes: row i, lane l stands at data[i * stride + l]; a splat has one value a row, data[i].
template <class T>
struct Lanes {
  const T* data = nullptr;
  std::uint32_t stride = 0;  // 0: splat
  bool splat() const { return stride == 0; }
};

/// An effect bound to its port, its parameters and its states.
struct EffectSlot {
  std::uint16_t kind;   // tiller_effect_kind_t
  std::uint16_t port;   // joint or input
  std::uint16_t param;  // first row in the particle's parameters
  std::uint16_t state;  // first row in the particle's effect states
};

/// Actuator lags that a robot of so many inputs may have: one each, and a few may have two.
constexpr int most_lags(int inputs) { return inputs > 8 ? inputs : 8; }

/// How one control period is stepped: the same for planner, posterior and gap.
struct StepSetup {
  double period_s = 0.02;
  std::uint32_t substeps = 1;
  tiller_integrator_t integrator = tiller_integrator_rk4;
  tiller_body_t body = {0.0, -9.81, 0.0, 0.0};
  std::uint32_t effect_count = 0;
  std::uint32_t effect_state_count = 0;  // ns
  std::uint32_t delay_steps = 0;         // history rows that rollouts read, 0..TILLER_MAX_DELAY_STEPS + 1
  EffectSlot effects[TILLER_MAX_EFFECTS] = {};
  // Forces of a planner's own, behind the configuration's parameters (rollout/fading.hpp): rows `fading_param` on are
  // the parameters of constant_offset effects that fade and swing, their imaginary parts, and two for how fast.
  std::uint32_t fading = 0, fading_param = 0;
  // Of a model without joints the rows are slips instead, in the states' own units a second: the next of them is added
  // to the rate of each state whose bit is set here, at the end of a period.
  std::uint32_t slip_states = 0;
  std::uint32_t extra_params() const { return fading > 0 ? 2 * fading + 2 : 0; }
  const tiller_network_t* network = nullptr;  // of the effects that are learnt
  std::uint32_t network_angles = 0;           // bit j: the position of joint j is an angle
};

/// Inputs of a network of forces on this model: joint by joint position and velocity, of an angle sine and cosine, then
/// the model's inputs.
std::uint32_t network_input_count(const tiller_model_t& model);

/// Binds the configuration's effects; the delay bound comes from the priors' upper bounds.
/// Refuses (bad_effect) an effect whose port the model lacks, and a learnt one without a network of its kind that fits
/// the model.
tiller_status_t make_step_setup(const tiller_config_t& config, StepSetup& setup);

/// One batch: `lanes` trajectories of `horizon` periods. All rows are padded: `lanes` is a multiple of
/// kLanePadding and every lane array is readable (writable) up to that.
constexpr std::uint32_t kLanePadding = 16;

/// Feedback of closed-loop rollouts, around a reference motion of each lane's own. From step `from` on the input is
///
///     u = cut(controls_k + gain_k [x - reference_k; before - controls_(k-1)])
///
/// with `before` the input of the step before, cut to the limits, to the change per period and to the cones.
/// x - reference is the plain difference: angles start on the reference's turn. The setup has no input delay, and the
/// job has a cost.
template <class T>
struct RolloutFeedback {
  std::uint32_t from = 1;             // >= 1
  std::uint32_t columns = 0;          // of the gain: nx, or nx + nu with the rows' answer to the input before
  const T* gain = nullptr;            // (horizon x nu x columns)
  Lanes<T> reference;                 // (horizon * nx)
  const T* low = nullptr;             // (nu)
  const T* high = nullptr;            // (nu)
  const T* most_change = nullptr;     // (nu) per period; 1e15 for none
  const InputCones* cones = nullptr;  // kept after limits and changes; null: none
};

template <class T>
struct RolloutJob {
  const StepSetup* setup = nullptr;
  std::uint32_t lanes = 0;
  std::uint32_t horizon = 0;
  double period_s = 0.0;               // 0: the setup's; else a measured period
  Lanes<T> state;                      // (nx) start
  Lanes<T> params;                     // (np) model's, then effects'
  Lanes<T> effect_state;               // (ns) start
  Lanes<T> controls;                   // (horizon * nu)
  const T* history = nullptr;          // (delay_steps x nu) commands before controls[0], newest first; may be
                                       // null where delay_steps is 0 and the cost has no input-rate weight
  const T* previous_input = nullptr;   // (nu) for the input-rate cost of step 0; null: as controls[0]
  const CostTerms<T>* cost = nullptr;  // null: no cost
  Lanes<T> noise;                      // (horizon * nx) added to the state at the end of each period; null: none
  const RolloutFeedback<T>* feedback = nullptr;  // null: controls are the inputs
  std::uint64_t task_step = 0;                   // periods since the task began: the time row of step 0
  T* cost_out = nullptr;                         // (lanes)
  T* penalty_out = nullptr;                      // (lanes) of bounds and penalty terms, whatever `extra` says; nullable
  T* final_state = nullptr;                      // (nx x lanes), row stride `lanes`; nullable
  T* final_effect_state = nullptr;               // (ns x lanes); nullable
  T* trajectory = nullptr;                       // ((horizon + 1) * nx x lanes); nullable
};

/// One period, linearised by dual numbers: next = f(state, u), a = d next / d state, b = d next / d u.
struct LineariseJob {
  const StepSetup* setup = nullptr;
  std::uint32_t lanes = 0;
  double period_s = 0.0;                // 0: the setup's
  Lanes<double> state;                  // (nx)
  Lanes<double> params;                 // (np)
  Lanes<double> effect_state;           // (ns)
  Lanes<double> control;                // (nu) command in force during the period
  const double* history = nullptr;      // (delay_steps x nu) commands before it, newest first
  double* next_state = nullptr;         // (nx x lanes)
  double* next_effect_state = nullptr;  // (ns x lanes); may alias effect_state.data; nullable
  double* a = nullptr;                  // (nx * nx x lanes), row r * nx + c; nullable
  double* b = nullptr;                  // (nx * nu x lanes); nullable
};

/// The cost along one trajectory, to second order: lane l is step l of the horizon, at time row task_step + l. The
/// first `stages` lanes are steps; with `terminal` set, lane `stages` is the horizon's last state (no input) and
/// stages < lanes. What stands in the lanes behind that is not defined.
///
///   cost(x + dx, u + du, b + db) ~ value + lx' dx + lu' du + lb' db
///                                  + 1/2 dx' lxx dx + du' lux dx + 1/2 du' luu du + the rate's coupling
///
/// with b the input of the step before. The input rate's term s (u - b)^2 is in value, lu, lb = -2 s (u - b) and luu
/// (its 2 s); its other second derivatives are constant and diagonal: lbb = 2 s, lub = -2 s, s = cost->input_rate.
///
/// [lxx lux'; lux luu] is positive semidefinite. Exact: quadratic terms, demonstration, cost-to-go. Saturating:
/// w exp(-q/2) diag(1/width^2), the true one without its negative part. Bounds and the catalogue's terms: Gauss-Newton.
/// Own cost: the true one (nested duals of the template, central differences of a C function) with its negative
/// eigenvalues set to 0. lux is zero but for an own cost.
struct QuadratiseJob {
  const StepSetup* setup = nullptr;
  const CostTerms<double>* cost = nullptr;
  std::uint32_t lanes = 0;   // a multiple of kLanePadding
  std::uint32_t stages = 0;  // <= lanes
  bool terminal = false;
  std::uint64_t task_step = 0;  // time row of lane 0
  Lanes<double> state;          // (nx)
  Lanes<double> control;        // (nu); what stands in the terminal's lane has no say
  Lanes<double> before;         // (nu) control of the step before
  Lanes<double> params;         // (np) for an own cost
  double* value = nullptr;      // (lanes); every output is nullable
  double* lx = nullptr;         // (nx x lanes)
  double* lu = nullptr;         // (nu x lanes)
  double* lb = nullptr;         // (nu x lanes)
  double* lxx = nullptr;        // (nx * nx x lanes), row r * nx + c
  double* luu = nullptr;        // (nu * nu x lanes)
  double* lux = nullptr;        // (nu * nx x lanes), row r * nx + c: input r, state c
};
struct LqKernel;
struct PathKernel;
struct ResidualJob;

/// The type erasure: one table per (model, instruction set), one batch x horizon a call.
struct RolloutTable {
  Isa isa = Isa::scalar;
  std::uint32_t width_f32 = 1, width_f64 = 1;
  void (*rollout_f32)(const tiller_model_t& model, const RolloutJob<float>& job) = nullptr;
  void (*rollout_f64)(const tiller_model_t& model, const RolloutJob<double>& job) = nullptr;
  void (*linearise)(const tiller_model_t& model, const LineariseJob& job) = nullptr;
  void (*residual)(const tiller_model_t& model, const ResidualJob& job) = nullptr;  // rollout/residual.hpp
  // Riccati sweeps of the model's sizes (rollout/lq.hpp): (nx, nu), (nx + nu, nu), and (nx, nu) for scenarios; null:
  // the general one serves. Use select_lq.
  const LqKernel* lq = nullptr;
  const LqKernel* lq_rate = nullptr;
  const LqKernel* lq_scenarios = nullptr;
  void (*quadratise)(const tiller_model_t& model, const QuadratiseJob& job) = nullptr;
  bool own_cost = false;             // compiled with a cost template beside the model
  const PathKernel* path = nullptr;  // of gradient planners (rollout/path.hpp); use select_path
};

/// A model compiled from a template: its tables by instruction set; null where not built.
struct ModelKernels {
  const RolloutTable* table[kIsaCount];
};

/// The table to use for `model` on this processor: the template's best, or the lane loop over the C function.
const RolloutTable& select_rollout(const tiller_model_t& model, Isa best = best_isa());

struct StateSpread;

/// M hypotheses to plan over: what the posterior hands to a planner. Rows of M, unpadded.
struct Belief {
  std::uint32_t count = 0;              // M
  const float* params = nullptr;        // (np x M)
  const float* state = nullptr;         // (nx x M)
  const float* effect_state = nullptr;  // (ns x M)
  const float* history = nullptr;       // (delay_steps x nu) newest first, shared
  const float* weight = nullptr;        // (M) of each hypothesis, sum one; null: all alike
  // what is not known of the state beside the hypotheses (rollout/state_spread.hpp); null: nothing
  const StateSpread* spread = nullptr;
};

/// Wrapped difference a - b of state i of the model. Of a quaternion's state that is the difference of components:
/// state_differences() knows better.
double state_difference(const tiller_model_t& model, std::uint32_t i, double a, double b);
/// All of them, d (nx) = a (nx) - b (nx); of a quaternion the rotation from b to a (attitude_difference), in the last
/// three of its states. d may be a or b.
void state_differences(const tiller_model_t& model, const double* a, const double* b, double* d);
/// a (nx) = b (nx) + d (nx), the other way round.
void add_differences(const tiller_model_t& model, const double* b, const double* d, double* a);

}  // namespace tiller
