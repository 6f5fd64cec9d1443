#pragma once

#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools::tune {

/// A number of the robot file that is searched. Its coordinate runs from 0 at `low` to 1 at `high`, evenly in the value
/// or in its logarithm.
struct SearchKey {
  std::string path;
  double low = 0, high = 1;
  bool log = false;
  bool whole = false;  ///< rounded to a multiple of `multiple`
  std::uint32_t multiple = 1;

  double coordinate(double value) const;  ///< not clamped
  double value(double coordinate) const;  ///< within low and high, rounded where it must be whole
  std::string text(double coordinate) const;
};

/// "planner.horizon=20:80", "planner.noise_sd.force_N=log:0.5:10". False with a sentence in `error` that names the
/// argument and what to write.
bool parse_search(const std::string& argument, SearchKey& key, std::string& error);

/// Whether the file at `text` can take the key: a section that may be searched, a key of the schema, within its range.
/// Fills `whole` and `multiple`. False with a sentence in `error`.
bool check_search(const std::string& text, SearchKey& key, std::string& error);

/// What is searched where nothing is named: the horizon within half and twice, the planner's noise within a quarter and
/// four times, and the weights of inputs and of their changes within a tenth and ten times; of each what the file has.
std::vector<SearchKey> default_search(const RobotFile& robot, const std::string& text);

}  // namespace tiller::tools::tune
