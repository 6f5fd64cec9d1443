#pragma once

#include <string>
#include <vector>

#include "tools/imitate/scene.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools::imitate {

/// A weight of the robot file's cost. The cost is linear in all of them.
struct CostTerm {
  enum Kind { state, terminal, input, input_rate, saturating, bound, obstacle, output, output_bound };
  Kind kind = state;
  std::uint32_t index = 0;  ///< state, input, obstacle or output
  std::string key;          ///< path in the file: "cost.state_weight.angle_rad", "cost.obstacles.0.weight"
  double value = 0;         ///< as the file has it
};

/// A configuration whose weights may be changed, with the outputs' costs that it points to.
class CostEdit {
 public:
  explicit CostEdit(const tiller_config_t& config);
  CostEdit(const CostEdit& other) : CostEdit(other.get()) {}
  CostEdit& operator=(const CostEdit&) = delete;

  const tiller_config_t& get() const { return config_; }
  void set(const CostTerm& term, double value);
  void set_target(std::uint32_t state, double value) { config_.cost.target[state] = value; }
  /// Every weight zero, those of a demonstration and of an own cost too.
  void clear();

 private:
  Config config_;
  std::vector<tiller_output_cost_t> outputs_;
};

/// The weights above zero that stand in the file's text as numbers of their own. Those of frames, of the clearance, of
/// a demonstration and of an own cost do not count among them: they stay as they are.
std::vector<CostTerm> cost_terms(const RobotFile& robot, const std::string& text);

}  // namespace tiller::tools::imitate
