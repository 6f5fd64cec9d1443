#pragma once

#include "tools/local_models/linear_model.hpp"

namespace tiller::tools::local {

struct AdaptiveOptions {
  double period_memory = 10;  ///< periods after which a transition counts 1/e
  double strength =
      1;             ///< of the prior's slopes, in transitions: more than period_memory where the loop excites little
  Vector spread;     ///< (nx + nu) deviation of [x; u] that the prior takes the model's slope to hold for
  Vector noise;      ///< (nx) deviation of a step that the prior expects
  int horizon = 10;  ///< periods of the plan
  Matrix state_weight, input_weight, terminal_weight;
  Vector target, low, high;  ///< (nx), (nu), (nu)
  bool adapt = true;         ///< false: the physics alone
};

/// Model predictive control on a linear model that is fitted anew in each period (Fu, Levine and Abbeel 2016, "One-shot
/// learning of manipulation skills with online dynamics adaptation"): a normal-inverse-Wishart prior whose mean is the
/// physics' derivative at the present state, and the mean and covariance of the last transitions, forgotten
/// exponentially. The plan is an LQR of a short horizon on that model, about the target and the command that holds it
/// best; its first command is cut to the limits. The memory is one mean and one covariance, whatever the run's length.
/// Cost of a period: O((nx + nu)^3 + horizon nx^3).
class AdaptiveLqr {
 public:
  AdaptiveLqr(policy::PhysicsStep physics, const AdaptiveOptions& options);

  /// The command at state x.
  Vector command(const Vector& x);
  /// Takes in what `command` u at x led to.
  void learn(const Vector& x, const Vector& u, const Vector& next);
  /// The model in use at (x, u).
  LinearStep model(const Vector& x, const Vector& u) const;

 private:
  policy::PhysicsStep physics_;
  AdaptiveOptions options_;
  TransitionMoments data_;
  Vector last_command_;
};

}  // namespace tiller::tools::local
