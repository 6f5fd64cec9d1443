// The forces that a model lacks, smoothed from an encoder's log of a pendulum with an integrator of its own.

#include "tools/smooth/forces.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/gap/hidden_pendulum.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

constexpr const char* kRobot = R"([robot]
name = "hidden"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { normal = [0.5, 0.025] }
length_m = 0.5
damping_Nms = 0.02
[measurement]
angle_rad = { sd = 3e-4 }
[limits]
torque_Nm = { low = -5.0, high = 5.0 }
[noise]
process_sd = { rate_rad_s = 0.01 }  # of the file
)";

std::unique_ptr<RobotFile> robot_of(const std::string& text, const std::string& path = "hidden.toml") {
  std::string error;
  auto robot = parse_robot_file(text, path, error);
  EXPECT_TRUE(robot) << error;
  return robot;
}

std::vector<double> true_params(const hidden::Setup& s) { return {s.mass_kg, s.length_m, s.damping_Nms}; }

TEST(ForceSmoother, FindsTheForceThatActs) {
  const hidden::Setup setup;
  const auto robot = robot_of(kRobot);
  const std::vector<Grid> grids = hidden::logs(setup, hidden::spring_q2, 2, 3);
  const std::vector<double> params = true_params(setup);
  const Eigen::VectorXd typical = typical_forces(robot->config, grids, params);
  ASSERT_GT(typical(0), 0.0);
  const Eigen::VectorXd sd = choose_force_sd(robot->config, grids, params, typical);
  SmoothedForces forces;
  std::string error;
  ASSERT_TRUE(smooth_forces(robot->config, grids, params, sd, forces, error)) << error;
  double errors = 0.0, squares = 0.0, normalised = 0.0, count = 0.0;
  for (Eigen::Index k = 0; k < forces.force.cols(); ++k) {
    if (forces.weight[static_cast<std::size_t>(k)] == 0.0) continue;
    const double wanted = hidden::spring_q2(forces.state(0, k), forces.state(1, k));
    errors += std::pow(forces.force(0, k) - wanted, 2);
    normalised += std::pow(forces.force(0, k) - wanted, 2) / forces.variance(0, k);
    squares += wanted * wanted;
    count += 1.0;
  }
  EXPECT_LT(std::sqrt(errors / squares), 0.2);
  // the smoother's own deviation is that of its errors, to the factor of three in which intensities are tried
  EXPECT_LT(std::sqrt(normalised / count), 3.0);
  EXPECT_GT(std::sqrt(normalised / count), 1.0 / 3.0);
}

}  // namespace
}  // namespace tiller::tools
