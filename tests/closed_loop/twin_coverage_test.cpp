// A simulated twin must not lie: what the posterior says of a robot that is as its file says has to hold. Shipped
// files, and files with numbers that a user would write in their place, each on its ODE plant at the default step.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <utility>

#include "harness/episode/episode.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::bench {
namespace {

using Changes = std::vector<std::pair<const char*, const char*>>;

struct Twin {
  const char* name;
  const char* file;
  Changes changes;
};
void PrintTo(const Twin& twin, std::ostream* out) { *out << twin.name; }

// mass, length, damping, torque, noise
const Twin kTwins[] = {
    {"pendulum", "pendulum.toml", {}},
    {"pendulum_light",
     "pendulum.toml",
     {{"mass_kg = { uniform = [0.25, 0.75] }", "mass_kg = { uniform = [0.1, 0.3] }"},
      {"length_m = 0.5 ", "length_m = 0.3 "},
      {"damping_Nms = { uniform = [0.0, 0.1] }", "damping_Nms = { uniform = [0.0, 0.02] }"},
      {"low = -1.5, high = 1.5", "low = -0.4, high = 0.4"},
      {"noise_sd = { torque_Nm = 1.0 }", "noise_sd = { torque_Nm = 0.3 }"},
      {"angle_rad = { sd = 0.002 }\n\n[noise]", "angle_rad = { sd = 0.001 }\n\n[noise]"},
      {"sensors.angle_rad = { sd = 0.002 }", "sensors.angle_rad = { sd = 0.001 }"}}},
    {"pendulum_heavy",
     "pendulum.toml",
     {{"mass_kg = { uniform = [0.25, 0.75] }", "mass_kg = { uniform = [1.0, 3.0] }"},
      {"length_m = 0.5 ", "length_m = 0.8 "},
      {"damping_Nms = { uniform = [0.0, 0.1] }", "damping_Nms = { uniform = [0.0, 0.4] }"},
      {"low = -1.5, high = 1.5", "low = -8, high = 8"},
      {"noise_sd = { torque_Nm = 1.0 }", "noise_sd = { torque_Nm = 5.0 }"}}},
    {"pendulum_fine_encoder",
     "pendulum.toml",
     {{"damping_Nms = { uniform = [0.0, 0.1] }", "damping_Nms = { uniform = [0.0, 0.03] }"},
      {"rate_rad_s = 0.02 }", "rate_rad_s = 0.005 }"},
      {"angle_rad = { sd = 0.002 }\n\n[noise]", "angle_rad = { sd = 0.0005 }\n\n[noise]"},
      {"sensors.angle_rad = { sd = 0.002 }", "sensors.angle_rad = { sd = 0.0005 }"}}},
};

std::unique_ptr<tools::RobotFile> read_twin(const Twin& twin) {
  std::ifstream in(std::string(TILLER_ROBOTS "/") + twin.file);
  std::stringstream text;
  text << in.rdbuf();
  std::string content = text.str(), errors;
  for (const auto& [was, now] : twin.changes) {
    const auto at = content.find(was);
    EXPECT_NE(at, std::string::npos) << was;
    if (at != std::string::npos) content.replace(at, std::string(was).size(), now);
  }
  auto robot = tools::parse_robot_file(content, twin.file, errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot;
}

/// Intervals of 90 % that hold and the mean error in deviations, per parameter, over the seeds.
void expect_coverage(const Twin& twin, std::uint64_t seeds) {
  const auto robot = read_twin(twin);
  ASSERT_NE(robot, nullptr);
  struct Count {
    std::string name;
    std::uint64_t covered = 0;
    double z = 0;
  };
  std::vector<Count> counts;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    EpisodeOptions options;
    options.seed = seed;
    options.planner = static_cast<tiller_planner_kind_t>(robot->config.planner.kind);
    options.seconds = 8;
    const EpisodeResult result = run_episode(*robot, options);
    ASSERT_EQ(result.error, "");
    counts.resize(result.parameters.size());
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const ParameterResult& p = result.parameters[i];
      counts[i].name = p.name;
      counts[i].covered += p.covered();
      counts[i].z += (p.mean - p.truth) / p.sd;
    }
  }
  // a method that is right falls below three and a half deviations once in 4,000 times and parameters
  const double n = static_cast<double>(seeds), least = 0.9 * n - 3.5 * std::sqrt(0.09 * n), most_z = 3.5 / std::sqrt(n);
  for (const Count& c : counts) {
    std::printf("%s, %s: %llu of %llu covered, mean z %+.2f\n", twin.name, c.name.c_str(),
                static_cast<unsigned long long>(c.covered), static_cast<unsigned long long>(seeds), c.z / n);
    EXPECT_GE(static_cast<double>(c.covered), least) << c.name;
    EXPECT_LT(std::fabs(c.z / n), most_z) << c.name;
  }
}

class TwinOf : public testing::TestWithParam<Twin> {};
INSTANTIATE_TEST_SUITE_P(Robots, TwinOf, testing::ValuesIn(kTwins),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST_P(TwinOf, FewSeeds) { expect_coverage(GetParam(), 6); }
TEST_P(TwinOf, FortySeeds) { expect_coverage(GetParam(), 40); }

}  // namespace
}  // namespace tiller::bench
