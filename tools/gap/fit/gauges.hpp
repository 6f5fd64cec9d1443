#pragma once

#include <array>
#include <vector>

#include "tiller/tiller.h"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// The sensors that the logs have beside the robot's own ([[log.sensors]]): a camera that sees the tool, a gyroscope,
/// an accelerometer. Each reads a state or an output of the model, or its first or second derivative by time.
///
/// A derivative is taken through the velocities of the joints as far as that goes, and then as the change over the
/// period that ends at the row: an accelerometer that is read before the next command acts shows that.
///
/// An accelerometer that rides on a frame reads along the frame's own axis, and gravity with it. Its slope takes the
/// axis as it stands: what an error of the attitude does to the share of gravity is left out.
class Gauges {
 public:
  Gauges() = default;
  /// Of the grids' sensors, which are the same in all of them.
  Gauges(const tiller_config_t& config, const std::vector<GridSensor>& sensors);

  std::size_t count() const { return gauges_.size(); }
  /// Rows before the present one that gauge g needs: 0 or 1.
  std::size_t before(std::size_t g) const { return gauges_[g].differences; }
  double sd(std::size_t g) const { return gauges_[g].sd; }
  /// Whether it reads an angle, of which whole turns do not count.
  bool is_angle(std::size_t g) const { return gauges_[g].angle; }
  /// What gauge g reads without noise at row `k` of a path of states (row r of state i at path[(r * nx + i) * stride]),
  /// and of a parameter i at params[i * param_stride]; k >= before(g).
  double reading(std::size_t g, const double* path, std::size_t k, std::size_t stride, const double* params,
                 std::size_t param_stride, double period_s) const;
  /// Slope (nx) by the state of row k of what gauge g differentiates or reads.
  void slope(std::size_t g, const double* state, const double* params, double* out) const;

 private:
  struct Gauge {
    bool output = false;
    std::uint32_t index = 0;
    bool angle = false;
    bool through_joints = false;  // the rate by the joints' velocities
    std::size_t differences = 0;
    double sd = 1;
    bool rides = false;
    std::array<std::uint32_t, 3> position{}, axis{};  // outputs of what it rides on: origin, and its own axis
  };
  using Axis = std::array<double, 3>;
  void rate(const double* state, const double* params, double* out) const;
  Axis axis_of(const Gauge& gauge, const double* state, const double* params) const;
  double quantity(const Gauge& gauge, const double* state, const double* params, const Axis& axis) const;

  const tiller_model_t* model_ = nullptr;
  Axis gravity_m_s2_{};
  std::vector<Gauge> gauges_;
};

}  // namespace tiller::tools::gap
