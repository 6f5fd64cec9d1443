#pragma once

// Small planning problems with several local minima, and the optima that bench/peers/minima_reference.py found.

#include <string>
#include <vector>

#include "tiller/config.hpp"

namespace tiller::bench {

struct MinimaProblem {
  std::string name;
  std::string minima;     ///< how its local minima differ
  tiller::Config config;  ///< without the planner's settings

  double optimum = 0.0;         ///< the reference's cost
  int reached = 0, starts = 0;  ///< of its local searches, those that end within 1 % of that
  std::vector<double> inputs;   ///< (horizon x nu) the reference's
};

/// From SET_problems.toml and SET_optima.toml in `folder`: "minima", or "minima_tuning". Ends the program where they do
/// not fit together.
std::vector<MinimaProblem> read_minima_problems(const std::string& folder, const std::string& set);

}  // namespace tiller::bench
