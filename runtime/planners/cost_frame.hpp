#pragma once

#include <algorithm>

#include "planners/planner.hpp"
#include "rollout/turns.hpp"

namespace tiller {

/// Keeps a planner's cost at the present goal, and in the frame of its belief, whose angles come less whole turns.
class CostFrame {
 public:
  void lay_out(const tiller_config_t& config) {
    cost_ = &config.cost;
    states_ = config.model->state_count;
    inputs_ = config.model->input_count;
    angles_ = config.model->angle_mask;
  }
  /// The goal of the request. True if it is not that of the call before.
  template <class T>
  bool take_goal(const PlanRequest& request, CostTerms<T>& terms) {
    const bool moved = request.goal != goal_;
    goal_ = request.goal;
    if (moved) tiller::take_goal(*cost_, states_, angles_, terms);
    const bool steady = request.steady_state != nullptr;
    if (!steady && !steady_) return moved;
    steady_ = steady;
    return take_steady(*cost_, states_, inputs_, angles_, request.steady_state, request.steady_input, terms) || moved;
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
  std::uint32_t states_ = 0, inputs_ = 0, angles_ = 0;
  bool steady_ = false;
  std::uint64_t goal_ = 0;
  double origin_[TILLER_MAX_STATES] = {};
};

}  // namespace tiller
