#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A network between two programs: what tiller_network_t points to, and the names of what goes in and comes out.
struct StoredNetwork {
  tiller_network_kind_t kind = tiller_network_tanh;
  std::uint32_t members = 1;
  std::uint32_t hidden[2] = {0, 0};
  Words inputs, outputs;
  std::vector<float> weights;  ///< in tiller_network_t's layout
};

/// A policy between two programs.
struct StoredPolicy {
  StoredNetwork network;
  std::uint32_t reads = tiller_policy_state;  ///< tiller_policy_input_t, added up
  std::uint32_t squash = tiller_policy_cut;   ///< tiller_policy_squash_t
  std::vector<float> low, high;               ///< (inputs) range of training; empty: not watched
};

/// Names of a force network's inputs on this robot, "sin pole_angle_rad" and the like (network_input_count of them),
/// and of its outputs, the generalised forces.
Words network_inputs(const RobotFile& robot);
Words network_outputs(const RobotFile& robot);
/// Names of what a policy that reads `reads` takes in (policy_input_count of them).
Words policy_inputs(const RobotFile& robot, std::uint32_t reads);

/// The C structs with their memory: what a configuration points to. Copies share nothing; make them once.
class LoadedNetwork {
 public:
  explicit LoadedNetwork(StoredNetwork stored);
  LoadedNetwork(const LoadedNetwork&) = delete;
  LoadedNetwork& operator=(const LoadedNetwork&) = delete;
  const StoredNetwork stored;
  tiller_network_t network;
};
class LoadedPolicy {
 public:
  explicit LoadedPolicy(StoredPolicy stored);
  LoadedPolicy(const LoadedPolicy&) = delete;
  LoadedPolicy& operator=(const LoadedPolicy&) = delete;
  const StoredPolicy stored;
  LoadedNetwork loaded;
  tiller_policy_t policy;
};

/// JSON of format version 1; docs/reference/networks.md has it.
std::string network_text(const StoredNetwork& network);
std::string policy_text(const StoredPolicy& policy);

/// Reads with suspicion: what is missing, of the wrong type or size or no finite number is an error, "key: problem;
/// remedy" without the file's name. False with the first one.
bool parse_network(const std::string& text, StoredNetwork& out, std::string& error);
bool parse_policy(const std::string& text, StoredPolicy& out, std::string& error);

/// Makes it the robot's: inputs and outputs must be those of its model. False with "key: problem; remedy".
bool take_network(const StoredNetwork& network, RobotFile& robot, std::string& error);
bool take_policy(const StoredPolicy& policy, RobotFile& robot, std::string& error);

/// The sections [network] and [policy] of a robot file.
void read_networks(FileErrors& errors, const toml::table& root, RobotFile& robot);

}  // namespace tiller::tools
