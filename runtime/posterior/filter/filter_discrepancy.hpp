#pragma once

#include <cstdint>

#include "posterior/discrepancy_basis.hpp"
#include "posterior/filter_lanes.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Forces that the model lacks, as further states of the filter: at each joint one that wanders, a viscous and a dry
/// one, which push the state over a period,
///
///   next = f(x, u) + sum_j g_j (w_j - beta_j1 v_j - beta_j2 s(v_j)),   beta' = beta
///   dw_j = -w_j / tau dt + s_j sd_j sqrt(2 / tau) dW
///
/// g_j what a unit force at joint j does to the state, v_j the joint's velocity, s(v) its sign (on average, where it
/// reverses within the period), sd_j the size of a force that matters. How large the forces are (s_j) and how long w
/// lasts (tau, of all joints) are coordinates of each particle; the step of w is exact over any period (Ornstein and
/// Uhlenbeck 1930). The filter finds the forces beside the state, and its innovations' likelihood has them integrated
/// out (Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).
///
/// Cost of a step of 16 lanes: a rollout of one step per joint, and the filter's algebra with three more states a
/// joint.
class FilterDiscrepancy {
 public:
  FilterDiscrepancy() = default;
  FilterDiscrepancy(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);

  /// Joints that have forces by this configuration.
  static std::uint32_t joints_of(const tiller_config_t& config);
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
    Lanes<double> law;                // (law_rows) s_j^2, and 1 / tau in 1/s
  };
  void step(const Lanes16& job) const;

  /// What is left of a wandering force after a period.
  static double kept(double rate, double period_s);
  /// And on average over `periods` times tau.
  static double mean_kept(double periods);
  /// += what the forces' wandering within the period adds to a predicted covariance (triangle of nx + forces, rows of
  /// `lanes`), after step(). Cost: O(joints nx^2).
  void add_process(const Lanes16& job, double* covariance) const;
  /// The forces' variances before any data (forces) in the lane whose law stands at `law`.
  void prior_variance(const double* law, std::uint32_t stride, double* variance) const;
  /// Coordinates of a particle that say how large the forces are and how long the wandering ones last; as many rows has
  /// the law that is made of them.
  std::uint32_t law_rows() const { return joints_ > 0 ? joints_ + 1 : 0; }
  tiller_prior_t law_prior(std::uint32_t row) const;
  void read_law(const double* coordinate, std::uint32_t stride, double* law, std::uint32_t law_stride) const;
  /// The law of a posterior that does not learn it.
  void fixed_law(double* law, std::uint32_t stride) const;
  /// The law of a filter that looks out for contacts (safety.contact_force); no force at joints without a limit.
  void contact_law(double* law, std::uint32_t stride) const;

  /// Learns how large a force has to be to matter, from what forces and inputs do in lane 0.
  void measure_reach(const Lanes16& job);
  /// Takes note of one lane of a step. True where a joint was so slow that dry friction may have held it: its friction
  /// is then whatever force the model has there, which none of these has the form of.
  bool sticks(const Lanes16& job, std::uint32_t lane);

 private:
  RolloutJob<double> rollout_of(const Lanes16& job) const;
  double rate_of(const Lanes16& job, std::uint32_t lane) const;
  void push_lane(const Lanes16& job, std::uint32_t joint, std::uint32_t lane) const;

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  StepSetup setup_;
  std::uint32_t nx_ = 0, joints_ = 0, slot_ = 0;
  bool is_position_[TILLER_MAX_STATES] = {};
  double sd_[kMaxRegressors] = {};  // of forces that matter
  double speed_square_[kDiscrepancyJoints] = {}, seen_ = 0.0;
};

}  // namespace tiller
