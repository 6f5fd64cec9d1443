#pragma once

#include <atomic>
#include <cstdint>

#include "core/arena.hpp"
#include "planners/belief_weights.hpp"
#include "planners/closed_loop.hpp"
#include "planners/cost_frame.hpp"
#include "planners/lane_table.hpp"
#include "planners/planner.hpp"
#include "planners/sequence.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

struct Sampler;

/// The part of a sampling planner that is its own; everything else is shared.
struct SamplingMethod {
  const char* name;
  /// Before the first iteration of a plan; the mean is the shifted old plan.
  void (*begin)(Sampler& s);
  /// Moves the mean (and the spread) after all K rollouts are evaluated; at least one is finite.
  void (*update)(Sampler& s);
  /// Settles the mean for good and returns its cost; called if at least one iteration was completed.
  double (*choose)(Sampler& s);
  /// Fills the knots of all rollouts, on one thread; false if the deadline passed on the way. Null: normal samples
  /// around the mean.
  bool (*draw)(Sampler& s) = nullptr;
  /// The iteration that was drawn does not count; null: nothing to undo.
  void (*cancel)(Sampler& s) = nullptr;
  /// Knots are hold_steps apart and hold until the next.
  bool holds = false;
  /// Costs of this plan are from now on `change` more than they were told; null: no cost is kept.
  void (*rebase)(Sampler& s, double change) = nullptr;
  /// Keeps the cheapest sequence of an iteration in best and best_cost; null: that of the cheapest rollout.
  void (*keep)(Sampler& s) = nullptr;
  /// Whether particles may get sequences of their own in one rollout, by what is seen on the way; null: never.
  bool (*branches)(const tiller_config_t& config) = nullptr;
  /// Fills own_knots (rows x lanes of the chunk) of particle m in a chunk; false: as in all rollouts' knots.
  bool (*aim)(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m) = nullptr;
  /// Reads the trajectory of particle m in a chunk. As aim, by any thread.
  void (*observe)(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m) = nullptr;
};

/// The sampling core: K rollouts around a mean sequence of knots, evaluated on M particles under the risk. A plan is
///
///     shift the mean -> [ draw knots, expand, roll out on each particle, risk, method ] x iterations -> command
///
/// Rollouts are worked off in chunks of a fixed partition, small enough that a chunk's controls stay in the first-level
/// cache while M particles run over them (common random numbers: each particle meets the same controls). A chunk
/// writes only its own costs, and everything that adds over rollouts runs on one thread, so 1..n threads give the
/// same bits.
struct Sampler {
  // ---- what it was made from; constant
  const SamplingMethod* method = nullptr;
  const tiller_planner_config_t* settings = nullptr;
  const tiller_model_t* model = nullptr;
  const StepSetup* setup = nullptr;
  const RolloutTable* table = nullptr;
  const LaneTable* lanes = nullptr;
  const tiller_hooks_t* hooks = nullptr;
  std::uint64_t seed = 0;
  CostTerms<float> cost_terms{};
  CostFrame frame;
  bool penalised = false;  // by bounds or penalty terms, which cost_terms then leaves to the rollouts' penalties
  InputLimit limits[TILLER_MAX_INPUTS];
  double noise_sd[TILLER_MAX_INPUTS] = {};  // of the samples
  InputCones cones;
  double fallback[TILLER_MAX_INPUTS] = {};  // the safe command

  std::uint32_t states = 0, inputs = 0, params = 0, effect_states = 0;
  std::uint32_t rollouts = 0, rows = 0;                  // rows = inputs * knots
  std::uint32_t chunk_lanes = 0, chunks = 0, slots = 0;  // slots: scratch places, each takes chunk after chunk
  std::uint32_t most_particles = 0;
  KnotGrid grid;                            // points at the two arrays below
  float* row_low = nullptr;                 // (rows)
  float* row_high = nullptr;                // (rows)
  float rate_step[TILLER_MAX_INPUTS] = {};  // negative: none
  float scale[kScales] = {};                // of the noise, by rollout mod 16
  void* companion = nullptr;                // what the method keeps beside
  ClosedLoop* loop = nullptr;               // null: one sequence for all hypotheses
  float* mix = nullptr;                     // (knots x knots) of the noise along the knots; null: white
  bool cubic = false;                       // between the knots
  bool anneals = false;                     // anneal() is not 1 everywhere

