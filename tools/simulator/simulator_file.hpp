#pragma once

#include <memory>
#include <string>

#include "tools/robot/robot_file.hpp"
#include "tools/simulator/simulator_pool.hpp"

namespace tiller::tools {

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
  std::shared_ptr<const void> names;  ///< what robot.model points to, where it was made here
};

/// Null with every error in `errors`, one a line: "file:line: key = value: problem; remedy".
std::unique_ptr<SimulatorFile> parse_simulator_file(const std::string& text, const std::string& path,
                                                    std::string& errors);
std::unique_ptr<SimulatorFile> read_simulator_file(const std::string& path, std::string& errors);

}  // namespace tiller::tools
