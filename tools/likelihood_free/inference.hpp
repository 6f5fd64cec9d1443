#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tools/base/text.hpp"
#include "tools/identify/method.hpp"

namespace tiller::tools {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// A stretch of the logs that simulations are compared with.
struct Piece {
  Vector start;     ///< (ny) measured where it begins
  Matrix input;     ///< (nu x periods) held over each
  Matrix measured;  ///< (ny x periods) at the end of each
};

/// What is simulated of one parameter vector: a matrix as Piece::measured for each piece. Empty: it failed.
using Trajectory = std::vector<Matrix>;

/// A parameter vector that is to be simulated.
struct Ask {
  Vector params;       ///< (np)
  Matrix start;        ///< (ny x pieces)
  std::uint64_t seed;  ///< below 2^53
};
struct Simulated {
  Trajectory measured;  ///< empty: it failed
  std::string failure;  ///< why
};

/// A black box: answers in the order of `asks`. False with a sentence in `error` where it cannot go on at all.
using Simulator =
    std::function<bool(const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string& error)>;

struct InferenceOptions {
  std::string method = "bayes_sim";      ///< a name of inference_methods()
  std::string summary = "linear";        ///< a name of summary_names(); "recurrent" with bayes_sim alone
  std::uint32_t simulations = 5000;      ///< parameter vectors in all
  std::uint32_t rounds = 5;              ///< of bayes_sim
  std::uint32_t components = 3;          ///< of its mixture
  double accept = 0.01;                  ///< share that abc and abc_regression keep
  std::uint32_t particles = 200;         ///< of smc_abc
  std::function<void(double)> progress;  ///< share done, 0..1; may be empty
};

/// Parameters of a black box from logs: only the priors, names and seed of the configuration are read, never its
/// model's equations.
struct InferenceProblem {
  const tiller_config_t* config = nullptr;
  std::vector<Piece> pieces;     ///< at least one
  std::vector<double> noise_sd;  ///< (ny) of the sensors: added to what is simulated, and drawn at its start
  Simulator simulate;
  Words names, measured;  ///< (np), (ny) for warnings; empty: by number
  InferenceOptions options;
};

/// A method's result; the history has an entry for each round (`discrepancy`: the tolerance of ABC, or the loss of the
/// density on draws kept back; `best`: the smallest distance).
struct Inferred {
  MethodResult found;
  Words warnings;  ///< failures and doubts, for the user
};

/// One way to learn without a likelihood.
struct InferenceMethod {
  const char* name;
  const char* help;
  const char* citation;
  const char* caveat;
  bool (*run)(const InferenceProblem& problem, Inferred& result, std::string& error);
};
const std::vector<InferenceMethod>& inference_methods();
const InferenceMethod* find_inference_method(const std::string& name);

/// Runs options.method and looks for doubts (doubts.hpp). False with a sentence in `error`. Same problem, same bits.
bool infer(const InferenceProblem& problem, Inferred& result, std::string& error);

// one for each method
bool run_bayes_sim(const InferenceProblem& problem, Inferred& result, std::string& error);
bool run_smc_abc(const InferenceProblem& problem, Inferred& result, std::string& error);
bool run_rejection_abc(const InferenceProblem& problem, Inferred& result, std::string& error);
bool run_rejection_abc_adjusted(const InferenceProblem& problem, Inferred& result, std::string& error);

}  // namespace tiller::tools
