#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {

/// Steps of the robot's period that a fit takes in unless it is told otherwise: of a pendulum's two parameters they
/// leave a deviation far below what a model is wrong by, and a minute of processor time.
constexpr std::size_t kMostSteps = 20000;

/// What keep_telling_rows() kept.
struct UsedRows {
  double all_s = 0, used_s = 0;  ///< of all logs together, without gaps
  std::size_t pieces = 0;        ///< that were kept; 0: everything was
  double piece_s = 0;            ///< their typical length
  bool evenly = false;           ///< all of them lie evenly over the logs
  bool everything() const { return pieces == 0; }
  std::string text() const;  ///< a sentence; empty where everything is used
};

/// Cuts logs that hold more than `most_steps` steps of config.period_s together (0: no bound; never below 30 s) down to
/// the pieces that tell most, some 8 s each. Rows that are left out become gaps, which every later step knows of.
///
/// Half of the pieces lie evenly over the time of the logs, so that what drifts or happens once is seen in proportion.
/// The other half is chosen one after the other, each to raise the determinant of the information most (D-optimal
/// design; Fedorov 1972): the sum of the outer products of what forces usually depend on, over 32 moments of a piece.
/// These are of every sensor the value (of an angle its sine and cosine), its speed, the speed's sign and square, its
/// acceleration and its spread between two moments, and of every input the value, its change and its spread, each over
/// its root mean square. The moments lie as far apart as it takes to see the motion through the sensors' noise.
/// The choice looks at no model and no residual, so that it bends no parameter and hides no effect.
///
/// Cost: about 0.3 us a row and sensor, and 128 bytes a piece and feature.
/// `evenly` leaves the second half to the first: for logs that judge.
UsedRows keep_telling_rows(std::vector<Log>& logs, const tiller_config_t& config, std::size_t most_steps,
                           bool evenly = false);

}  // namespace tiller::tools
