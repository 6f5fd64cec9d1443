#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "io/latency_histogram.hpp"
#include "tools/base/python_worker.hpp"
#include "tools/view/view_row.hpp"

namespace tiller::tools {

struct ViewerOptions {
  std::string kind;    ///< "rerun", "foxglove"; empty: none
  std::string file;    ///< what would be shown goes there; empty: a window, or a server
  std::string layout;  ///< file for the arrangement of the views; empty: none
};
/// What --view takes.
Words viewer_kinds();

/// A viewer in a process of its own (tiller_tools.view). A tick hands it one packet and goes on: the system's queue
/// between the two holds what fits, and a packet that does not fit is dropped and counted. A viewer that dies or stands
/// still changes nothing but what is seen.
class Viewer {
 public:
  /// Starts it and waits until it is ready. `facts`: JSON of robot_facts_json(). Null with a sentence in `error`.
  static std::unique_ptr<Viewer> open(const ViewerOptions& options, const RobotFile& robot, const std::string& facts,
                                      std::string& error);

  /// After a tick, when its command is out. Never waits.
  void show(const tiller_t* controller, const LoggedTick& tick);
  /// The same, of a tick of a log, which has time.
  void show_all(const tiller_t* controller, const LoggedTick& tick);
  /// Lets it finish what it has been given, for as long as it goes on with that. One line of what was shown.
  std::string close();

 private:
  Viewer(const RobotFile& robot, std::unique_ptr<PythonWorker> worker)
      : row_(robot), values_(row_.size()), worker_(std::move(worker)) {}
  std::string hello(const RobotFile& robot, const std::string& facts) const;

  ViewRow row_;
  std::vector<double> values_;
  std::unique_ptr<PythonWorker> worker_;
  LatencyHistogram took_;
  std::uint64_t shown_ = 0, dropped_ = 0;
};

}  // namespace tiller::tools