  // ---- the plan, kept from tick to tick
  KnotClock clock;
  std::uint32_t* first_step = nullptr;         // (knots) of the clock's present phase
  float* fraction = nullptr;                   // (horizon)
  double* mean = nullptr;                      // (rows) within limits
  double* spread = nullptr;                    // (rows) standard deviation of the samples
  float* sequence = nullptr;                   // (horizon x inputs) the mean under the limits
  double start[TILLER_MAX_INPUTS] = {};        // command in force, within limits
  double knot_before[TILLER_MAX_INPUTS] = {};  // knot that was the last to fall off the front
  double lambda = 0.0;                         // MPPI's last one; 0: none yet
  std::uint64_t last_tick = 0;
  std::uint32_t gone = 0;  // knots that fell off since the method last set it to 0
  bool cold = true;        // no plan has had an iteration yet

  // ---- one plan
  const PlanRequest* request = nullptr;
  std::uint32_t particles = 0, padded = 0;     // M, and M padded to kLanePadding
  bool weighted = false;                       // the belief's hypotheses are
  float particle_weight[64] = {};              // (M) sum one
  float* particle_state = nullptr;             // (M x nx) each particle's row is a splat for the rollouts
  float* particle_params = nullptr;            // (M x np)
  float* particle_effects = nullptr;           // (M x ns)
  float* lane_state = nullptr;                 // (nx x padded) particles as lanes, for one sequence on all of them
  float* lane_params = nullptr;                // (np x padded)
  float* lane_effects = nullptr;               // (ns x padded)
  float* lane_cost = nullptr;                  // (padded)
  float* lane_penalty = nullptr;               // (padded); null unless penalised
  float* noise = nullptr;                      // (M x horizon * nx) of this tick; null unless noisy_rollouts
  float* lane_noise = nullptr;                 // (horizon * nx x padded) the same, particles as lanes
  float start_lanes[TILLER_MAX_INPUTS] = {};   // start, in f32
  float before_lanes[TILLER_MAX_INPUTS] = {};  // knot_before, in f32
  double best_cost = 0.0;                      // cheapest sample of this plan
  double* best = nullptr;                      // (rows) and its knots
  double* before = nullptr;                    // (rows) mean before the last update
  double mean_cost_before = 0.0;               // and its cost
  double warm_cost = 0.0;                      // of the shifted old plan

  // ---- one iteration
  std::uint32_t iteration = 0;
  NoiseKey* keys = nullptr;      // ((rows + 1) / 2)
  float* row_mean = nullptr;     // (rows)
  float* row_spread = nullptr;   // (rows)
  float* row_sum = nullptr;      // (rows)
  float* row_squares = nullptr;  // (rows)
  float* knots = nullptr;        // (rows x K)
  float* cost = nullptr;         // (K)
  float* weight = nullptr;       // (K)
  CostRange range{};
  float* controls = nullptr;          // (slots x horizon * inputs x chunk_lanes)
  bool keeps_costs = false;           // of all particles until the method's update
  float* particle_cost = nullptr;     // (slots x M x chunk_lanes); keeps_costs: (chunks x M x chunk_lanes)
  float* particle_penalty = nullptr;  // likewise; null unless penalised
  float* own_knots = nullptr;         // (slots x rows x chunk_lanes) of one particle; null unless the method branches
  float* trajectory = nullptr;        // (slots x (horizon + 1) * nx x chunk_lanes) likewise
  std::atomic<std::uint32_t> next_chunk{0};  // that no slot has taken yet
  std::atomic<bool> aborted{false};          // by the deadline
  // The least penalty of any sample on each particle. Costs come less these: a limit that every sample violates alike,
  // with a weight of 1e12 say, would else leave no digit of single precision for what tells the samples apart.
  float* least_penalty = nullptr;  // (M)
  double reference = 0.0;          // what all costs of this iteration therefore come less
};

/// PlannerTable's functions for every method; `self` is a Sampler.
Sampler* lay_out_sampler(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                         const tiller_hooks_t* hooks, const SamplingMethod& method);
PlanResult plan_by_sampling(void* self, const PlanRequest& request, double* command);
void reset_sampler(void* self);
const float* sampled_sequence(const void* self);

/// A rollout of the mean hypothesis from the present state, without a cost; for plans with a closed loop.
RolloutJob<float> mean_job(const Sampler& s);

/// Cost of the present mean under the limits and the risk; fills the sequence. One rollout with a lane per particle:
/// about the price of 16 sampled rollouts.
double evaluate_mean(Sampler& s);

