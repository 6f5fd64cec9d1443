#pragma once

#include <cstdint>

#include "posterior/discrepancy_basis.hpp"
#include "posterior/filter_lanes.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Forces that the model lacks, as further states of the filter: a constant, a viscous and a dry one at each joint,
/// which stay as they are and push the state over a period,
///
///   next = f(x, u) + sum_j g_j (beta_j0 - beta_j1 v_j - beta_j2 s(v_j)),   beta' = beta
///
/// g_j what a unit force at joint j does to the state, v_j the joint's velocity, s its sign (on average, where it
/// reverses within the period). The filter finds them beside
/// the state, and its innovations' likelihood has them integrated out (Friedland, "Treatment of bias in recursive
/// filtering", IEEE TAC 14, 1969).
///
/// Cost of a step of 16 lanes: a rollout of one step per joint, and the filter's algebra with three more states a
/// joint.
class FilterDiscrepancy {
 public:
  FilterDiscrepancy() = default;
  FilterDiscrepancy(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);

  std::uint32_t joints() const { return joints_; }
  /// Forces; 0: none are looked for.
  std::uint32_t forces() const { return joints_ * kDiscrepancyBasis; }
  void clear();

  /// The lanes of a step; rows of `lanes`.
  struct Lanes16 {
    std::uint32_t lanes = 0;
    double period_s = 0.0;
    Lanes<double> state;              // (nx + forces) before
    Lanes<double> effect_state;       // (ns)
    double* params = nullptr;         // (np + 1), stride lanes; the last row is written
    const double* input = nullptr;    // (nu)
    const double* history = nullptr;  // (delay_steps x nu)
    double* next = nullptr;           // (nx + forces), of f; is completed
    double* unit = nullptr;           // (joints x nx) out: g
    double* push = nullptr;           // (nx x forces) out: d next / d beta
  };
  void step(const Lanes16& job) const;

  /// The forces' standard deviations before any data (forces), from what they do in lane 0.
  void prior_sd(const Lanes16& job, double* sd) const;
  /// Takes note of one lane of a step. True where a joint was so slow that dry friction may have held it: its friction
  /// is then whatever force the model has there, which none of these has the form of.
  bool sticks(const Lanes16& job, std::uint32_t lane);

 private:
  RolloutJob<double> rollout_of(const Lanes16& job) const;
  void push_lane(const Lanes16& job, std::uint32_t joint, std::uint32_t lane) const;

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  StepSetup setup_;
  std::uint32_t nx_ = 0, joints_ = 0, slot_ = 0;
  bool is_position_[TILLER_MAX_STATES] = {};
  double speed_square_[kDiscrepancyJoints] = {}, seen_ = 0.0;
};

}  // namespace tiller
