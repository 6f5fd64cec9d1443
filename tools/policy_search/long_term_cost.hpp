#pragma once

#include <functional>

#include "tools/policy_search/trainable.hpp"

namespace tiller::tools::policy {

/// One period of a model that is known: next state (nx) and its derivative (nx x (nx + nu)) at a state and commands.
using PhysicsStep = std::function<void(const Vector& x, const Vector& u, Vector& next, Matrix& slope)>;

/// What is to be done, and what is seen of the state.
struct SearchTask {
  int states = 0;
  std::vector<int> angles;         ///< states whose sine and cosine stand in their place
  std::vector<int> policy_inputs;  ///< of all_features(): what the policy sees
  std::vector<int> model_inputs;   ///< of all_features(): what the dynamics depend on, besides the commands
  Vector low, high;                ///< (commands) limits
  Vector start_mean;               ///< (states)
  Matrix start_covariance;
  int horizon = 40;     ///< periods
  Vector target;        ///< (all features)
  Matrix weight;        ///< of the saturating cost, over all features
  PhysicsStep physics;  ///< what the learnt differences come on top of; empty: the state before

  int commands() const { return static_cast<int>(low.size()); }
  int feature_count() const { return states + 2 * static_cast<int>(angles.size()); }
};

/// What a prediction passes through: means (states x horizon + 1), deviations of the same shape, expected costs.
struct Forecast {
  Matrix mean, deviation;
  std::vector<double> cost;
};

/// Expected cost, summed over the horizon's states after the first, when the policy steers the dynamics: the state's
/// distribution is taken for normal at each step, with the exact moments of the step (PILCO: Deisenroth and Rasmussen
/// 2011). The physics' part, if there is one, is linearised about the mean. `gradient` (trainable.count()), if not
/// null, is that with respect to the policy's parameters, by one reverse sweep. Cost: horizon times three times that of
/// bump_moments. Not finite where the prediction runs away.
double long_term_cost(const SearchTask& task, const Bumps& dynamics, Trainable& trainable, const Vector& parameters,
                      Vector* gradient, Forecast* forecast = nullptr);

}  // namespace tiller::tools::policy
