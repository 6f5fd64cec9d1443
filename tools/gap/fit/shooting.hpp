#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "tools/base/thread_pool.hpp"
#include "tools/gap/fit/whitening.hpp"
#include "tools/gap/fit/window_rollout.hpp"

namespace tiller::tools::gap {

/// The start and the result of a fit.
struct Fit {
  std::vector<double> params;  ///< (np)
  std::vector<double> x0;      ///< (all windows x nx); those of the windows fitted are moved
  /// (all windows x unseen) added to the unseen states of effects at a window's start; (unseen) what is likely of it.
  std::vector<double> unseen, unseen_sd;
  std::vector<EffectAt> unseen_of;  ///< (unseen) the effect that each belongs to
  std::vector<double> cost;         ///< (all windows fitted) squares of whitened residuals, and of unseen / unseen_sd
  std::vector<double> unseen_cost;  ///< (all windows) twice the nats that unseen states pay for being free
  double data_cost = 0;             ///< sum of both
  double penalty = 0;               ///< of the priors
  /// (free x free) of half the cost over the free parameters, start states eliminated, priors included; at the last
  /// linearisation. slopes: (windows fitted x free), the windows' own gradients there.
  std::vector<double> information, slopes;
  double dispersion = 1;  ///< of the residuals that the information was taken from: their variance, correlation counted
  int iterations = 0;
  bool finite = false;
  double total() const { return data_cost + penalty; }
  double charged(std::size_t window) const { return cost[window] + unseen_cost[window]; }
};

struct FitSettings {
  int iterations = 12;
  double tolerance = 0.02;   ///< of the total cost: an improvement below it ends the fit
  bool fix_params = false;   ///< start states alone
  bool information = false;  ///< linearise once more at the end
};

/// Multiple shooting (Bock 1981) by Levenberg-Marquardt: parameters common to all windows, a start state of each window
/// that is eliminated by its Schur complement. What effects have that nobody sees is part of the start (unseen.hpp).
/// Derivatives are forward differences in the lanes of one rollout; so are
/// the trial steps: four lengths of the parameters' step by four of the start state's, each window taking the best of
/// its own, which is what gets fits past the kinks of dry friction.
///
/// Threads share the windows. Every window's numbers are its own and sums are taken in the windows' order, so results
/// are the same bits for any number of threads.
///
/// Cost: two rollouts of 16 lanes per window and iteration (more lanes where parameters are many).
class Shooting {
 public:
  Shooting(const WindowData& data, const std::vector<Window>& windows, const tiller_config_t& config,
           const Scales& scales, ThreadPool* threads = nullptr);
  /// Where *stop is not zero, fits end with the step they are in.
  void stop_at(const volatile int* stop) { stop_ = stop; }

  const std::vector<Window>& windows() const { return windows_; }
  /// Starts a fit's record: priors' centres for parameters that `params` lacks.
  Fit begin(const Hypothesis& hypothesis, const std::vector<double>& params, const Fit* warm) const;
  /// Fits to the windows `which` (indices). Whitening must have been prepared.
  void fit(const Hypothesis& hypothesis, const std::vector<std::size_t>& which, const FitSettings& settings, Fit& fit);
  /// Whitens by `nominal` along the paths of `fit`.
  void prepare_whitening(const Hypothesis& nominal, const Fit& fit);
  /// Predicted measurements of a window (points * ny, lane 0 of 16) from the fit's start state.
  const double* predict(const Hypothesis& hypothesis, const Fit& fit, std::size_t index);
  /// Whitened residuals of a window, into `out`: (points * ny), and behind them those of the gauges.
  void residuals(const Hypothesis& hypothesis, const Fit& fit, std::size_t index, std::vector<double>& out);
  /// Makes ready for force_response() in a window: the system linearised along the fit's path, for forces at `joint`.
  bool open_response(const Hypothesis& hypothesis, const Fit& fit, std::size_t index, std::uint32_t joint);
  /// The effect of sixteen kinds of forces on the window's measurements: force(k, position, out (lanes)) is called for
  /// every period. Whitened, start state projected out.
  template <class Force>
  void force_response(std::size_t index, const Force& force) {
    const std::size_t points = windows_[index].points;
    begin_response();
    for (std::size_t k = 0; k + 1 < points; ++k) {
      double f[kLanes] = {};
      force(k, response_position_[k], f);
      step_response(index, k, f);
    }
    end_response(index);
  }
  /// (lanes x lanes) of the responses' products, then (lanes) with the residual; until the next response.
  const double* response_products() const { return products_.data(); }
  /// False: weights are the sensors' alone, the same for every model.
  bool weights_have_models() const { return whitening_.has_process(); }
  std::size_t values(std::size_t index) const { return whitening_.values(index); }
  /// On the heap, for `windows` windows of up to `points` points: taken by the constructor, fixed from then on.
  static std::size_t bytes_for(const tiller_config_t& config, std::size_t windows, std::size_t points,
                               std::size_t gauges, unsigned threads = 1);

