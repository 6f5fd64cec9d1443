#pragma once

// A series of episodes in a test: a small robot, and its plant anew for each.

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tools/open/robot_open.hpp"
#include "tools/run/episodes.hpp"

namespace tiller::tools::test {

/// A cart-pole that is cheap to steer: two unknown parameters, few particles and rollouts.
inline RobotFile small_robot() {
  const char* text = R"([robot]
name = "small"
[model]
name = "cart_pole"
[parameters]
cart_mass_kg = 1.0
pole_mass_kg = { uniform = [0.05, 0.15] }
half_length_m = { log_normal = [0.5, 0.2] }
[measurement]
position_m = { sd = 0.0005 }
angle_rad = { sd = 0.002 }
[noise]
process_sd = { velocity_m_s = 0.05, rate_rad_s = 0.1 }
[start]
state = { angle_rad = 3.141592653589793 }
sd = { position_m = 0.001, angle_rad = 0.01, velocity_m_s = 0.01, rate_rad_s = 0.01 }
[posterior]
particles = 64
window = 16
moves_per_tick = 16
[planner]
kind = "mppi"
horizon = 20
knots = 5
rollouts = 32
particles = 2
iterations = 1
noise_sd = { force_N = 8 }
[cost]
state_weight = { angle_rad = 4.0 }
[limits]
force_N = { low = -20, high = 20 }
[sim]
plant = "cart_pole"
draw = true
sensors = { position_m = { sd = 0.0005 }, angle_rad = { sd = 0.002 } }
)";
  std::string errors;
  const auto robot = parse_robot_file(text, "small.toml", errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot ? *robot : RobotFile{};
}

/// The simulated plant, new for each episode.
struct Plants {
  std::unique_ptr<SimPlant> plant;
  std::unique_ptr<Link> link;
  std::vector<std::vector<double>> truths;
  std::vector<std::uint64_t> seeds, noise_seeds;

  OpenEpisode open() {
    return [this](const RobotFile& robot, std::vector<double>& true_params, std::string& error) -> Link* {
      link.reset();
      plant = make_sim_plant(robot, error);
      if (!plant) return nullptr;
      true_params = plant->true_params;
      truths.push_back(true_params);
      seeds.push_back(robot.config.seed);
      noise_seeds.push_back(robot.sim.noise_seed);
      link = make_sim_link(robot, *plant, false);
      return link.get();
    };
  }
};

}  // namespace tiller::tools::test
