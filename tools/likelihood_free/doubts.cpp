#include "tools/likelihood_free/doubts.hpp"

#include <cmath>

#include "tools/likelihood_free/draws.hpp"
#include "tools/robot/prior_edge.hpp"

namespace tiller::tools {
namespace {

constexpr int kChecked = 40;        // draws that are simulated once more
constexpr double kUnlike = 4.0;     // of a channel, in deviations of its simulations
constexpr double kAsWide = 0.9;     // of the prior's deviation
constexpr double kLayer = 0.02;     // of the prior's range, next to a bound
constexpr double kAsCentred = 0.3;  // prior deviations between the means

std::string name_of(const Words& names, std::size_t i, const char* kind) {
  return i < names.size() ? names[i] : format("%s %zu", kind, i + 1);
}

std::vector<double> column_of(const MethodResult& found, std::size_t np, std::size_t i) {
  std::vector<double> values;
  for (std::size_t k = 0; k < found.count(); ++k) values.push_back(found.params[k * np + i]);
  return values;
}

void add_edges(const InferenceProblem& problem, Inferred& result) {
  const tiller_config_t& config = *problem.config;
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    const std::string name = name_of(problem.names, i, "parameter");
    const bool physical = config.model && i < problem.names.size();
    const PhysicalRange range = physical ? physical_range(config, problem.names, i) : PhysicalRange{};
    const PriorEdge edge =
        find_prior_edge(config.priors[i], range, column_of(result.found, config.param_count, i), result.found.weight);
    if (edge.side != EdgeSide::none && (edge.at_bound || !config.prior_mixture))
      result.warnings.push_back(edge_text(name, edge));
  }
}

/// A joint prior is what earlier logs told: that another log adds little to it is no doubt.
void add_uninformed(const InferenceProblem& problem, const Coordinates& coordinates, Inferred& result) {
  if (problem.config->prior_mixture) return;
  const std::size_t np = problem.config->param_count;
  for (std::uint32_t j = 0; j < coordinates.count(); ++j) {
    const std::vector<double> values = column_of(result.found, np, coordinates.param(j));
    double mean = 0.0, square = 0.0;
    for (std::size_t k = 0; k < values.size(); ++k) {
      const double v = coordinates.coordinate(j, values[k]);
      mean += result.found.weight[k] * v, square += result.found.weight[k] * v * v;
    }
    const double prior_sd = coordinates.sd(j), share = std::sqrt(std::max(0.0, square - mean * mean)) / prior_sd;
    if (share < kAsWide || std::fabs(mean - coordinates.mean(j)) > kAsCentred * prior_sd) continue;
    result.warnings.push_back(format(
        "%s: as wide as its prior (%.2f of the deviation): seen through the summary %s, the logs tell nothing "
        "of it; try another --summary, or logs in which it acts",
        name_of(problem.names, coordinates.param(j), "parameter").c_str(), share, problem.options.summary.c_str()));
  }
}

/// Where nothing fits, a prior that leaves the truth out is the first thing to look at: the posterior then is a thin
/// layer at its bound, which need not rise towards it.
void add_layers(const InferenceProblem& problem, const Coordinates& coordinates, Inferred& result) {
  for (std::uint32_t j = 0; j < coordinates.count(); ++j) {
    const std::size_t i = coordinates.param(j);
    const double low = coordinates.low(j), high = coordinates.high(j), range = high - low;
    double mean = 0.0;
    const std::vector<double> values = column_of(result.found, problem.config->param_count, i);
    for (std::size_t k = 0; k < values.size(); ++k)
      mean += result.found.weight[k] * coordinates.coordinate(j, values[k]);
    if (!std::isfinite(range) || (mean > low + kLayer * range && mean < high - kLayer * range)) continue;
    result.warnings.push_back(name_of(problem.names, i, "parameter") + " at the edge of its prior, " +
                              format("%.4g", coordinates.value(j, mean < 0.5 * (low + high) ? low : high)) +
                              ": the prior may leave the truth out; widen it");
  }
}

/// Systematic: kChecked equally weighted coordinates of the result.
Matrix chosen(const MethodResult& found, const Coordinates& coordinates, std::size_t np) {
  Matrix v(coordinates.count(), kChecked);
  double below = 0.0;
  std::size_t s = 0;
  for (int k = 0; k < kChecked; ++k) {
    while (s + 1 < found.count() && below + found.weight[s] < (k + 0.5) / kChecked) below += found.weight[s++];
    for (std::uint32_t j = 0; j < coordinates.count(); ++j)
      v(j, k) = coordinates.coordinate(j, found.params[s * np + coordinates.param(j)]);
  }
  return v;
}

/// Of each channel, the logs' distance from the simulations' mean over the simulations' deviation, root mean square.
Vector unlikeness(const std::vector<Trajectory>& all, const Trajectory& observed) {
  const Eigen::Index ny = observed[0].rows();
  const double n = static_cast<double>(all.size());
  Vector distance = Vector::Zero(ny), variance = Vector::Zero(ny), size = Vector::Zero(ny);
  for (std::size_t p = 0; p < observed.size(); ++p) {
    Matrix mean = Matrix::Zero(ny, observed[p].cols()), square = mean;
    for (const Trajectory& one : all) mean += one[p] / n;
    for (const Trajectory& one : all) square += (one[p] - mean).cwiseAbs2() / (n - 1);
    distance += (observed[p] - mean).rowwise().squaredNorm();
    variance += square.rowwise().sum();
    size += observed[p].rowwise().squaredNorm();
  }
  // a channel without any noise: rounding is no doubt
  return (distance.array() / (variance.array() + 1e-18 * size.array() + 1e-300)).sqrt();
}

}  // namespace

bool add_doubts(const InferenceProblem& problem, Inferred& result, std::string& error) {
  const Coordinates coordinates(*problem.config);
  add_edges(problem, result);
  add_uninformed(problem, coordinates, result);
  InferenceProblem quiet = problem;
  quiet.options.progress = nullptr;
  DrawMaker maker(quiet, coordinates);
  Draws draws;
  std::string failure;
  if (!maker.simulate(chosen(result.found, coordinates, problem.config->param_count), draws, failure)) {
    error = failure;
    return maker.failed() > 0;  // all failed: the method has told
  }
  result.found.simulations += maker.simulations();
  if (draws.count() < kChecked / 2) return true;
  const Vector far = unlikeness(draws.trajectory, maker.observed());
  const std::size_t before = result.warnings.size();
  for (Eigen::Index i = 0; i < far.size(); ++i)
    if (far(i) > kUnlike)
      result.warnings.push_back(
          format("%s: the logs lie %.1f deviations from what the posterior's simulations show (1 is expected): the "
                 "simulator explains them poorly; compare units, signs and times, the noise in the file, and what the "
                 "simulator leaves out",
                 name_of(problem.measured, static_cast<std::size_t>(i), "measurement").c_str(), far(i)));
  if (result.warnings.size() > before) add_layers(problem, coordinates, result);
  return true;
}

}  // namespace tiller::tools
