#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/transition/evidence.hpp"
#include "rollout/residual.hpp"

namespace tiller {

/// The last transitions, with their weights and the discrepancy's regressors. Transition k is in slot k % capacity; the
/// predecessor of the first is still there where the discrepancy needs it.
class TransitionRing {
 public:
  static TransitionRing lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                const Evidence& evidence);

  void clear() { begin_ = end_ = 0; }
  /// Returns the slot. The history is copied; weight 1, regressors zero, no predecessor.
  std::uint32_t push(const MeasuredStep& step);
  void drop_newest() { --end_; }
  void drop_oldest() { ++begin_; }
  std::uint64_t begin() const { return begin_; }
  std::uint64_t end() const { return end_; }
  std::uint64_t size() const { return end_ - begin_; }
  /// Transitions that it holds at the most.
  std::uint32_t longest() const { return longest_; }

  std::uint32_t capacity() const { return capacity_; }
  std::uint32_t slot(std::uint64_t index) const { return static_cast<std::uint32_t>(index % capacity_); }
  std::uint32_t newest() const { return slot(end_ - 1); }
  std::uint32_t slot_before(std::uint32_t slot) const { return (slot > 0 ? slot : capacity_) - 1; }
  MeasuredStep* steps(std::uint32_t slot) const { return steps_ + slot; }
  const float* weight(std::uint32_t slot) const { return weight_ + slot * nx_; }      // (nx) 0: missing
  float* basis(std::uint32_t slot) const { return basis_ + slot * columns_; }         // (columns)
  float* linked(std::uint32_t slot) const { return linked_ + slot * pushed_count_; }  // (pushed_count)
  void set_weight(std::uint32_t slot, double weight);
  /// The transition in the slot follows the one before, in the pushed states that this one has.
  void link(std::uint32_t slot, const Evidence& evidence);
  bool any_linked(std::uint32_t slot) const;
  Evidence::Counted counted(std::uint32_t slot) const {
    return {weight(slot), basis(slot), linked(slot), basis(slot_before(slot))};
  }

 private:
  std::uint32_t nx_ = 0, columns_ = 0, pushed_count_ = 0, history_row_ = 0;
  std::uint32_t longest_ = 0, capacity_ = 1;
  MeasuredStep* steps_ = nullptr;  // (capacity)
  float* weight_ = nullptr;        // (capacity x nx)
  float* basis_ = nullptr;         // (capacity x columns)
  float* linked_ = nullptr;        // (capacity x pushed_count) 1: the slot before is the predecessor
  double* history_ = nullptr;      // (capacity x delay_steps * nu)
  std::uint64_t begin_ = 0, end_ = 0;
};

}  // namespace tiller
