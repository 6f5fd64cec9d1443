#pragma once

#include <algorithm>
#include <cstdint>

#include "core/arena.hpp"
#include "posterior/filter/lane_filter.hpp"

namespace tiller {

/// The last transitions, over which proposals are rerun. A window is exact while it begins where the filters did: any
/// lane's filter there is then known.
class FilterWindow {
 public:
  static FilterWindow lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup) {
    FilterWindow w;
    w.nu_ = config.model->input_count;
    w.ny_ = config.measurement_count;
    w.history_ = setup.delay_steps * w.nu_;
    w.slots_ = config.posterior.window + 1;
    w.rows_ = arena.take<double>(std::size_t{w.slots_} * w.length());
    return w;
  }

  void clear() {
    begin_ = end_ = 0;
    exact_ = true;
  }
  /// Nothing is left of it, and filters begin anew.
  void restart() {
    begin_ = end_;
    exact_ = true;
  }
  void push(const Observation& seen) {
    double* to = row(end_++);
    to[0] = seen.period_s;
    to[1] = seen.weight;
    to = std::copy(seen.input, seen.input + nu_, to + kInput);
    to = std::copy(seen.measured, seen.measured + ny_, to);
    std::copy(seen.history, seen.history + history_, to);
  }
  void drop_oldest() {
    ++begin_;
    exact_ = false;
  }
  /// Those from `end` on have never been.
  void drop_newest(std::uint64_t end) { end_ = end; }
  /// Of each transition's weight only this share is kept.
  void forget(double keep) {
    for (std::uint64_t k = begin_; k < end_; ++k) row(k)[1] *= keep;
  }

  std::uint64_t begin() const { return begin_; }
  std::uint64_t end() const { return end_; }
  std::uint64_t size() const { return end_ - begin_; }
  bool exact() const { return exact_; }
  Observation at(std::uint64_t index) const {
    const double* from = row(index);
    return {from[0], from[1], from + kInput, from + kInput + nu_, from + kInput + nu_ + ny_};
  }

 private:
  static constexpr std::uint32_t kInput = 2;
  std::uint32_t length() const { return kInput + nu_ + ny_ + history_; }
  double* row(std::uint64_t index) const { return rows_ + (index % slots_) * length(); }

  std::uint32_t nu_ = 0, ny_ = 0, history_ = 0, slots_ = 1;
  double* rows_ = nullptr;  // (slots x length) period, weight, inputs, measurements, inputs before
  std::uint64_t begin_ = 0, end_ = 0;
  bool exact_ = true;
};

}  // namespace tiller