/// First rollout and number of rollouts of a chunk.
inline std::uint32_t first_of_chunk(const Sampler& s, std::uint32_t chunk) { return chunk * s.chunk_lanes; }
inline std::uint32_t lanes_of_chunk(const Sampler& s, std::uint32_t chunk) {
  const std::uint32_t left = s.rollouts - chunk * s.chunk_lanes;
  return left < s.chunk_lanes ? left : s.chunk_lanes;
}
inline float* own_knots_of(const Sampler& s, std::uint32_t slot) {
  return s.own_knots + std::size_t{slot} * s.rows * s.chunk_lanes;
}
/// (horizon + 1) * nx rows of the chunk's lanes.
inline float* trajectory_of(const Sampler& s, std::uint32_t slot) {
  return s.trajectory + std::size_t{slot} * (s.grid.horizon + 1) * s.states * s.chunk_lanes;
}
/// Cost of a rollout on particle m; where keeps_costs.
float particle_cost(const Sampler& s, std::uint32_t rollout, std::uint32_t m);

/// Keeps the cheapest rollout's sequence if none before was cheaper.
void keep_rollout(Sampler& s, std::uint32_t rollout);

/// Takes the command in force, brought into limits and cones; the safe command if `last_command` is null.
void start_from_command(Sampler& s, const double* last_command);

/// Expands the present mean under limits and cones into the sequence; `command` may be null.
void expand_mean(Sampler& s, double* command);

// ---- options (sampler_options.cpp) --------------------------------------------------------------

/// Whether noise_colour or filter ask for noise that is not white along the knots.
bool mixes_noise(const tiller_planner_config_t& p);
/// Fills mix (knots x knots). O(knots^3).
void fill_mix(const tiller_planner_config_t& p, float* mix);

/// noisy_rollouts: start errors and process noise of this tick, from what the belief says of its spread; none where it
/// says nothing. The same for all rollouts of a particle (common random numbers). Cost: about 15 ns a number.
void draw_rollout_noise(Sampler& s);

/// Whether samples are drawn narrower in later iterations or at earlier knots.
bool anneals(const tiller_planner_config_t& p);
/// What an iteration's samples of knot j have of its spread (DIAL-MPC, Xue et al., ICRA 2025, whose factors a knot and
/// an iteration are e-folds over all of them here):
///
///     exp(-anneal_iterations i / (I - 1)) exp(-anneal_horizon (1 - j / (J - 1))),   i = 0..I-1, j = 0..J-1
///
/// I is the configured number of iterations, whatever the deadline leaves of them: a replay draws the same samples.
/// With I = 1 nothing falls over the iterations.
double anneal(const tiller_planner_config_t& p, std::uint32_t iteration, std::uint32_t knot, std::uint32_t knots);
/// That of a row in this iteration; 1 where nothing anneals.
inline double anneal_of_row(const Sampler& s, std::uint32_t row) {
  return s.anneals ? anneal(*s.settings, s.iteration, row % s.grid.knots, s.grid.knots) : 1.0;
}
/// Brings the variance of some of this iteration's samples, relative to their scales, back to before they were
/// annealed: samples that were chosen by chance then leave the spread as it was. False where they say nothing of it:
/// they lie so close together that single precision hardly tells them apart, or the variance is not finite.
bool take_back_annealing(const Sampler& s, std::uint32_t row, double& variance);

/// adapt_covariance: moves every knot's spread towards that of this iteration's weighted samples.
void adapt_spread(Sampler& s);
/// Moves the spread up with the knots; the free places begin at noise_sd.
void shift_spread(Sampler& s, std::uint32_t gone);

/// The largest value that lanes compute with: squares and sums over 8192 rollouts of it stay finite in f32.
float lane_number(double x);

/// Knots of a horizon whose knots hold: one for each piece that may begin within it, and the last one's copy.
inline std::uint32_t held_knots(std::uint32_t horizon, std::uint32_t hold) {
  return (horizon + 2 * hold - 2) / hold + 1;
}

// Of the input's range: noise_sd where none is configured. Most knots of the widest samples are then at a limit, as
// those of a swing-up; the finest have a thirtieth of the range. docs/evidence/planners.md has the costs.
constexpr double kWidths = 2.0;

inline std::uint32_t pad_lanes(std::uint32_t n) { return (n + kLanePadding - 1) / kLanePadding * kLanePadding; }

/// Number of the cheapest rollout of this iteration, the first of equals.
std::uint32_t cheapest_rollout(const Sampler& s);

}  // namespace tiller
