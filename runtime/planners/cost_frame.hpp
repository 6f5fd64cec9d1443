#pragma once

#include <algorithm>

#include "rollout/turns.hpp"

namespace tiller {

/// Keeps a planner's cost at the present goal, and in the frame of its belief, whose angles come less whole turns.
class CostFrame {
 public:
  void lay_out(const tiller_config_t& config) {
    cost_ = &config.cost;
    states_ = config.model->state_count;
    angles_ = config.model->angle_mask;
  }
  /// `goal` counts the changes of the configuration's goal. True if it is not that of the call before.
  template <class T>
  bool take_goal(std::uint64_t goal, CostTerms<T>& terms) {
    if (goal == goal_) return false;
    goal_ = goal;
    tiller::take_goal(*cost_, states_, angles_, terms);
    return true;
  }
  /// `origin` (nx; null: zeros). True if it is not that of the call before: a path planned until then has another
  /// frame.
  template <class T>
  bool move_to(const double* origin, CostTerms<T>& terms) {
    const double zero[TILLER_MAX_STATES] = {};
    const double* to = origin ? origin : zero;
    if (std::equal(to, to + states_, origin_)) return false;
    std::copy(to, to + states_, origin_);
    move_cost_terms(*cost_, states_, origin_, terms);
    return true;
  }
  const double* origin() const { return origin_; }
  const tiller_cost_config_t& cost() const { return *cost_; }

 private:
  const tiller_cost_config_t* cost_ = nullptr;
  std::uint32_t states_ = 0, angles_ = 0;
  std::uint64_t goal_ = 0;
  double origin_[TILLER_MAX_STATES] = {};
};

}  // namespace tiller
