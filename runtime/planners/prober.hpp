#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/rng.hpp"
#include "planners/closed_loop.hpp"
#include "planners/cost_frame.hpp"
#include "planners/planner.hpp"
#include "planners/probe_sight.hpp"
#include "planners/probe_value.hpp"
#include "planners/sequence.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Bounds of states and inputs for a calibration (tiller_box_t), the block's own.
struct ProbeBox {
  double state_low[TILLER_MAX_STATES], state_high[TILLER_MAX_STATES];
  double input_low[TILLER_MAX_INPUTS], input_high[TILLER_MAX_INPUTS];
};

/// What one search is for.
struct ProbeTask {
  const PlanRequest* plan = nullptr;  // of the planner; its belief is the prober's own, and knows its spread
  const float* sequence = nullptr;    // (horizon x nu) the planner's, that goes out where nothing is found
  const ProbeBox* box = nullptr;      // null: probe beside the task; else calibrate
  double most_cost = 0.0;             // that probing may add now, beside
  double budget = 0.0;                // this share of what the planner's sequence costs
};

struct ProbeResult {
  bool probes = false;     // sequence() goes out
  double value = 0.0;      // of the best that was found, whether it goes out or not: expected to be saved by what it
                           // tells beyond what the planner's own sequence tells,
  double cost = 0.0;       // and what it costs more than that, were as much known after it
  double step_cost = 0.0;  // of that, what its first period costs, if the planner's sequence goes on after it
  double information =
      0.0;                 // nats about the parameters, by when a probing motion is over; or in a calibration's horizon
  double plan_cost = 0.0;  // expected of the planner's sequence and of what will be learnt from it
};

