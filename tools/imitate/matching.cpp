#include "tools/imitate/matching.hpp"

#include <algorithm>
#include <cmath>

#include "tools/imitate/replan.hpp"

namespace tiller::tools::imitate {
namespace {

class Matching {
 public:
  Matching(const Scene& scene, const std::vector<Motion>& motions, const std::vector<CostTerm>& learnt,
           const MatchingOptions& options)
      : scene_(scene), motions_(motions), learnt_(learnt), options_(options) {
    CostEdit kept(scene.config);
    for (const CostTerm& term : learnt) kept.set(term, 0);
    features_.push_back(kept);
    for (const CostTerm& term : learnt) {
      CostEdit one(scene.config);
      one.clear();
      one.set(term, 1);
      features_.push_back(one);
    }
  }

  Vector mean(const std::vector<Motion>& motions) const {
    Vector sum = Vector::Zero(static_cast<Eigen::Index>(features_.size()));
    for (const Motion& m : motions)
      for (std::size_t g = 0; g < features_.size(); ++g)
        sum(static_cast<Eigen::Index>(g)) += scene_.cost(features_[g].get(), m.state, m.input);
    return sum / static_cast<double>(motions.size());
  }

  /// Relative to what is kept, within a factor of a million of the file's.
  std::vector<double> weights(const Vector& w) const {
    std::vector<double> value;
    for (std::size_t i = 0; i < learnt_.size(); ++i) {
      const double relative = w(static_cast<Eigen::Index>(i) + 1) / std::max(w(0), 1e-300);
      value.push_back(std::clamp(relative, 1e-6 * learnt_[i].value, 1e6 * learnt_[i].value));
    }
    return value;
  }

  Vector plan(const Vector& w) {
    CostEdit cost(scene_.config);
    const std::vector<double> value = weights(w);
    for (std::size_t i = 0; i < learnt_.size(); ++i) cost.set(learnt_[i], value[i]);
    std::vector<Motion> planned;
    for (const Motion& m : motions_) {
      const Vector start = m.state.col(0);
      planned.push_back(options_.horizon == 0
                            ? replan(scene_, cost.get(), start, m.input)
                            : recede(scene_, cost.get(), start, m.input.leftCols(options_.horizon), m.steps()));
    }
    return mean(planned);
  }

 private:
  const Scene& scene_;
  const std::vector<Motion>& motions_;
  const std::vector<CostTerm>& learnt_;
  const MatchingOptions& options_;
  std::vector<CostEdit> features_;
};

std::vector<double> list(const Vector& v) { return {v.data(), v.data() + v.size()}; }

}  // namespace

MatchingFit fit_matching(const Scene& scene, const std::vector<Motion>& motions, const std::vector<CostTerm>& learnt,
                         const MatchingOptions& options) {
  Matching matching(scene, motions, learnt, options);
  Game game;
  game.demonstrated = matching.mean(motions);
  game.best = [&](const Vector& w) { return matching.plan(w); };
  Vector scale = game.demonstrated;
  for (double& s : scale)
    if (!(s > 1e-9 * scale.maxCoeff())) s = 1e9 * scale.maxCoeff();  // of no say
  const Equilibrium e = multiplicative_weights(game, scale, options.rounds);
  MatchingFit fit;
  fit.value = matching.weights(e.weight);
  fit.demonstrated = list(game.demonstrated);
  Vector made = Vector::Zero(game.demonstrated.size());
  for (std::size_t j = 0; j < e.policies.size(); ++j) made += e.share[j] * e.policies[j];
  fit.made = list(made);
  fit.excess = e.value;
  fit.bound = e.bound;
  return fit;
}

}  // namespace tiller::tools::imitate
