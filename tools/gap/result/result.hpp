#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"
#include "tools/logs/telling_rows.hpp"
#include "tools/robot/prior_edge.hpp"
#include "tools/robot/robot_file.hpp"

// What `tiller gap` finds, between those who find it (the other headers of this folder) and those who show it
// (gap_page, gap_json, gap_robot). Errors of rollouts are in "sigma": root mean square over the windows' points of the
// measurement's deviation from the rollout, in standard deviations of what sensor and process noise leave (1: nothing
// but noise).

namespace tiller {
struct EffectInfo;
}

namespace tiller::tools::gap {

/// As the kind of an EffectAt whose port is a parameter's index: this parameter is another one than before. So changes
/// and new effects compete in one search.
constexpr std::uint32_t kChangedParameter = UINT32_MAX;

/// An effect at a port of the model, or a parameter that changed.
struct EffectAt {
  std::uint32_t kind = 0;  ///< tiller_effect_kind_t, or kChangedParameter
  std::uint32_t port = 0;
  bool operator==(const EffectAt& o) const { return kind == o.kind && port == o.port; }
};

/// effect_info() that also knows kChangedParameter, which adds no parameter of its own.
const EffectInfo& info_of(std::uint32_t kind);

/// What logs say of a model with its effects, to second order.
struct ModelFit {
  std::vector<double> mean, sd;     ///< (np)
  std::vector<double> information;  ///< (np x np) of half the cost, priors included; zeros for fixed parameters
  double sigma = 1;                 ///< that it leaves of rollouts of 1 s on those logs; at least 1
};

/// What is another one in the logs of after: a parameter, or an effect that was not there.
struct Change {
  std::string name, unit;
  bool effect = false;               ///< a parameter of a new effect, which was not there before
  double before = 0, before_sd = 0;  ///< NaN for a new effect's
  double after = 0, after_sd = 0;
  double change = 0, low = 0, high = 0;  ///< after - before, and 95 % of it
};

/// How the model of before was found.
struct BeforeTold {
  std::vector<std::string> logs;
  std::string hash, verdict, sentence;
  std::string robot_file;  ///< that holds it; empty: not written
  double data_s = 0;
};

/// A parameter of the model or of an effect, fitted.
struct Estimate {
  std::string name;  ///< as in the robot file: "mass_kg", "joint.friction_SI"
  std::string unit;
  bool fixed = false;                ///< by the robot file
  double before = 0, before_sd = 0;  ///< of the nominal model's fit; NaN for an effect that it lacks
  double mean = 0, sd = 0;           ///< with the effects added
  double low = 0, high = 0;          ///< 95 %
  PriorEdge edge;                    ///< of the robot file's own; what an effect adds has no prior of the user's
};

/// Rollouts of one length on windows that no fit has seen.
struct HorizonGap {
  double seconds = 0;
  double before_sigma = 0, after_sigma = 0;
  std::vector<double> before_rms, after_rms;  ///< (ny) in the channel's unit
  std::size_t windows = 0;
  double worse_z = 0;  ///< logarithm of after over before, window by window, in standard errors of its mean
};

/// A set of effects and how well it explains the windows that decide.
struct Explanation {
  std::vector<EffectAt> effects;  ///< empty: the nominal model
  std::vector<Estimate> params;   ///< all of the model's, then the effects'
  double gain_nats = 0;           ///< log density of the deciding windows over the nominal model's
  double z = 0;                   ///< paired difference to the nominal model, clipped, in its standard errors
  double z_to_best = 0;           ///< the same to the best explanation; 0 for itself
  double robust_z_to_best = 0;    ///< by a robust score
  double rollout_ratio = 0;       ///< long rollouts' error over the best explanation's
  double remaining_sigma = 0;     ///< what it leaves
  bool equivalent = false;        ///< to the best one: no difference on these data above a tenth of the noise
};

/// The residual generalised force of a joint over one axis.
enum class Axis { position, velocity, input, input_rate, time, input_sign_square, count };
const char* axis_name(Axis axis);
struct AxisMap {
  std::uint32_t joint = 0;
  Axis axis = Axis::position;
  std::string axis_label;  ///< "angle_rad", "d torque_Nm/dt", ...
  struct Bin {
    double low = 0, high = 0;  ///< of the axis
    double mean = 0, sd = 0;   ///< of the residual force (N or N m) and of that mean, serial correlation counted
    double count = 0;
  };
  std::vector<Bin> bins;
  double statistic = 0;      ///< how much of the residual goes with the axis
  std::vector<double> null;  ///< the same under block permutations
  double z = 0;              ///< statistic against them
  double p_value = 1;
};
/// Where it is: the bins of the strongest axis whose residual is not noise, as one stretch.
struct Region {
  bool found = false;
  std::uint32_t joint = 0;
  Axis axis = Axis::position;
  double low = 0, high = 0;        ///< of the axis
  double force = 0, force_sd = 0;  ///< mean residual there, N or N m
  double z = 0;
};

/// The residual force of a joint that turns, by whole orders of its revolution.
struct OrderSpectrum {
  std::uint32_t joint = 0;
  std::vector<double> amplitude;  ///< of orders 1, 2, ...; N m
  std::vector<double> chance;     ///< (orders) which one of twenty spectra of chance reach at any order
};

/// The force that the model lacks at a joint along a log, smoothed.
struct MissingForce {
  std::uint32_t joint = 0;
  std::string log;
  std::vector<double> time_s, mean, sd;  ///< (points), N or N m; NaN where no sensor was read
};

enum class Verdict { no_gap, named, ambiguous, partly, unnamed, leading, off_prior, unfit };
const char* verdict_name(Verdict verdict);  ///< "partly_explained" for partly, else as it is called here

/// A held-out stretch: what was measured and what the models roll out from its first state.
struct Overlay {
  std::string log;
  double first_time_s = 0;
  std::vector<double> time_s;                                ///< (points)
  std::vector<std::vector<double>> measured, before, after;  ///< (ny) of (points)
  std::vector<std::vector<double>> input;                    ///< (nu) of (points)
};

struct Result {
  Verdict verdict = Verdict::unfit;
  bool interrupted = false;          ///< the user stopped; what is here was finished
  std::string sentence;              ///< the verdict in words an engineer acts on
  std::vector<std::string> notes;    ///< warnings and hints, a sentence each
  std::vector<std::string> reasons;  ///< unfit: what, where and how to mend

