#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// How a method works; each says in docs/theory/methods.md which of these it reads.
struct MethodOptions {
  std::uint32_t simulations = 10000;  ///< in all; SimOpt spends them in equal parts on its iterations
  std::uint32_t iterations = 10;      ///< of SimOpt
  /// Bound of the KL divergence of REPS weights, > 0; NaN: 1, between episodes 1 for each learnt parameter.
  double kl = std::numeric_limits<double>::quiet_NaN();
  double eta = std::numeric_limits<double>::quiet_NaN();      ///< temperature of reps, > 0; NaN: by `kl`
  double epsilon = std::numeric_limits<double>::quiet_NaN();  ///< ABC's tolerance; NaN: by `accept`
  double accept = 0.01;                  ///< share of the simulations that ABC keeps where epsilon is not given
  double rollout_s = 2.0;                ///< length of trajectory_simopt's rollouts; 0: each stretch in one
  double smoothing_s = 0.05;             ///< trajectory_simopt's Gaussian filter over time of errors; 0: none
  std::string discrepancy = "residual";  ///< of SimOpt, or "wasserstein"
  /// Of absolute and of squared errors in a residual discrepancy; NaN: the method's (simopt 0 and 1, trajectory_simopt
  /// 1 and 1).
  double weight_l1 = std::numeric_limits<double>::quiet_NaN(), weight_l2 = weight_l1;
  /// Each channel over its RMS in the logs; without: trajectory_simopt and wasserstein do, simopt does not.
  std::optional<bool> scale;
  std::function<void(double)> progress;  ///< share done, 0..1; may be empty
};

/// The input of a method of the laboratory. The configuration has passed tiller_config_check; its seed names all random
/// numbers.
struct MethodProblem {
  const tiller_config_t* config = nullptr;
  std::vector<std::string> params;           ///< (param_count) names
  const std::vector<Grid>* grids = nullptr;  ///< the logs on a uniform grid
  MethodOptions options;
};

/// Where a method stood after an iteration. NaN: it has no such thing.
struct MethodIteration {
  std::vector<double> mean, sd;                                   ///< (np) of the parameters
  double temperature = std::numeric_limits<double>::quiet_NaN();  ///< eta of REPS
  double kl = std::numeric_limits<double>::quiet_NaN();           ///< of the weights from equal ones
  double effective_samples = 0;
  double discrepancy =
      std::numeric_limits<double>::quiet_NaN();  ///< weighted mean; ABC: the tolerance; reps: minus the log likelihood
  double best = std::numeric_limits<double>::quiet_NaN();  ///< smallest
};

struct MethodResult {
  std::vector<double> params;  ///< (count x np)
  std::vector<double> weight;  ///< (count) sums to one
  std::size_t count() const { return weight.size(); }
  bool gaussian = false;                 ///< the samples are draws from a Gaussian over the coordinates, cut to the
                                         ///< prior's bounds
  std::vector<double> mean, covariance;  ///< (d), (d x d) of that Gaussian
  std::vector<MethodIteration> history;  ///< at least one entry
  double effective_samples = 0;
  std::uint64_t simulations = 0;  ///< parameter vectors tried
  std::uint64_t diverged = 0;     ///< of them not finite: of weight zero
  std::uint64_t transitions = 0;  ///< of the logs that were compared
};

/// One line of methods.def.
struct Method {
  const char* name;
  const char* help;
  const char* citation;
  const char* caveat;
};

const std::vector<Method>& methods();
/// Null if there is none of that name.
const Method* find_method(const std::string& name);
/// "posterior, reps, ...".
std::string method_names();

// ---- what methods share ----

/// 1 / sum of squares of weights that sum to one.
double effective_samples(const std::vector<double>& weight);
/// Fills mean and sd (np) of `iteration` from weighted rows.
void weighted_moments(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np,
                      MethodIteration& iteration);
/// Weighted quantile q of one parameter, linear between samples at the middles of their weights. O(n log n).
double weighted_quantile(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np,
                         std::size_t param, double q);

}  // namespace tiller::tools
