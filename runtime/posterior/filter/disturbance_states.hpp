#pragma once

#include <cstdint>

#include "posterior/discrepancy_basis.hpp"
#include "posterior/filter_lanes.hpp"
#include "posterior/prior.hpp"
#include "rollout/rollout.hpp"
#include "rollout/turn.hpp"

namespace tiller {

/// Whether a joint has a limit of contacts (safety.contact_force).
bool feels_contacts(const tiller_config_t& config);

/// What the model lacks, as further states of the filter. Each comes from a source:
///
///  - a force at a joint (posterior.disturbance), which wanders: dw = -w / tau dt + s sd sqrt(2 / tau) dW
///    (Ornstein and Uhlenbeck 1930; the step is exact over any period). Where the model has kDiscrepancyJoints joints
///    or fewer it may swing as well: w is the real part of z, dz = (i omega - 1 / tau) z dt + s sd sqrt(2 / tau) dW,
///    whose correlation over t is exp(-t / tau) cos(omega t); at omega = 0 the imaginary part does nothing. A viscous
///    and a dry force stand beside it then, unless the model has such a friction as a parameter that is learnt;
///  - a slip (posterior.disturbance, of a model without joints): one that wanders, of the rate of a state with process
///    noise;
///  - a parameter that drifts (posterior.drift): its coordinate is the particle's own plus d, dd = s sd dW.
///
///   next = f(x, u, p + d) + sum_j g_j (w_j - beta_j1 v_j - beta_j2 s(v_j)),   beta' = beta
///
/// g_j what a unit force at joint j does to the state, v_j the joint's velocity, s(v) its sign (on average, where it
/// reverses within the period), sd the size of what matters. How large they are (s), how long what wanders lasts (tau,
/// of all) and how fast it swings (omega, of all) are coordinates of each particle. The filter finds them beside the
/// state, and its innovations' likelihood has them integrated out (Friedland, "Treatment of bias in recursive
/// filtering", IEEE TAC 14, 1969).
///
/// Cost of a step of 16 lanes: a rollout of one step a source, and the filter's algebra with as many more states.
class DisturbanceStates {
 public:
  DisturbanceStates() = default;
  /// Parameters of the bits `drift` drift.
  DisturbanceStates(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                    std::uint64_t drift);

  /// The first joints, which have forces by this configuration.
  static std::uint32_t joints_of(const tiller_config_t& config);
  std::uint32_t joints() const { return joints_; }
  /// Bits of the states that slip by this configuration.
  static std::uint32_t slips_of(const tiller_config_t& config);
  /// The first sources, which wander: forces at joints, or slips.
  std::uint32_t wanderers() const { return joints_ + slips_; }
  std::uint32_t drifts() const { return drifts_; }
  std::uint32_t sources() const { return joints_ + slips_ + drifts_; }
  /// States; 0: nothing is looked for.
  std::uint32_t states() const { return states_; }
  /// States of the forces at a joint: the one that wanders alone, or all of a kind.
  std::uint32_t per_joint() const { return per_joint_; }
  bool has_friction() const { return per_joint_ == kAllKinds; }
  static constexpr std::uint32_t kWandering = 0, kTurning = 1, kViscous = 2, kDry = 3, kAllKinds = 4;
  /// Of a drifting parameter, behind the others, and its row among the parameters.
  std::uint32_t drift_state(std::uint32_t drift) const { return states_ - drifts_ + drift; }
  std::uint32_t drift_param(std::uint32_t drift) const { return source_[joints_ + slips_ + drift].index; }
  /// The drift of a parameter; drifts(): it does not.
  std::uint32_t drift_of(std::uint32_t param) const;
  bool wanders(std::uint32_t state) const { return state < states_ - drifts_ && at_source_begin(state); }
  std::uint32_t source_of(std::uint32_t state) const;
  /// Of a wanderer that matters.
  double size_of(std::uint32_t wanderer) const { return sd_[source_[wanderer].first]; }
  std::uint32_t force_state(std::uint32_t wanderer) const { return source_[wanderer].first + kWandering; }
  void clear();

  /// The lanes of a step; rows of `lanes`.
  struct Lanes16 {
    static constexpr std::uint32_t kMost = 16;
    std::uint32_t lanes = 0;
    double period_s = 0.0;
    Lanes<double> state;              // (nx + states) before
    Lanes<double> effect_state;       // (ns)
    double* params = nullptr;         // (np + 1), stride lanes, drifted; the last row is written
    const double* input = nullptr;    // (nu)
    const double* history = nullptr;  // (delay_steps x nu)
    double* next = nullptr;           // (nx + states), of f; is completed
    double* unit = nullptr;           // (sources x nx) out: g
    double* push = nullptr;           // (nx x states) out: d next / d state
    Turn<double>* kept = nullptr;     // (lanes) out: what is left of what wanders after the period
    Turn<double>* mean = nullptr;     // (lanes) out: and on average over it
    Lanes<double> law;                // (law_rows): s^2 a source, of a drift times sd^2; then 1 / tau and omega in 1/s
  };
  /// The parameters of the lanes as they have drifted, in place.
  void drift(const Lanes16& job) const;
  double drifted(std::uint32_t param, double value, double by) const;
  void step(const Lanes16& job) const;

