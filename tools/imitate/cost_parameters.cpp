#include "tools/imitate/cost_parameters.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/tune/number_edit.hpp"

namespace tiller::tools::imitate {
namespace {

/// The learnt term's place in theta, or zero and the file's weight.
void multiplied_by(const std::vector<CostTerm>& learnt, CostTerm::Kind kind, double weight, int part,
                   CostTarget& target) {
  const auto found = std::find_if(learnt.begin(), learnt.end(), [&](const CostTerm& term) {
    return term.kind == kind && term.index == target.state;
  });
  target.of[part] = found == learnt.end() ? 0 : 1 + (found - learnt.begin());
  target.kept[part] = found == learnt.end() ? weight : 1;
}

}  // namespace

bool cost_target(const RobotFile& robot, const std::string& text, const std::vector<CostTerm>& learnt,
                 const std::string& state, CostTarget& target, std::string& error) {
  const tiller_cost_config_t& cost = robot.config.cost;
  const int index = index_of(robot.states, state);
  if (index < 0) {
    const std::string near = nearest(state, robot.states);
    error = "--target " + state + ": is no state; " + (near.empty() ? "" : "did you mean " + near + "? ") +
            "there: " + join(robot.states);
    return false;
  }
  const auto i = static_cast<std::uint32_t>(index);
  target.state = i;
  target.key = "cost.target." + state;
  target.value = cost.target[i];
  target.angle = robot.model->angle_mask >> i & 1u;
  tune::NumberAt at;
  if (!tune::find_number(text, target.key, at, error)) {
    error = target.key + ": is no number in the file; write the one that the search is to begin at";
    return false;
  }
  multiplied_by(learnt, CostTerm::state, cost.state_weight[i], 0, target);
  multiplied_by(learnt, CostTerm::terminal, cost.terminal_weight[i], 1, target);
  if (target.kept[0] > 0 || target.kept[1] > 0) return true;
  error = target.key + ": the state has no weight, so that its target says nothing; give it a state_weight";
  return false;
}

double CostParameters::weight(const CostTarget& target, int part, const Vector& theta) const {
  return target.kept[part] * std::exp(theta(target.of[part])) * target.unit;
}

Vector CostParameters::coefficient(const Vector& theta) const {
  Vector c = rate(theta);
  for (std::size_t t = 0; t < targets_.size(); ++t) {
    const auto at = static_cast<Eigen::Index>(t);
    c.segment(weights_ + 2 * at, 2) *= theta(weights_ + at);
  }
  return c;
}

Vector CostParameters::rate(const Vector& theta) const {
  Vector r(groups());
  r.head(weights_) = theta.head(weights_).array().exp();
  for (std::size_t t = 0; t < targets_.size(); ++t)
    for (int part = 0; part < 2; ++part)
      r(weights_ + 2 * static_cast<Eigen::Index>(t) + part) = weight(targets_[t], part, theta);
  return r;
}

Matrix CostParameters::chain(const Vector& theta) const {
  Matrix j = Matrix::Zero(groups(), size());
  j.topLeftCorner(weights_, weights_).setIdentity();
  for (std::size_t t = 0; t < targets_.size(); ++t)
    for (int part = 0; part < 2; ++part) {
      const Eigen::Index at = static_cast<Eigen::Index>(t), row = weights_ + 2 * at + part;
      j(row, weights_ + at) = 1;
      j(row, targets_[t].of[part]) = theta(weights_ + at);
    }
  return j;
}

}  // namespace tiller::tools::imitate
