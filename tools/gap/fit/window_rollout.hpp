#pragma once

#include <algorithm>
#include <vector>

#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/fit/windows.hpp"

namespace tiller::tools::gap {

/// Rollouts of one window by the runtime's kernel: 16 lanes of start states and parameters. States of effects begin
/// with a run-in over the commands before the window; those that follow the motion (bristles, play) with a longer one
/// along the measured path, since a rollout would have left it by then.
class WindowRollout {
 public:
  static constexpr std::uint32_t kLanes = kLanePadding;
  /// Takes its memory for windows of up to `points` points.
  WindowRollout(const WindowData& data, const tiller_config_t& config, std::size_t points);

  void use(const Hypothesis& hypothesis) {
    hypothesis_ = &hypothesis;
    std::fill(unseen_.begin(), unseen_.end(), 0.0);
  }
  double* states() { return states_.data(); }  ///< (nx x lanes), to be filled
  double* params() { return params_.data(); }  ///< (np x lanes), to be filled
  /// (unseen x lanes), to be filled: what is added to unseen states at the window's start, or to a supply's where its
  /// log begins; 0 after use().
  double* unseen() { return unseen_.data(); }
  /// States of effects (states x lanes) at the window's start, without what is added; until the next run.
  const double* effects_at_start(const Window& window);
  /// Predicted measurements (points * ny x lanes), and behind them those of the gauges (points * gauges x lanes; NaN
  /// where one needs more rows before); until the next run.
  const double* run(const Window& window);
  /// ((points) * nx x lanes) of the last run.
  const double* trajectory() const { return path_.data() + kBefore * row(); }
  static std::size_t bytes_for(const tiller_config_t& config, std::size_t points, std::size_t gauges);

 private:
  double command(const Window& window, std::size_t point, std::size_t input) const;
  const double* history(const Window& window, std::size_t start);
  double command_late(const Window& window, std::size_t point, std::size_t input, double late) const;
  void delay_before(const EffectSlot& slot, double period_s, double* late) const;
  void follow_commands(const Window& window, const EffectSlot& slot, std::size_t start);
  const double* before_the_log(const Window& window, std::uint32_t state) const;
  bool is_of_the_log(std::uint32_t state) const;
  void run_in(const Window& window);
  std::size_t path_steps(const Window& window) const;
  void follow_path(const Window& window, std::size_t start);
  void trace_back(const Window& window);
  void undo_step(const LineariseJob& job, double* at);
  void read_sensors(const Window& window);
  void read_gauges(const Window& window);
  std::size_t row() const { return std::size_t{model_.state_count} * kLanes; }

  static constexpr std::size_t kBefore = TILLER_MAX_DELAY_STEPS;  // rows of the path before the window

  const WindowData& data_;
  const tiller_model_t& model_;
  const RolloutTable& table_;
  const Hypothesis* hypothesis_ = nullptr;
  std::vector<double> states_, params_, unseen_, effect_states_, final_effect_states_, final_states_, history_, path_,
      predicted_, jacobian_;
};

}  // namespace tiller::tools::gap