  /// What of a force that wanders is there on average over a time.
  static Turn<double> mean_kept(double rate, double turn, double time_s);
  /// The rows of the states' own slopes, after step(): (states x n), rows of `lanes`, the states in the last columns.
  void fill_slopes(const Lanes16& job, double* rows, std::uint32_t n) const;
  /// += what wandering and drifting within the period adds to a predicted covariance (triangle of nx + states, rows of
  /// `lanes`), after step(). Cost: O(sources nx^2).
  void add_process(const Lanes16& job, double* covariance) const;
  /// Variances (states) of a filter that begins, in the lane whose law stands at `law`: nothing has drifted yet.
  void prior_variance(const double* law, std::uint32_t stride, double* variance) const;

  /// Variance that a viscous or dry force has after a time, before any data: of where it began, and of its walk.
  double friction_variance(std::uint32_t state, double law, double after_s) const;

  std::uint32_t law_rows() const { return sources() > 0 ? sources() + 2 : 0; }
  std::uint32_t rate_row() const { return sources(); }
  std::uint32_t turn_row() const { return sources() + 1; }
  /// Coordinates of a particle that say how large and how long: the sizes, tau, omega, the drifts' rates.
  std::uint32_t coordinates() const { return sizes_ + times() + drifts_; }
  std::uint32_t sizes() const { return sizes_; }
  /// Forces swing: the law has an omega.
  bool swings() const { return times() > 1; }
  tiller_prior_t law_prior(std::uint32_t coordinate) const;
  void read_law(const double* coordinate, std::uint32_t stride, double* law, std::uint32_t law_stride) const;
  /// The law of a posterior that does not learn it.
  void fixed_law(double* law, std::uint32_t stride) const;
  /// The law of a filter that looks out for forces that come from one period to the next: at the joints with a limit of
  /// contacts, or, where no joint has one, at all.
  void sudden_law(double* law, std::uint32_t stride) const;

  /// How large the forces are that matter, from another with the same.
  void take_sizes(const DisturbanceStates& other);
  /// Learns how large a force has to be to matter, from what forces and inputs do in lane 0.
  void measure_reach(const Lanes16& job);
  /// Takes note of one lane of a step. True where a joint was so slow that dry friction may have held it: its friction
  /// is then whatever force the model has there, which none of these has the form of.
  bool sticks(const Lanes16& job, std::uint32_t lane);

 private:
  struct Source {
    std::uint16_t index = 0;  // of the joint, the slipping state or the drifting parameter
    std::uint16_t first = 0;  // state
    std::uint16_t size = 0;   // coordinate
  };

  void add_source(std::uint32_t index, std::uint32_t states, std::uint32_t size);
  /// For forces and slips.
  static std::uint32_t room(const tiller_config_t& config);
  void add_forces();
  void add_slips();
  bool at_source_begin(std::uint32_t state) const { return source_[source_of(state)].first == state; }
  RolloutJob<double> rollout_of(const Lanes16& job) const;
  std::uint32_t pushed_state(std::uint32_t source) const;  // by a force or a slip
  bool turns() const { return per_joint_ == kAllKinds; }
  std::uint32_t times() const { return sizes_ == 0 ? 0 : turns() ? 2 : 1; }
  double rate_of(const Lanes16& job, std::uint32_t lane) const { return law_of(job, rate_row(), lane); }
  static double law_of(const Lanes16& job, std::uint32_t row, std::uint32_t lane) {
    return job.law.data[row * job.law.stride + lane];
  }
  void respond_to_forces(const Lanes16& job) const;
  void respond_to_drifts(const Lanes16& job) const;
  void drop_known(const Lanes16& job, std::uint32_t joint, double speed);
  void push_force(const Lanes16& job, std::uint32_t joint, std::uint32_t lane) const;
  void push_slip(const Lanes16& job, std::uint32_t slip, std::uint32_t lane) const;
  void push_drift(const Lanes16& job, std::uint32_t drift, std::uint32_t lane) const;

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  StepSetup setup_;
  std::uint32_t nx_ = 0, joints_ = 0, slips_ = 0, drifts_ = 0, states_ = 0, per_joint_ = 1, sizes_ = 0, slot_ = 0;
  Source source_[kMaxFilterStates];
  bool is_position_[TILLER_MAX_STATES] = {};
  double sd_[kMaxFilterStates] = {};  // of what matters, a state
  double speed_square_[kDiscrepancyJoints] = {}, seen_ = 0.0;
};

}  // namespace tiller
