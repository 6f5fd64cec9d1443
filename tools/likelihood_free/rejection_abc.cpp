// Rejection ABC on a black box (Pritchard et al. 1999), and its correction by local-linear regression (Beaumont, Zhang,
// Balding 2002).

#include <algorithm>
#include <cmath>

#include "tools/identify/regression_adjustment.hpp"
#include "tools/likelihood_free/distances.hpp"
#include "tools/likelihood_free/proposal.hpp"

namespace tiller::tools {
namespace {

bool run(const InferenceProblem& problem, bool adjusted, Inferred& result, std::string& error) {
  result = {};
  const Coordinates coordinates(*problem.config);
  DrawMaker maker(problem, coordinates);
  const Proposal prior(*problem.config);
  Draws draws;
  if (!maker.simulate(prior.draw(problem.config->seed, 0, problem.options.simulations), draws, error)) return false;
  const Distances distances(problem.options.summary, problem.pieces, draws, maker.observed());
  const Vector distance = distances.of_learnt();
  const auto kept = static_cast<std::size_t>(std::round(problem.options.accept * problem.options.simulations));
  const std::size_t least = coordinates.count() + 3;
  if (std::min<std::size_t>(kept, static_cast<std::size_t>(draws.count())) < least) {
    error = format("%zu draws would be kept, and %zu are needed; raise --simulations or --accept", kept, least);
    return false;
  }
  const std::vector<Eigen::Index> nearest = nearest_of(distance, kept);
  const double epsilon = distance(nearest.back());
  Draws near = draws.at(nearest);
  Vector weight = Vector::Ones(near.count());
  if (adjusted) {
    for (std::size_t k = 0; k < nearest.size(); ++k)  // Epanechnikov, without its constant
      weight(static_cast<Eigen::Index>(k)) = 1.0 - std::pow(distance(nearest[k]) / (1.0001 * epsilon), 2);
    std::vector<CoordinateBounds> bounds;
    for (std::uint32_t j = 0; j < coordinates.count(); ++j) bounds.push_back({coordinates.low(j), coordinates.high(j)});
    Matrix rows = near.v.transpose();
    adjust_by_regression(distances.off()(Eigen::all, nearest).transpose(), weight, bounds, rows);
    near.v = rows.transpose();
  }
  result.found.history.push_back(iteration_of(coordinates, problem.config->param_count, near.v, weight));
  result.found.history.back().discrepancy = epsilon;
  result.found.history.back().best = distance(nearest.front());
  result.found.simulations = maker.simulations();
  result.found.diverged = maker.failed();
  if (maker.failed() > 0) result.warnings.push_back(maker.failure_text());
  conclude(problem, coordinates, near.v, weight, result);
  return true;
}

}  // namespace

bool run_rejection_abc(const InferenceProblem& problem, Inferred& result, std::string& error) {
  return run(problem, false, result, error);
}
bool run_rejection_abc_adjusted(const InferenceProblem& problem, Inferred& result, std::string& error) {
  return run(problem, true, result, error);
}

}  // namespace tiller::tools
