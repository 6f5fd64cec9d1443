#pragma once

#include <vector>

#include "tools/local_models/linear_model.hpp"

namespace tiller::tools::local {

/// u = gain x + offset + noise of covariance `noise`, a law for one time step.
struct LinearLaw {
  Matrix gain;    ///< (nu x nx)
  Vector offset;  ///< (nu)
  Matrix noise;   ///< (nu x nu)

  Vector mean(const Vector& x) const { return gain * x + offset; }
};
using LawSequence = std::vector<LinearLaw>;

/// Cost of one step, 1/2 z' hessian z + slope' z, z = [x; u]; of the last state, without u. Hessians are symmetric and
/// positive semidefinite.
struct QuadraticCost {
  Matrix hessian;
  Vector slope;
};

/// Mean and covariance of [x; u] at each step, and of the last x.
struct Passage {
  std::vector<Vector> mean;
  std::vector<Matrix> covariance;
};

/// What the laws make of the models from a normal start.
Passage pass(const std::vector<LinearStep>& models, const LawSequence& laws, const Vector& start_mean,
             const Matrix& start_covariance);
/// Expected cost along it, up to the costs' constants.
double expected_cost(const std::vector<QuadraticCost>& costs, const Passage& passage);
/// Sum over the steps of E_x KL(now(u | x) || before(u | x)).
double divergence(const LawSequence& now, const LawSequence& before, const Passage& of_now);

/// The laws of least E[cost] / eta - entropy + E[-log before(u | x)]: an LQR of the cost over eta and the law before,
/// whose noise is the inverse of its curvature in u (maximum entropy: Levine and Abbeel 2014, section 3). `costs` has a
/// row more than `models`. False where a curvature is not positive definite: raise eta.
bool soft_lqr(const std::vector<LinearStep>& models, const std::vector<QuadraticCost>& costs, const LawSequence& before,
              double eta, LawSequence& laws);

struct KlStep {
  double eta = 0;  ///< dual variable
  double divergence = 0, cost = 0;
};

/// The laws of least expected cost within a divergence of `epsilon`, over all steps, from `before`: eta by bracketing,
/// as the divergence falls with it. False where no eta up to 1e12 serves.
bool kl_lqr(const std::vector<LinearStep>& models, const std::vector<QuadraticCost>& costs, const LawSequence& before,
            const Vector& start_mean, const Matrix& start_covariance, double epsilon, LawSequence& laws, KlStep& step);

}  // namespace tiller::tools::local