  // the gate
  double nominal_sigma = 0;  ///< deciding windows, 1 s
  double noise_ratio = 0;    ///< model-free estimate of the sensor noise over the configured one, worst channel
  double whiteness_p = 1;    ///< of the nominal model's residuals

  // where
  std::vector<AxisMap> maps;  ///< strongest first
  Region region;
  std::vector<MissingForce> forces;   ///< of each joint, along the longest stretch of the logs
  std::vector<OrderSpectrum> orders;  ///< of joints whose travel contains a turn twice

  // what
  std::vector<Explanation> ranking;    ///< best first; the nominal model is among them
  std::vector<std::size_t> ambiguity;  ///< indices into ranking that cannot be told from the best, the best included;
                                       ///< empty unless something is named
  std::size_t leading = 0;  ///< into ranking: what comes nearest to being proven where nothing is; 0: nothing does
  double more_s = 0;        ///< of data as these that would prove it
  std::string separation;   ///< the experiment that would tell the ambiguity set apart; empty if none is needed

  // proof
  std::vector<HorizonGap> horizons;
  double remaining_sigma = 0;  ///< of the best explanation on the windows kept for the test, 1 s
  std::vector<Overlay> overlays;

  std::size_t fit_windows = 0, decide_windows = 0, test_windows = 0;
  double data_s = 0;  ///< seconds of data used

  std::size_t model_place = 0;  ///< into ranking: the model to go on with; what is not proven is not in it
  ModelFit model;               ///< its fit

  // what changed, where Options::before is given
  BeforeTold before;
  double before_sigma = 1;      ///< that the model of before leaves on its own logs; the unit of all errors here
  double frozen_sigma = 0;      ///< deciding windows under the model of before as it is
  std::vector<Change> changes;  ///< of the best explanation, largest in its deviations first
  std::vector<Change> others;   ///< of each further parameter, did it change beside that; 95 % should hold 0

  double cpu_s = 0;
  std::size_t memory_bytes = 0;       ///< bound of what is taken after the logs were read, known before the search
  std::string data_hash, model_hash;  ///< of the logs' bytes and of the robot file
};

struct Options {
  std::vector<std::string> logs;        ///< fitted, decided and tested on: split by windows
  std::vector<std::string> hold_out;    ///< tested on alone; empty: a share of the logs
  double budget_sigma = 1.1;            ///< --budget: a remaining gap up to this is no gap
  std::size_t most_steps = kMostSteps;  ///< of the logs' time, in steps of period_s; 0: all
  std::uint32_t max_effects = 3;
  std::vector<std::string> only;     ///< kinds to consider; empty: all
  const ModelFit* before = nullptr;  ///< of the robot file on logs of before: the logs are asked what changed since
  std::vector<EffectAt> given;       ///< taken for the explanation whatever the data say; empty: searched for
  std::uint64_t seed = 1;
  std::uint32_t threads = 1;  ///< that share the windows; results are the same bits for any number
  std::function<void(const char* step, double share)> progress;  ///< may be empty
  const volatile int* stop = nullptr;                            ///< set by Ctrl-C: finish the step, keep what is done
};

}  // namespace tiller::tools::gap
