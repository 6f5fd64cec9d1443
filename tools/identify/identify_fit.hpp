#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/identify/identify_history.hpp"
#include "tools/identify/method.hpp"
#include "tools/identify/residual_pattern.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/robot/prior_edge.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A model whose parameters are learnt from logs: the robot file's, or a part of it.
struct Candidate {
  std::string name;     ///< "nominal", "pendulum + viscous_friction (joint)", ...
  Config config{};      ///< a copy of the robot's with fewer effects; owns nothing
  Words params;         ///< (param_count)
  bool learns() const;  ///< at least one parameter has a prior
};

/// The candidates of a fit, simplest first: the model without effects and with every parameter at its prior's centre;
/// the same with the model's own parameters learnt (if any has a prior); then the effects, one more at a time, in
/// the order of the robot file. Of more than eight effects, all of one kind are one step.
std::vector<Candidate> make_candidates(const RobotFile& robot);

struct ParamSummary {
  std::string name;
  bool fixed = false;
  double prior_mean = 0, prior_sd = 0, prior_low = 0, prior_high = 0;  ///< 5 % and 95 % of the prior
  double mean = 0, sd = 0, low = 0, median = 0, high = 0;              ///< 5 % and 95 % of the posterior
  PriorEdge edge;
};

struct FitOptions {
  std::string method = "posterior";  ///< a name of methods/methods.def
  MethodOptions how;                 ///< of the other methods
  // on the measured pendulum eight times this work moves no mean by a quarter of its deviation
  std::uint32_t particles = 512;         ///< a multiple of 16
  std::uint32_t window = 128;            ///< transitions that moves rerun exactly
  std::uint32_t moves = 32;              ///< per transition, a multiple of 8
  std::function<void(double)> progress;  ///< share done, 0..1; may be empty
};

struct Fit {
  std::vector<ParamSummary> params;
  std::vector<double> samples;        ///< (sample_count x np) equally weighted draws
  std::vector<double> prior_samples;  ///< (sample_count x np) the same before any data
  std::uint32_t sample_count = 0;
  std::vector<double> covariance;  ///< (np x np)
  std::uint32_t particles = 0;
  double effective_samples = 0, noise_scale = 1, exponent = 1;
  double process_scale = 1;  ///< of process_sd, beside noise_scale: see estimate_process_scale
  std::uint64_t transitions = 0, refused = 0, gated = 0;
  bool tested = false;  ///< the model's adequacy: see history.alarm()
  History history;
  std::vector<ResidualTrend> trends;  ///< (ny) of the posterior where it is tested, else empty
  // of a method other than the posterior; noise_scale and exponent are then NaN, the history is empty
  std::string method = "posterior";
  std::vector<MethodIteration> iterations;
  std::uint64_t simulations = 0, diverged = 0;
};

/// Whether the library takes the configuration; a sentence in `error` if not.
bool can_be_fitted(const tiller_config_t& config, std::string& error);

/// (np) The parameters' means.
std::vector<double> means_of(const Fit& fit);

/// The candidate's configuration with its process noise as the fit found it.
Config fitted_config(const Candidate& candidate, const Fit& fit);

/// Learns the candidate's parameters from the stretches, one after the other, through the runtime's posterior; the
/// state estimate begins anew with each. With the filter engine the share of process noise is learnt too, from one fit
/// to the next, at most three. False with a sentence in `error`.
bool fit(const Candidate& candidate, const std::vector<Stretch>& stretches, const FitOptions& options, Fit& result,
         std::string& error);

}  // namespace tiller::tools