 private:
  static constexpr std::uint32_t kLanes = WindowRollout::kLanes;
  static constexpr std::uint32_t kMostColumns = TILLER_MAX_STATES + kMostUnseen + TILLER_MAX_PARAMS + 1;
  /// Memory of one thread.
  struct Scratch {
    WindowRollout rollout;
    std::vector<double> rows;     // (points * rows x lanes)
    std::vector<double> columns;  // (points * rows + unseen x columns)
  };
  /// work(scratch, n) for n = 0 .. count - 1, each with the memory of the thread that it falls to.
  template <class Work>
  void share(std::size_t count, const Work& work);
  std::uint32_t starts_of(const Hypothesis& h) const { return nx_ + static_cast<std::uint32_t>(h.unseen.size()); }
  /// The width that a fit leaves to unseen states: that of what the run-ins of some windows come to.
  void measure_unseen(const Hypothesis& h, Fit& fit);
  /// What unseen states pay in these windows, after a linearisation.
  void charge_unseen(const Hypothesis& h, const std::vector<std::size_t>& which, Fit& fit);
  /// All lanes at the fit's start of a window.
  void fill_start(WindowRollout& rollout, const Hypothesis& h, std::size_t index, const Fit& fit) const;
  void fill_params(WindowRollout& rollout, const Hypothesis& h, const Fit& fit) const;
  void linearise(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, bool params);
  void differentiate(Scratch& scratch, const Hypothesis& h, std::size_t index, const Fit& fit, bool params);
  double try_steps(const Hypothesis& h, const std::vector<std::size_t>& which, const std::vector<double>& step,
                   double damping, Fit& fit);
  bool rescue(const Hypothesis& h, const std::vector<std::size_t>& which, Fit& fit);
  void descend(const Hypothesis& h, const std::vector<std::size_t>& which, const FitSettings& settings, Fit& fit,
               bool& current);
  bool solve(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, double damping,
             std::vector<double>& step);
  /// Row r of a window's measurements, which are followed by those of its gauges, less what is predicted.
  double measured_less(const Window& w, std::size_t r, double predicted) const {
    const std::size_t own = std::size_t{w.points} * ny_, gauges = rows_ - ny_;
    if (r < own) return data_.measured[w.grid][w.start * ny_ + r] - predicted;
    const double off = data_.gauged[w.grid][w.start * gauges + r - own] - predicted;
    return data_.gauges.is_angle((r - own) % gauges) ? std::remainder(off, 6.283185307179586) : off;
  }
  const double* residual_lanes(Scratch& scratch, std::size_t index);
  /// Sums of squares of the residuals of every lane, after states and params were filled.
  void lane_costs(Scratch& scratch, std::size_t index, const Fit& fit, double* cost);
  /// A better start state of a window, tried in sixteen places; what it saves, 0 for nothing.
  double rescue_window(Scratch& scratch, const Hypothesis& h, std::size_t index, Fit& fit);
  bool stopped() const { return stop_ != nullptr && *stop_ != 0; }

  struct PushedSteps;
  void keep_step(const PushedSteps& steps, std::size_t k, std::uint32_t lane);
  /// Of the joint, between points k and k + 1 of the window: measured where it is, else on the base path.
  double position_between(const Window& w, const std::vector<double>& path, std::uint32_t joint, std::size_t k) const;
  void begin_response();
  void step_response(std::size_t index, std::size_t k, const double* force);
  void end_response(std::size_t index);

  const WindowData& data_;
  const std::vector<Window>& windows_;
  const tiller_config_t& config_;
  const tiller_model_t& model_;
  const Scales& scales_;
  std::uint32_t nx_, ny_;
  std::size_t rows_;  // of a point: measurements and gauges
  std::uint8_t measured_[TILLER_MAX_MEASUREMENTS];
  ThreadPool* threads_;
  const volatile int* stop_ = nullptr;
  std::vector<Scratch> scratch_;  // of each thread; the first one's is also what the rest of the class works in
  Whitening whitening_;
  std::vector<double> gram_;  // per window (columns x columns)
  std::uint32_t stride_ = 0;  // columns of the last linearisation: start, parameters, residual
  // of the response: (points x nx x nx), (points x nx), (points), (nx x lanes), (lanes + 1) x lanes
  std::vector<double> response_a_, response_b_, response_position_, deviation_, products_;
  std::vector<double> response_c_;  // (points x gauges x nx)
};

}  // namespace tiller::tools::gap
