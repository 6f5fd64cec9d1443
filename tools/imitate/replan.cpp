#include "tools/imitate/replan.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

constexpr int kTries = 12;  // step lengths 1, 1/2, ... side by side

/// Inputs and states of all step lengths at once, by the policy's feedback around the motion.
std::vector<Motion> roll_tries(const Scene& scene, const tiller_config_t& cost, const Motion& around,
                               const Policy& policy) {
  const std::uint32_t nx = scene.nx(), nu = scene.nu();
  std::vector<Motion> tries(kTries, around);
  Matrix x = around.state.col(0).replicate(1, kTries), before = around.input.col(0).replicate(1, kTries), u(nu, kTries);
  for (Eigen::Index k = 0; k < around.steps(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    const Eigen::Index n = policy.gain[at].cols();
    for (int j = 0; j < kTries; ++j) {
      Vector off(n);
      off.head(nx) = scene.difference(x.col(j), around.state.col(k));
      if (n > nx) off.tail(nu) = before.col(j) - around.input.col(std::max<Eigen::Index>(k - 1, 0));
      u.col(j) = around.input.col(k) + std::ldexp(1.0, -j) * policy.wish[at] + policy.gain[at] * off;
      for (std::uint32_t i = 0; i < nu; ++i)
        u(i, j) = std::clamp(u(i, j), cost.safety.input_low[i], cost.safety.input_high[i]);
      tries[static_cast<std::size_t>(j)].input.col(k) = u.col(j);
    }
    x = scene.step(x, u);
    before = u;
    for (int j = 0; j < kTries; ++j) tries[static_cast<std::size_t>(j)].state.col(k + 1) = x.col(j);
  }
  return tries;
}

}  // namespace

Motion replan(const Scene& scene, const tiller_config_t& cost, const Vector& start, const Matrix& guess,
              const ReplanOptions& options, double* value) {
  Motion best{scene.roll(start, guess), guess};
  double now = scene.cost(cost, best.state, best.input);
  ExpandOptions how;
  how.limit_share = 1e-12;
  for (int i = 0; i < options.iterations; ++i) {
    const Expansion e = expand(scene, best, cost, {}, how);
    const Policy policy = policy_along(e, Vector::Ones(1), true);
    if (policy.gain.empty()) break;
    const std::vector<Motion> tries = roll_tries(scene, cost, best, policy);
    double least = now;
    const Motion* chosen = nullptr;
    for (const Motion& t : tries) {
      const double c = t.state.allFinite() ? scene.cost(cost, t.state, t.input) : INFINITY;
      if (c < least) least = c, chosen = &t;
    }
    if (!chosen) break;
    best = *chosen;
    const double gained = now - least;
    now = least;
    if (gained <= options.tolerance * std::fabs(now)) break;
  }
  if (value) *value = now;
  return best;
}

Motion recede(const Scene& scene, const tiller_config_t& cost, const Vector& start, const Matrix& guess,
              Eigen::Index steps) {
  Motion motion{Matrix(scene.nx(), steps + 1), Matrix(scene.nu(), steps)};
  motion.state.col(0) = start;
  Matrix plan = guess;
  ReplanOptions options;
  for (Eigen::Index k = 0; k < steps; ++k) {
    options.iterations = k == 0 ? 200 : 10;
    plan = replan(scene, cost, motion.state.col(k), plan, options).input;
    motion.input.col(k) = plan.col(0);
    motion.state.col(k + 1) = scene.step(motion.state.col(k), plan.col(0));
    const Eigen::Index last = plan.cols() - 1;
    plan.leftCols(last) = plan.rightCols(last).eval();
  }
  return motion;
}

}  // namespace tiller::tools::imitate
