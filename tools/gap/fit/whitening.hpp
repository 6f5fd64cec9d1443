#pragma once

#include <vector>

#include "tools/gap/fit/window_rollout.hpp"

namespace tiller::tools::gap {

/// Makes a window's residuals independent with deviation one: y - rollout carries sensor noise and, from then on, every
/// kick of process noise. A Kalman filter of the deviation from the nominal path (zero at the window's start, since the
/// start state is fitted), linearised along it, has the whitened residuals as its innovations: what a Cholesky factor
/// of the window's covariance would give, in O(points).
///
/// One whitening serves all hypotheses, so that their costs are comparable.
class Whitening {
 public:
  /// `gauges` outlive the object.
  Whitening(const tiller_config_t& config, const Gauges& gauges, std::size_t windows, std::size_t points);

  /// For window `index`, along `path` (points * nx, stride `stride` between rows) under parameters (np).
  void prepare(std::size_t index, const Hypothesis& nominal, const WindowData& data, const Window& window,
               const double* path, std::size_t stride, const double* params);
  /// In place: residual rows (points * ny x 16) and behind them those of the gauges -> whitened; missing measurements
  /// become 0. Gauges take no part in the filter: theirs is what its estimate leaves.
  void apply(std::size_t index, const Window& window, double period_s, double* rows) const;
  /// Measurements that are there, in the window.
  std::size_t values(std::size_t index) const { return values_[index]; }
  bool has_process() const { return process_; }
  static std::size_t bytes_for(const tiller_config_t& config, std::size_t windows, std::size_t points,
                               std::size_t gauges);

 private:
  struct Steps;
  /// The inverse standard deviation of each measurement of the window; 0 where it is missing.
  void weigh_measured(std::size_t index, const tiller_config_t& config, const WindowData& data, const Window& window);
  /// Takes the measurements of a point into the covariance p (nx * nx), and keeps gains and weights.
  void correct(std::size_t point, double* p);
  /// Slopes and weights of the gauges at a point, given the filter's covariance there.
  void weigh_gauges(std::size_t point, std::size_t k, const tiller_config_t& config, double period_s,
                    const double* state, const double* params, const double* p, const double* p_last);
  /// From the nominal path, lane by lane: with a point's measurements, before them, and a period ago.
  struct Deviations {
    double now[TILLER_MAX_STATES][WindowRollout::kLanes], foreseen[TILLER_MAX_STATES][WindowRollout::kLanes],
        last[TILLER_MAX_STATES][WindowRollout::kLanes];
  };
  void apply_gauges(std::size_t point, std::size_t k, const Deviations& d, double period_s, double* rows) const;
  /// p = step p step' + process noise of a period.
  void propagate(const tiller_config_t& config, double period_s, const double* step, double* p) const;

  std::uint32_t nx_, ny_;
  std::size_t points_;
  bool process_ = false;
  std::uint8_t measured_[TILLER_MAX_MEASUREMENTS];
  const Gauges& gauges_;
  std::vector<double> a_, k_, g_;  // per window and point: (nx * nx), (ny * nx), (ny)
  std::vector<double> c_, w_;      // of the gauges, per window and point: (gauges * nx), (gauges)
  std::vector<std::size_t> values_;
  std::vector<double> lanes_;  // of the linearisation
};

}  // namespace tiller::tools::gap
