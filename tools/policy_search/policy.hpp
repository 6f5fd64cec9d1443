#pragma once

#include <string>
#include <vector>

#include "tools/base/text.hpp"
#include "tools/nets/mlp.hpp"
#include "tools/policy_search/gp_moments.hpp"

namespace tiller::tools::policy {

/// A number that a policy looks at: a state, or the sine or cosine of one.
struct Feature {
  enum Kind { kState, kSine, kCosine } kind = kState;
  int state = 0;

  double of(const Vector& x) const;
};

/// All states, then sine and cosine of each angle: the order of with_sines().
std::vector<Feature> all_features(int states, const std::vector<int>& angles);

/// A feedback law from the state to the commands, as a file holds it.
///
///     f = features of the state (n)
///     v = weight f + bias                                              linear
///     v_a = sum_i beta_ia exp(-1/2 sum_d ((f_d - x_di) / length_da)^2)  rbf
///     v = the network's output                                         tanh
///     u_a = middle + half v_a, v_a cut to [-1, 1], or squash() of v_a   of the range low to high
struct Policy {
  std::string kind = "linear";  ///< linear, rbf, tanh
  bool sine = true;             ///< squash by the sine; else cut
  Words states, commands;
  std::vector<Feature> features;
  Vector low, high;  ///< (commands)
  double period_s = 0.1;

  Matrix weight;  ///< linear: (commands x features)
  Vector bias;    ///< linear: (commands)
  Bumps bumps;    ///< rbf: signal one, certain
  nets::Mlp net;  ///< tanh

  Vector features_of(const Vector& state) const;
  /// (commands) at the state (states).
  Vector command(const Vector& state) const;
};

/// "position_m", "sin angle_rad".
std::string feature_name(const Feature& feature, const Words& states);

}  // namespace tiller::tools::policy
