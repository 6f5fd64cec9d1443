// Approximate Bayesian computation: abc, abc_regression.
#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/base/text.hpp"
#include "tools/identify/candidates.hpp"
#include "tools/identify/coordinates.hpp"
#include "tools/identify/method_list.hpp"
#include "tools/identify/regression_adjustment.hpp"
#include "tools/identify/statistics.hpp"

namespace tiller::tools {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Prior draws with what was simulated of them.
struct Simulated {
  std::size_t count = 0;
  std::vector<double> v, statistic;      // (count x d)
  std::vector<double> observed, spread;  // (d); spread: median absolute deviation under the prior
  std::vector<double> distance;          // (count); infinity: diverged
  std::vector<std::size_t> accepted;     // by distance
  double epsilon = 0;
};

void measure_spread(std::size_t d, Simulated& all) {
  for (std::size_t j = 0; j < d; ++j) {
    std::vector<double> values;
    for (std::size_t s = 0; s < all.count; ++s)
      if (std::isfinite(all.statistic[s * d + j])) values.push_back(all.statistic[s * d + j]);
    const double middle = median(values);
    for (double& value : values) value = std::fabs(value - middle);
    all.spread.push_back(median(std::move(values)));
  }
}

// Root of the mean square of the differences over their spreads: 1 is a draw from the prior, about.
void measure_distance(std::size_t d, Simulated& all) {
  all.distance.assign(all.count, kInfinity);
  for (std::size_t s = 0; s < all.count; ++s) {
    double square = 0;
    for (std::size_t j = 0; j < d; ++j) {
      if (!std::isfinite(all.statistic[s * d + j])) square = kInfinity;
      if (!(all.spread[j] > 0)) continue;  // a statistic that no candidate moves tells nothing
      const double z = (all.statistic[s * d + j] - all.observed[j]) / all.spread[j];
      square += z * z;
    }
    const double distance = std::sqrt(square / static_cast<double>(d));
    if (std::isfinite(distance)) all.distance[s] = distance;
  }
}

bool accept(const MethodProblem& problem, std::size_t least, Simulated& all, std::string& error) {
  std::vector<std::size_t> order;
  for (std::size_t s = 0; s < all.count; ++s)
    if (std::isfinite(all.distance[s])) order.push_back(s);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return all.distance[a] < all.distance[b] || (all.distance[a] == all.distance[b] && a < b);
  });
  const double share = problem.options.accept * static_cast<double>(all.count);
  const std::size_t wanted = std::min(order.size(), static_cast<std::size_t>(std::max(1.0, std::round(share))));
  const bool given = std::isfinite(problem.options.epsilon);
  if (!order.empty()) all.epsilon = given ? problem.options.epsilon : all.distance[order[wanted - 1]];
  for (const std::size_t s : order)
    if (all.distance[s] <= all.epsilon) all.accepted.push_back(s);
  if (all.accepted.size() >= least) return true;
  error =
      format("%zu of %zu simulations were accepted, at least %zu are needed; ", all.accepted.size(), all.count, least);
  if (order.empty())
    error += "none stayed finite: narrow the priors or raise substeps";
  else
    error += format("the nearest lies at %.3g, one in a hundred within %.3g: raise --epsilon or --simulations",
                    all.distance[order.front()], all.distance[order[order.size() / 100]]);
  return false;
}

bool refuse(const MethodProblem& problem, std::string& error) {
  if (!every_state_measured(*problem.config)) {
    error = "ABC simulates changes from measured states, and not every state has a sensor; use posterior or simopt";
    return true;
  }
  return refuse_hidden_states(problem, error);
}

bool simulate(const MethodProblem& problem, const Coordinates& coordinates, std::size_t least, Simulated& all,
              MethodResult& result, std::string& error) {
  if (refuse(problem, error)) return false;
  std::vector<Episode> episodes;
  if (!make_episodes(problem, episodes, error)) return false;
  const std::size_t d = coordinates.count();
  all.count = problem.options.simulations;
  all.v.resize(all.count * d);
  for (std::size_t s = 0; s < all.count; ++s) coordinates.draw(s, all.v.data() + s * d);
  Statistics statistics(problem, coordinates, episodes);
  all.observed = statistics.observed();
  all.statistic = statistics.simulate(all.v, all.count, problem.options.progress);
  measure_spread(d, all);
  measure_distance(d, all);
  result.simulations = all.count;
  result.transitions = statistics.transitions();
  result.diverged = static_cast<std::uint64_t>(std::count(all.distance.begin(), all.distance.end(), kInfinity));
  return accept(problem, least, all, error);
}

