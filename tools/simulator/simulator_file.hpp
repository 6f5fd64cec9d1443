#pragma once

#include <memory>
#include <string>

#include "tools/base/text.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What the lists of a request to a simulator mean.
struct SimulatorNames {
  Words parameters, inputs, measurements;
  double period_s = 0.0;
};

/// How simulators are run, by the laboratory (python/tiller/labs/simulator.py).
struct SimulatorSetup {
  Words command;       ///< argv, without a shell
  std::string folder;  ///< that it runs in; empty: this process's
  SimulatorNames names;
  double timeout_s = 10.0;  ///< of one answer, > 0
  double start_s = 60.0;    ///< until the greeting, > 0
  unsigned processes = 1;   ///< side by side, at least 1
  unsigned restarts = 20;   ///< in all, after a death or a time-out
};

/// A simulator file (docs/guide/simulator.md): how a black-box simulator is started, and what its parameters, inputs
/// and measurements are called.
///
/// `robot` is the robot file that it names, or one made from the sections [parameters], [inputs] and [measurements]:
/// its model then has names and no equations. Either serves whoever reads priors, logs and posteriors of a robot.
struct SimulatorFile {
  std::string path;
  SimulatorSetup setup;
  RobotFile robot;
  double piece_s = 0.0;  ///< logs are cut to pieces of this length, each simulated from its own start; 0: not cut
  std::shared_ptr<const void> names;  ///< what robot.config.model points to, where it was made here
};

/// Null with every error in `errors`, one a line: "file:line: key = value: problem; remedy".
std::unique_ptr<SimulatorFile> parse_simulator_file(const std::string& text, const std::string& path,
                                                    std::string& errors);
std::unique_ptr<SimulatorFile> read_simulator_file(const std::string& path, std::string& errors);

/// A simulator by its command alone, words between spaces; `robot` (a robot file's path) says what it is asked for.
/// Null with every error in `errors`.
std::unique_ptr<SimulatorFile> simulator_of_command(const std::string& command, const std::string& robot,
                                                    std::string& errors);

}  // namespace tiller::tools
