#include "posterior/transition/transition_ring.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace tiller {

TransitionRing TransitionRing::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                       const Evidence& evidence) {
  TransitionRing r;
  r.nx_ = config.model->state_count;
  r.columns_ = evidence.columns();
  r.pushed_count_ = evidence.pushed_count();
  r.history_row_ = setup.delay_steps * config.model->input_count;
  r.longest_ = 2 * config.posterior.window;
  r.capacity_ = r.columns_ > 0 ? r.longest_ + 1 : r.longest_;
  r.steps_ = arena.take<MeasuredStep>(r.capacity_);
  r.weight_ = arena.take<float>(std::size_t{r.capacity_} * r.nx_);
  r.basis_ = arena.take<float>(std::size_t{r.capacity_} * r.columns_);
  r.linked_ = arena.take<float>(std::size_t{r.capacity_} * r.pushed_count_);
  r.history_ = arena.take<double>(std::size_t{r.capacity_} * r.history_row_);
  return r;
}

std::uint32_t TransitionRing::push(const MeasuredStep& step) {
  const std::uint32_t slot = this->slot(end_++);
  MeasuredStep& to = steps_[slot];
  to = step;
  to.history = nullptr;
  if (history_row_) {
    double* const history = history_ + std::size_t{slot} * history_row_;
    std::memcpy(history, step.history, sizeof(double) * history_row_);
    to.history = history;
  }
  set_weight(slot, 1.0);
  // without either there is no row, and no address of one
  std::fill_n(basis(slot), columns_, 0.0f);
  std::fill_n(linked(slot), pushed_count_, 0.0f);
  return slot;
}

void TransitionRing::set_weight(std::uint32_t slot, double weight) {
  steps_[slot].weight = weight;
  for (std::uint32_t r = 0; r < nx_; ++r)
    weight_[slot * nx_ + r] = std::isnan(steps_[slot].change[r]) ? 0.0f : static_cast<float>(weight);
}

void TransitionRing::link(std::uint32_t slot, const Evidence& evidence) {
  for (std::uint32_t j = 0; j < pushed_count_; ++j)
    linked(slot)[j] = weight(slot_before(slot))[evidence.pushed(j)] > 0.0f ? 1.0f : 0.0f;
}

bool TransitionRing::any_linked(std::uint32_t slot) const {
  bool any = false;
  for (std::uint32_t j = 0; j < pushed_count_; ++j) any = any || linked(slot)[j] > 0.0f;
  return any;
}

}  // namespace tiller