// The result from coordinates (accepted x d) and their weights.
void conclude(const MethodProblem& problem, const Coordinates& coordinates, const Simulated& all,
              const std::vector<double>& v, MethodResult& result) {
  const std::size_t np = problem.config->param_count, d = coordinates.count(), count = result.weight.size();
  double sum = 0;
  for (const double w : result.weight) sum += w;
  for (double& w : result.weight) w /= sum;
  result.params.resize(count * np);
  for (std::size_t s = 0; s < count; ++s) coordinates.to_params(v.data() + s * d, result.params.data() + s * np);
  MethodIteration iteration;
  weighted_moments(result.params, result.weight, np, iteration);
  iteration.effective_samples = result.effective_samples = effective_samples(result.weight);
  iteration.discrepancy = all.epsilon;
  iteration.best = all.distance[all.accepted.front()];
  result.history.push_back(std::move(iteration));
}

std::vector<double> take(const Simulated& all, const std::vector<double>& rows, std::size_t d) {
  std::vector<double> taken;
  for (const std::size_t s : all.accepted)
    for (std::size_t j = 0; j < d; ++j) taken.push_back(rows[s * d + j]);
  return taken;
}

// The draws v (accepted x d), adjusted.
void adjust(const Coordinates& coordinates, const Simulated& all, const std::vector<double>& weight,
            std::vector<double>& v) {
  const auto d = static_cast<Eigen::Index>(coordinates.count()), n = static_cast<Eigen::Index>(weight.size());
  Eigen::MatrixXd off(n, d), rows(n, d);
  std::vector<CoordinateBounds> bounds;
  for (std::uint32_t j = 0; j < coordinates.count(); ++j) bounds.push_back({coordinates.low(j), coordinates.high(j)});
  for (Eigen::Index s = 0; s < n; ++s) {
    const std::size_t from = all.accepted[static_cast<std::size_t>(s)];
    for (Eigen::Index j = 0; j < d; ++j) {
      const auto c = static_cast<std::size_t>(j);
      const double spread = all.spread[c] > 0 ? all.spread[c] : 1.0;
      off(s, j) = (all.statistic[from * coordinates.count() + c] - all.observed[c]) / spread;
      rows(s, j) = v[static_cast<std::size_t>(s * d + j)];
    }
  }
  adjust_by_regression(off, Eigen::Map<const Eigen::VectorXd>(weight.data(), n), bounds, rows);
  for (Eigen::Index s = 0; s < n; ++s)
    for (Eigen::Index j = 0; j < d; ++j) v[static_cast<std::size_t>(s * d + j)] = rows(s, j);
}

}  // namespace

bool run_abc(const MethodProblem& problem, MethodResult& result, std::string& error) {
  result = {};
  const Coordinates coordinates(*problem.config);
  Simulated all;
  if (!simulate(problem, coordinates, 2, all, result, error)) return false;
  result.weight.assign(all.accepted.size(), 1.0);
  conclude(problem, coordinates, all, take(all, all.v, coordinates.count()), result);
  return true;
}

bool run_abc_regression(const MethodProblem& problem, MethodResult& result, std::string& error) {
  result = {};
  const Coordinates coordinates(*problem.config);
  Simulated all;
  if (!simulate(problem, coordinates, coordinates.count() + 3, all, result, error)) return false;
  for (const std::size_t s : all.accepted) {
    const double share = all.distance[s] / all.epsilon;  // Epanechnikov, without its constant
    result.weight.push_back(std::max(0.0, 1 - share * share));
  }
  std::vector<double> v = take(all, all.v, coordinates.count());
  adjust(coordinates, all, result.weight, v);
  conclude(problem, coordinates, all, v, result);
  return true;
}

}  // namespace tiller::tools
