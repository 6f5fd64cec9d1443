#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Disturbances that a model may lack: a constant force at the channel's joint, one that goes with the joint's velocity
/// its sign or its position, and of each input its own share and that of its change.
enum Disturbance : std::uint32_t { kBias, kVelocity, kSign, kPosition, kInputs };
constexpr std::uint32_t disturbance_count(std::uint32_t inputs) { return kInputs + 2 * inputs; }
constexpr std::uint32_t kMaxDisturbances = disturbance_count(TILLER_MAX_INPUTS);

/// One tick as the posterior's mean predicted it.
struct Innovation {
  double normalised[TILLER_MAX_MEASUREMENTS] = {};  // (ny) measured minus predicted, over the predictive deviation
                                                    // (noise and what is unknown of the parameters); NaN: missing
  /// (ny x disturbances) what each disturbance would have put into the value, in any unit; known beforehand.
  double response[TILLER_MAX_MEASUREMENTS][kMaxDisturbances] = {};
};

/// The disturbances' own course: 1, v, sign v, q, and of each input u and its change.
class Disturbances {
 public:
  void begin() { begun_ = false; }
  /// velocity, position (channels): of each channel's joint; input (inputs): in force. No position, no force by it:
  /// who estimates no forces finds a spring by what it is at rest and by how it changes.
  void observe(std::uint32_t channels, std::uint32_t inputs, const double* velocity, const double* position,
               const double* input, double (*phi)[kMaxDisturbances]);

 private:
  double velocity_square_[TILLER_MAX_MEASUREMENTS] = {};  // running means
  double count_ = 0.0;
  double before_[TILLER_MAX_INPUTS] = {};
  bool begun_ = false;
};

/// The state that is the velocity of state `i`'s joint (itself, for a velocity); state_count where no joint has it.
std::uint32_t velocity_state(const tiller_model_t& model, std::uint32_t i);
/// Its position, likewise.
std::uint32_t position_state(const tiller_model_t& model, std::uint32_t i);

/// Whether the innovations are what the model says they are, one tick after the other.
///
/// Under the model a normalised innovation has, given all that came before, mean zero and variance one: it goes with
/// nothing that was known beforehand. For a feature b known before the innovation y and any l,
///     exp(l S - l^2 V / 2),   S = sum b y,   V = sum b^2 (y^2 + 2) / 3
/// is then a supermartingale (Delyon, "Exponential inequality for sums of dependent random variables", EJP 14, 2009;
/// the third of V that is observed keeps it honest where the scale is misjudged). Averaged over l ~ N(0, 1 / r) it is
///     E = sqrt(r / (V + r)) exp(S^2 / (2 (V + r)))
/// (Robbins 1970; Howard, Ramdas, McAuliffe and Sekhon, Annals of Statistics 49, 2021, section 3.2), and by Ville's
/// inequality it ever exceeds 1 / level with probability at most `level`. Changes late in a run are seen because the
/// sums start again every kSpacing ticks and live for kCohorts * kSpacing; half of the level is for the
/// first of them (a model is wrong from the start, mostly), the rest is split over the others, either over channels and
/// features (Shin, Ramdas and Rinaldo, "E-detectors", 2023, for the same idea without the split).
///
/// Parameters are fitted meanwhile, but each innovation is taken before its value is: it is the prequential one
/// (Dawid 1984), a martingale difference under the posterior's own prediction.
///
/// `size` is the likelihood ratio of a noise kGrowth times as large against the Student density that the values so far
/// predict, the exact conditional density of normal values of unknown scale.
///
/// Forces that are estimated beside the state (posterior.disturbance) leave no trace in the innovations. Whether they
/// are systematic their own evidence says, which take_force() is told: a likelihood ratio under the same level.
///
/// The tests are those of the configuration's channels. Cost: O(kCohorts * channels * features) per tick.
class AdequacyTest {
 public:
  /// Chance of an alarm in kLevelTicks ticks of a well-specified run: at most one in a hundred such runs.
  static constexpr double kLevel = 0.01;
  static constexpr std::uint32_t kLevelTicks = 10000;

