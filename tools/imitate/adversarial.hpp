#pragma once

#include <cstdint>
#include <vector>

#include "tools/imitate/expansion.hpp"
#include "tools/nets/adam.hpp"
#include "tools/nets/standardise.hpp"

namespace tiller::tools::imitate {

/// What a network sees of a state: angles as sine and cosine, the rest as it is.
struct Observer {
  explicit Observer(const Scene& scene);
  Matrix of(const Matrix& state) const;  ///< (rows x columns)
  /// (nx x columns) derivatives by the state of what has `by_observed` (rows x columns) by the observed.
  Matrix back(const Matrix& state, const Matrix& by_observed) const;
  std::uint32_t angles = 0;  ///< bits
  Eigen::Index nx = 0, rows = 0;
};

/// A small policy: u = centre + reach (9 sin v + sin 3 v) / 8, v the network's output, within the limits of the inputs:
/// the squash of the runtime's policies (docs/reference/networks.md).
struct SmallPolicy {
  nets::Mlp mlp;
  nets::Standardiser scale;  ///< of the observed
  Vector centre, reach;      ///< (nu)
  Matrix input(const Observer& observer, const Matrix& state) const;
};

struct AdversarialOptions {
  bool wasserstein = false;  ///< a critic with slopes near one in place of GAIL's discriminator
  int iterations = 400;
  int critic_steps = 5;  ///< of each iteration; of a Wasserstein critic twice as many
  int batch = 16;        ///< rollouts of each iteration
  int steps = 60;        ///< periods of a rollout, no more than of the shortest demonstration
  double policy_rate = 1e-3, critic_rate = 3e-3;
  double penalty = 10;      ///< of the critic's slopes (Gulrajani and others 2017); GAIL's is a two-hundredth
  double noise = 0.1;       ///< on both sides' samples, in their deviations: without it the sides part too easily
  bool clone_first = true;  ///< begin at behaviour cloning
  std::uint64_t seed = 1;
};

struct AdversarialFit {
  SmallPolicy policy;
  nets::Mlp critic;
  nets::Standardiser critic_scale;  ///< of the observed with the inputs behind it
  std::vector<double> gap;          ///< (iterations) mean of the critic over the demonstrations less that over rollouts
};

/// The policy that a least-squares fit to the demonstrated inputs makes.
SmallPolicy clone_behaviour(const Scene& scene, const std::vector<Motion>& motions, std::uint64_t seed);

/// Generative adversarial imitation (Ho and Ermon, NIPS 2016) with the policy's gradient through the robot's model
/// (Baram and others, ICML 2017): rollouts from states of the demonstrations, a critic that tells them from the
/// demonstrations, and a policy that follows the critic's slopes. Wasserstein: the critic is the potential of the
/// Kantorovich-Rubinstein dual (Xiao and others 2019). Same seed, same bits.
/// Cost: O(iterations batch steps) model steps and network passes.
AdversarialFit fit_adversarial(const Scene& scene, const std::vector<Motion>& motions,
                               const AdversarialOptions& options);

/// Rollouts (a state matrix (nx x columns) for each of steps + 1 times) of a policy from `start` (nx x columns);
/// `inputs` are its inputs, nullable.
std::vector<Matrix> roll_policy(const Scene& scene, const SmallPolicy& policy, const Matrix& start, int steps,
                                std::vector<Matrix>* inputs = nullptr);

}  // namespace tiller::tools::imitate