/// Looks beside any planner's sequence for one that is worth sending for what it will tell (dual control).
///
/// A sequence k is judged by what it is expected to cost who sends it, learns from it and answers. Of M hypotheses of
/// the prober's own, all in plain rollouts whose trajectories are their second output:
///
///     blind(k)    mean cost of k to the end, nothing learnt
///     told(k, s)  mean cost of k until stage s (four, ever further apart), and from there of what suits the hypothesis
///                 that is true: its own sequence, under feedback about the motion that this would be
///     share(k, s) of the mistakes between hypotheses that are no more made by stage s, once each pair is told apart as
///                 far as it is by then: RegretTable, ProbeSight
///     ignorant    share of blind - told, of the planner's sequence, that who knows the parameters saves and who only
///                 plans again does not (value of perfect information)
///
///     cost(k) = sum over s of (share(k, s) - share(k, the stage before)) told(k, s)
///               + (1 - share(k, last)) (told(k, last) + ignorant (blind(k) - told(k, last)))
///
/// Where never to learn would cost nothing much, the planner's sequence stands. R sequences are tried: around the
/// planner's, around the last one that was found, and as if one of the hypotheses were true. The best that keeps the
/// bounds of states with 1 - risk, and adds no more than is allowed, goes out where it saves enough, and goes on
/// for as long as it saves anything. Nothing is simulated within a simulation. A calibration has no regrets: it chooses
/// the largest information in its box.
class Prober {
 public:
  /// `config` and what it points to outlive the prober, as do `setup` and `table`. Null arrays while the arena
  /// measures.
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);
  void reset();
  /// How many hypotheses it judges by.
  static std::uint32_t hypotheses_of(const tiller_config_t& config);
  /// Bounded by the configuration: 5 R + 400 rollouts on each hypothesis, and a Riccati sweep for it.
  ProbeResult search(const ProbeTask& task);
  /// (horizon x nu) of the last search that probes.
  const float* sequence() const { return best_; }
  /// Expected cost of one period under `input` (nu) from the belief of the last search.
  double stage_cost(const double* input, std::uint64_t task_step);

 private:
  static constexpr std::uint32_t kBatch = 64;  // lanes of a rollout call: four registers of AVX-512 in flight
  static constexpr std::uint32_t kMostKnots = 16;
  static constexpr std::uint32_t kStages = 4;
  static constexpr std::uint32_t kMotion = 2;  // the stage by which a probing motion is over

  /// What a batch came to.
  struct Score {
    double cost;       // expected, with what will be learnt
    double told;       // were all told when a probing motion is over
    double ignorance;  // what it would cost more never to learn
    double beyond;     // largest probability of a bound passed
    double gain;       // to be maximised
  };

  void take_belief(const PlanRequest& request);
  void set_stages();
  void follow_time(const ProbeTask& task);
  void take_limits(const ProbeTask& task);
  void design_margins();
  void draw(Rng& rng, std::uint32_t lane, const float* around, double widest = 1.0);
  void place(std::uint32_t lane, const float* sequence);
  void place_all(const float* sequence);
  void place_wish(std::uint32_t lane);
  void repeat_first();
  RolloutJob<float> common_job() const;
  void roll(std::size_t m, float* cost, float* trajectory, const RolloutFeedback<float>* law = nullptr);
  void align();
  void take_laws();
  RolloutFeedback<float> law_of(std::size_t j, std::uint32_t from) const;
  void answer(std::uint32_t m, std::uint32_t stage, float* cost);
  void specialise(Rng& rng);
  void cross();
  void judge();
  void measure_beyond();
  void measure_beyond(std::uint32_t step, std::uint32_t bound, const float* x);
  std::uint32_t rate_of(std::uint32_t state) const;
  void accumulate();
  float* special(std::size_t m) { return special_ + m * length(); }
  bool read_pairs(std::uint32_t stage, std::uint32_t lane, double* pairs) const;
  Score score(std::uint32_t lane) const;
  double told_nats(std::uint32_t lane) const;
  double least_saving(double cost) const;
  bool needs_to_know(ProbeResult& result);
  void consider(std::uint32_t first, std::uint32_t end);
  double switched_cost();
  double share() const { return 1.0 / hypotheses_; }
  std::size_t gains() const { return length() * law_.law.columns; }
  std::size_t length() const { return std::size_t{horizon_} * nu_; }

  const tiller_config_t* config_ = nullptr;
  const StepSetup* setup_ = nullptr;
  const RolloutTable* table_ = nullptr;
  CostTerms<float> cost_terms_{};
  CostFrame frame_;
  ProbeSight sight_;
  MotionLaw law_;  // of one hypothesis after the other
  InputCones cones_;
  std::uint32_t nx_ = 0, nu_ = 0, np_ = 0, ns_ = 0, horizon_ = 0, knots_ = 0;
  std::uint32_t hypotheses_ = 0, pad_ = 0;

  // kept from tick to tick
  std::uint64_t last_tick_ = 0;
  bool has_last_ = false, has_best_ = false, sent_ = false;
  double usual_cost_ = 0.0;  // of the planner's sequences, mean since the reset
  std::uint64_t searches_ = 0;
  std::uint32_t resting_ = 0;
  float* special_ = nullptr;  // (M x horizon x nu) what suits each hypothesis
  float* best_ = nullptr;     // (horizon x nu)

  // of one search
  float* last_ = nullptr;   // (horizon x nu) the best one of the tick before, or of the round
  double* wish_ = nullptr;  // (horizon x nu)
  const ProbeTask* task_ = nullptr;
  bool calibrates_ = false;
  std::uint32_t stages_ = 0, stage_[kStages] = {};  // periods, growing
  std::uint32_t motion_ = 0;                        // periods that a probing motion takes
  double ignorant_ = 0.0;
  InputLimit limits_[TILLER_MAX_INPUTS];
  double start_[TILLER_MAX_INPUTS] = {};
  double wish_low_[TILLER_MAX_INPUTS] = {}, wish_high_[TILLER_MAX_INPUTS] = {};  // of what may be asked for
  float start_lanes_[TILLER_MAX_INPUTS] = {};
  RegretTable regrets_;
  bool goes_on_ = false;       // the best one is that of the tick before
  std::uint32_t bounded_ = 0;  // states with a bound
  std::uint32_t bounded_state_[TILLER_MAX_STATES] = {};
  double low_[TILLER_MAX_STATES] = {}, high_[TILLER_MAX_STATES] = {};
  Score own_{}, chosen_{};  // of the planner's sequence, and of the best one
  double chosen_nats_ = 0.0;
  double* margin_ = nullptr;       // (horizon + 1 x nx) deviations of the state
  float* state_ = nullptr;         // (M x nx)
  float* params_ = nullptr;        // (M x np)
  float* effects_ = nullptr;       // (M x ns)
  float* controls_ = nullptr;      // (horizon * nu x kBatch)
  float* trajectory_ = nullptr;    // ((horizon + 1) * nx x kBatch)
  float* signal_ = nullptr;        // (M x horizon * signals x kBatch)
  float* beyond_ = nullptr;        // (horizon + 1 x kBatch) probability of being beyond a bound; row 0: how far beyond
  float* batch_cost_ = nullptr;    // (M x kBatch) blind
  float* told_cost_ = nullptr;     // (stages x kBatch) mean over the hypotheses
  float* blind_ = nullptr;         // (horizon * nu x kBatch) the batch's own inputs
  float* gain_ = nullptr;          // (M x gains) of each hypothesis' law
  float* reference_ = nullptr;     // (M x (horizon + 1) * nx) motion of each hypothesis under its own sequence
  float* apart_ = nullptr;         // (stages x M x M x kBatch) of pairs; a calibration's Gram matrix
  double* table_cost_ = nullptr;   // (M + 1 x M)
  float* lane_state_ = nullptr;    // (nx x pad) hypotheses as lanes
  float* lane_params_ = nullptr;   // (np x pad)
  float* lane_effects_ = nullptr;  // (ns x pad)
  float* lane_next_ = nullptr;     // (nx x pad)
};

}  // namespace tiller