  /// Innovations that alternate give no alarm: a Kalman filter's do where its process noise is stated too large, those
  /// of states taken as measured do by the measurements' noise, and neither misleads.
  ///
  /// `overlap`: neighbouring innovations share the noise of the measurement between them, as those of states taken as
  /// measured do. A feature then is one of the tick before the last, and the sums of those that may alternate count
  /// kOverlap times their variance: of two series with lag-one correlations of -1/2 the products' sum has
  /// 1 + 2 (1/2)^2 times the variance that independent terms would give it (Bartlett 1946).
  ///
  /// `forces`: of which evidence is told.
  static AdequacyTest* lay_out(Arena& arena, const tiller_config_t& config, bool overlap, std::uint32_t forces = 0);

  void reset();
  /// The sums start again, because the posterior does; an alarm stays.
  void restart();
  /// Takes an alarm back: what was learnt since explains the data.
  void withdraw() {
    state_ = tiller_adequacy_adequate;
    by_force_ = false;
  }
  /// Whether the innovations gave an alarm in this tick, an earlier one or not.
  bool sounds() const { return sounds_; }
  /// The state estimate starts again: the innovations of the next kSettling ticks are not tested.
  void begin();
  void take(const Innovation& innovation);
  /// After take(), of `force` below kMostForces: the logarithm of how much likelier the data are with a force that goes
  /// with the feature than without. Its alarm says that the model lacks what the estimate follows, so one of the
  /// innovations, which nothing explains, takes its place.
  void take_force(std::uint32_t force, std::uint32_t channel, tiller_feature_t feature, double evidence);
  static constexpr std::uint32_t kMostForces = 8;

  tiller_adequacy_t state() const { return state_; }
  /// Of the alarm; before one, of the largest statistic.
  std::uint32_t channel() const { return channel_; }
  tiller_feature_t feature() const { return feature_; }
  /// Largest log E over its threshold; at the alarm, what it was then.
  double statistic() const { return statistic_; }
  /// The last tick's normalised innovation of a channel, over the noise scale of those before; NaN: none.
  double residual(std::uint32_t channel) const { return residual_[channel]; }

 private:
  static constexpr std::uint32_t kSettling = 20;
  static constexpr std::uint32_t kSpacing = 128;
  static constexpr std::uint32_t kCohorts = 8;
  static constexpr std::uint32_t kMaxFeatures = kMaxDisturbances + 2;

  /// The state of a channel from tick to tick.
  struct Channel {
    double squares = 0.0;  // of the clipped values
    double count = 0.0;
    double last = 0.0, previous = 0.0, recent = 0.0;  // the value before; as features: a value, and the mean up to it
    double response_count[kMaxDisturbances] = {};
    double response_square[kMaxDisturbances] = {};  // running means
  };
  struct Sums {
    double s = 0.0, v = 0.0;
  };

  void begin_cohort();
  void features_of(Channel& channel, const double* response, double* feature) const;
  void remember(Channel& channel, double y) const;
  double variance_share(std::uint32_t feature) const;
  void test_channel(std::uint32_t k, double normalised, const double* feature);
  double threshold_of(std::uint32_t cohort) const;
  void note(double ratio, std::uint32_t k, std::uint32_t feature);
  bool stands() const { return state_ == tiller_adequacy_inadequate && !by_force_; }
  tiller_feature_t name_of(std::uint32_t feature) const;

  // constant after lay_out
  std::uint32_t channels_ = 0, disturbances_ = 0;
  std::uint32_t features_ = 0;  // disturbances, previous and recent; without `size`
  double shape_ = 0.0;          // of the noise's scale, as configured
  double first_threshold_ = 0.0, threshold_ = 0.0;
  bool overlap_ = false;
  Channel* channel_data_ = nullptr;  // (channels)
  Sums* sums_ = nullptr;             // (channels x features x kCohorts)
  double* growth_ = nullptr;         // (channels x kCohorts) log likelihood ratios of `size`

  // where it stands
  std::uint64_t ticks_ = 0;     // tested
  std::uint32_t settling_ = 0;  // ticks left
  tiller_adequacy_t state_ = tiller_adequacy_untested;
  std::uint32_t channel_ = 0;
  tiller_feature_t feature_ = tiller_feature_none;
  double statistic_ = 0.0;
  double largest_ = 0.0;  // in this tick
  bool sounds_ = false;
  bool by_force_ = false;                 // the alarm is take_force()'s
  std::uint32_t held_[kMostForces] = {};  // ticks in a row with evidence beyond the threshold
  double residual_[TILLER_MAX_MEASUREMENTS] = {};
};

}  // namespace tiller
