#pragma once

// The tasks of Online BayesSim's Table I (Possas et al. 2020) that have a model here, at a declared noise, and episodes
// of them. The true parameters are drawn from the prior, so a posterior's calibration can be judged too.
//
// Statement of a task: model and integrator (semi-implicit Euler, one step of 20 ms: the data come from the very map
// that the estimators know, so its discretisation is no error), prior, excitation, noise, 400 transitions an episode.
// Noise enters the state of every transition, x[k+1] = f(x[k], u[k]; theta) + w, and the next one starts from there:
// all states are measured and the likelihood is exact. Its deviation is sigma times the task's `step_rms`; the
// estimator knows nominal deviations of kNominalSigma times step_rms, and its noise prior is wide enough to leave that
// open.

#include <cstdint>
#include <string>
#include <vector>

#include "core/rng.hpp"
#include "posterior/posterior.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

constexpr double kNominalSigma = 0.03;
constexpr std::uint32_t kEpisodeTicks = 400;
/// Noise levels of the tables.
constexpr double kSigmas[] = {0.01, 0.03, 0.1, 0.3};

/// Input on every channel: clip(amplitude * xi - feedback x), xi uniform on [-1, 1], drawn again every `hold` ticks.
/// The feedback keeps the motion bounded; it is part of the recorded input.
struct Excitation {
  double amplitude = 1.0, limit = 1.0;
  std::uint32_t hold = 8;
  double feedback[TILLER_MAX_STATES] = {};
};

struct AccuracyTask {
  std::string name;
  tiller::Config config;  ///< every state measured; priors: the task's; noise: nominal
  Excitation excitation;
  std::vector<std::uint32_t> inferred;      ///< parameters with a prior
  double step_rms[TILLER_MAX_STATES] = {};  ///< RMS one-step change of each state under prior and excitation, no noise
  double paper_log_density = 0.0;           ///< Online BayesSim's best figure in Table I; 0: none
  double goal_log_density = 0.0;            ///< mean at sigma .03; 0: none
  std::uint32_t states() const { return config.model->state_count; }
  std::uint32_t inputs() const { return config.model->input_count; }
};

/// Two unknowns: cart-pole, pendulum, acrobot masses, acrobot lengths; four: all of the acrobot's.
std::vector<AccuracyTask> accuracy_tasks();

/// Streams of a seed's random numbers: true parameters, inputs, noise of the transitions.
constexpr std::uint32_t kTruthStream = 101, kInputStream = 102, kNoiseStream = 103;

/// (np) the task's parameters, those with a prior drawn from it.
std::vector<double> draw_truth(const AccuracyTask& task, std::uint64_t seed);

/// The excitation of one episode; `task` outlives it.
class Commands {
 public:
  Commands(const AccuracyTask& task, std::uint64_t seed) : task_(task), rng_(seed, kInputStream, 0) {}
  void next(std::uint32_t tick, const double* state, double* u);  ///< state (nx) as it is, u (nu)

 private:
  const AccuracyTask& task_;
  Rng rng_;
  double push_[TILLER_MAX_INPUTS] = {};
};

/// The recording, in double.
struct Episode {
  std::uint32_t ticks = 0, nx = 0, nu = 0;
  std::vector<double> truth;  // (np)
  std::vector<double> state;  // ((ticks + 1) x nx) measured
  std::vector<double> input;  // (ticks x nu)
  Transition transition(std::uint32_t k, double period_s) const;
};

/// One run of the task at `sigma`, all of its randomness from the seed.
Episode make_episode(const AccuracyTask& task, double sigma, std::uint32_t ticks, std::uint64_t seed);

/// A task, prior, noise level and length drawn by the seed: sigma log-uniform on [.003, .5], 20 to 100 ticks, each
/// parameter's prior uniform, normal, log-normal or a normal cut on one side within the task's range.
struct ShortRun {
  AccuracyTask task;
  double sigma;
  Episode episode;
};
ShortRun make_short_run(const std::vector<AccuracyTask>& tasks, std::uint64_t seed);

/// RMS one-step change per state over `draws` of the prior: what step_rms is taken from.
std::vector<double> measure_step_rms(const AccuracyTask& task, std::uint32_t draws);

/// One period of `lanes` parameter vectors (np x lanes) from one state; next (nx x lanes).
void step_lanes(const tiller_config_t& config, const StepSetup& setup, std::uint32_t lanes, const double* state,
                const double* params, const double* input, double* next);

}  // namespace tiller::bench
