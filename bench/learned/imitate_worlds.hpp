#pragma once

#include <string>
#include <vector>

#include "bench/problems/planning_problem.hpp"
#include "core/rng.hpp"
#include "tools/imitate/demonstration.hpp"
#include "tools/imitate/replan.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::bench {

namespace imi = tools::imitate;

/// A robot with a cost that is to be found again from noisy demonstrations of it.
struct ImitateWorld {
  std::string name;
  tiller::Config config;              ///< with the true cost; parameters known
  imi::Scene scene;                   ///< of `config`
  std::vector<imi::CostTerm> learnt;  ///< with the values that the search begins at
  std::vector<double> truth;          ///< of the learnt terms
  std::vector<double> spread;         ///< (nx) of the starts around the target
  double input_noise = 0.02;          ///< standard deviation, over the demonstrated inputs' root mean square
};

/// `robot`: cart_pole or two_link_arm. The weights of the states are drawn from `seed`, half to twice a base's.
/// False with a message in `error`.
bool make_world(const std::string& robot, std::uint64_t seed, ImitateWorld& world, std::string& error);

/// A start around the target.
imi::Vector draw_start(const ImitateWorld& world, Rng& rng);

/// The best motion of `steps` periods from `start`: plans of 20 periods and then of 20 more at a time. Inputs of zero
/// over the whole length would begin at a pole that has fallen, and end at another optimum.
imi::Motion best_motion(const ImitateWorld& world, const tiller_config_t& cost, const imi::Vector& start, int steps);

/// A converged plan followed by its own feedback. Of the arm the runtime's iLQR plans, which shares no text with the
/// tools'; of the cart-pole best_motion(), since the runtime's begins at a fallen pole.
struct Expert {
  explicit Expert(const ImitateWorld& world);
  /// Plans, with white noise of deviation `share` of the plan's RMS on each input as it is followed.
  imi::Motion follow(const imi::Vector& start, double share, Rng& rng);

 private:
  void plan(const imi::Vector& start);
  const ImitateWorld& world_;
  Planning planning_;
  imi::Motion planned_;
  std::vector<imi::Matrix> gain_;
};

/// What the sensors of the robot file measure of a motion: their noise, and nothing of the other states.
tools::Grid measure(const ImitateWorld& world, const imi::Motion& motion, Rng& rng);

}  // namespace tiller::bench
