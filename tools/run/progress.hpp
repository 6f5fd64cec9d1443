#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "tools/logs/run_log.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/run/sensor_view.hpp"

namespace tiller::tools {

/// The progress display of a run: on a terminal one block that overwrites itself ten times a second, elsewhere
/// a line for every half second of robot time, so that a log file of the output stays readable. Before motion it shows
/// what the sensors read, in motion what the controller knows.
class Progress {
 public:
  enum class Style { silent, lines, block };

  Progress(const RobotFile& robot, Style style, double end_s, std::vector<double> true_params);
  static Style style_for_stdout(bool quiet);
  /// In robot time; 0: no end is known.
  void set_end(double end_s) { end_s_ = end_s; }

  void show(const LoggedTick& tick);
  /// Shows the last tick once more and leaves the block standing.
  void finish(const LoggedTick& tick);
  /// A sentence between the blocks or lines; one that must not be missed goes to stderr where the screen is silent.
  void say(const std::string& text, bool must = false);

  std::string block(const LoggedTick& tick) const;  ///< several lines
  std::string line(const LoggedTick& tick) const;

 private:
  void draw(const LoggedTick& tick);
  std::string head(const LoggedTick& tick) const;

  const RobotFile& robot_;
  Style style_;
  double end_s_;
  std::vector<double> true_params_;
  SensorView sensors_;
  double next_line_s_ = 0;
  int drawn_lines_ = 0;
  std::chrono::steady_clock::time_point next_draw_;
};

}  // namespace tiller::tools
