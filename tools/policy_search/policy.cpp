#include "tools/policy_search/policy.hpp"

#include <algorithm>
#include <cmath>

#include "tools/policy_search/normal_steps.hpp"

namespace tiller::tools::policy {

double Feature::of(const Vector& x) const {
  const double v = x(state);
  return kind == kState ? v : kind == kSine ? std::sin(v) : std::cos(v);
}

std::vector<Feature> all_features(int states, const std::vector<int>& angles) {
  std::vector<Feature> all;
  for (int i = 0; i < states; ++i) all.push_back({Feature::kState, i});
  for (const int angle : angles) {
    all.push_back({Feature::kSine, angle});
    all.push_back({Feature::kCosine, angle});
  }
  return all;
}

std::string feature_name(const Feature& feature, const Words& states) {
  const std::string& name = states[static_cast<std::size_t>(feature.state)];
  return feature.kind == Feature::kState ? name : (feature.kind == Feature::kSine ? "sin " : "cos ") + name;
}

Vector Policy::features_of(const Vector& state) const {
  Vector f(static_cast<Eigen::Index>(features.size()));
  for (std::size_t i = 0; i < features.size(); ++i) f(static_cast<Eigen::Index>(i)) = features[i].of(state);
  return f;
}

Vector Policy::command(const Vector& state) const {
  const Vector f = features_of(state);
  Vector v;
  if (kind == "linear")
    v = weight * f + bias;
  else if (kind == "rbf")
    bump_values(bumps, f, v, nullptr);
  else
    v = net.evaluate(f);
  for (Eigen::Index a = 0; a < v.size(); ++a)
    v(a) = sine ? squash(v(a), low(a), high(a))
                : 0.5 * (low(a) + high(a) + (high(a) - low(a)) * std::min(std::max(v(a), -1.0), 1.0));
  return v;
}

}  // namespace tiller::tools::policy
