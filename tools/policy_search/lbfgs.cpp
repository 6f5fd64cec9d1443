#include "tools/policy_search/lbfgs.hpp"

#include <cmath>
#include <deque>
#include <limits>

namespace tiller::tools::policy {
namespace {

using Vector = Eigen::VectorXd;

struct Pair {
  Vector step, change;
  double inverse;  // of step . change
};

/// -H g by the two loops over the pairs, oldest first.
Vector direction(const std::deque<Pair>& pairs, const Vector& gradient) {
  Vector q = gradient;
  std::vector<double> alpha(pairs.size());
  for (std::size_t i = pairs.size(); i-- > 0;) {
    alpha[i] = pairs[i].inverse * pairs[i].step.dot(q);
    q -= alpha[i] * pairs[i].change;
  }
  const Pair& last = pairs.back();
  q /= last.inverse * last.change.squaredNorm();
  for (std::size_t i = 0; i < pairs.size(); ++i)
    q += (alpha[i] - pairs[i].inverse * pairs[i].change.dot(q)) * pairs[i].step;
  return -q;
}

struct Point {
  Vector x, gradient;
  double value;
};

class Search {
 public:
  Search(const Objective& objective, const LbfgsOptions& options) : objective_(objective), options_(options) {}

  Point evaluate(Vector x) {
    Point p{std::move(x), Vector(), 0.0};
    p.gradient = Vector::Zero(p.x.size());
    p.value = objective_(p.x, p.gradient);
    ++used_;
    if (!std::isfinite(p.value) || !p.gradient.allFinite()) p.value = std::numeric_limits<double>::infinity();
    return p;
  }

  /// The next point along d, or the same one where none is found.
  Point along(const Point& from, const Vector& d, double step) {
    const double slope = from.gradient.dot(d);
    double low = 0.0, high = std::numeric_limits<double>::infinity();
    Point best = from;
    for (int i = 0; i < 25 && used_ < options_.evaluations; ++i) {
      Point p = evaluate(from.x + step * d);
      if (p.value < best.value) best = p;
      if (!(p.value <= from.value + 1e-4 * step * slope))
        high = step;
      else if (p.gradient.dot(d) < 0.9 * slope)
        low = step;
      else
        return p;
      step = std::isfinite(high) ? 0.5 * (low + high) : 2.0 * low;
    }
    return best;
  }

  int used() const { return used_; }

 private:
  const Objective& objective_;
  const LbfgsOptions& options_;
  int used_ = 0;
};

}  // namespace

LbfgsResult minimise(const Objective& objective, Vector& x, const LbfgsOptions& options) {
  Search search(objective, options);
  Point now = search.evaluate(x);
  std::deque<Pair> pairs;
  std::deque<double> past;
  while (search.used() < options.evaluations && std::isfinite(now.value)) {
    const double steepest = now.gradient.lpNorm<Eigen::Infinity>();
    if (steepest < options.gradient) break;
    Vector d = pairs.empty() ? Vector(-now.gradient) : direction(pairs, now.gradient);
    if (!(d.dot(now.gradient) < 0.0)) {
      pairs.clear();
      d = -now.gradient;
    }
    const Point next = search.along(now, d, pairs.empty() ? options.first_step / now.gradient.norm() : 1.0);
    if (!(next.value < now.value)) {
      if (pairs.empty()) break;
      pairs.clear();  // once more, from steepest descent
      continue;
    }
    const Vector step = next.x - now.x, change = next.gradient - now.gradient;
    if (step.dot(change) > 1e-12 * step.norm() * change.norm()) pairs.push_back({step, change, 1.0 / step.dot(change)});
    if (pairs.size() > static_cast<std::size_t>(options.memory)) pairs.pop_front();
    past.push_back(now.value);
    now = next;
    if (past.size() <= 5) continue;
    if (past.front() - now.value < options.decrease * std::abs(now.value)) break;
    past.pop_front();
  }
  x = now.x;
  return {now.value, search.used()};
}

}  // namespace tiller::tools::policy
