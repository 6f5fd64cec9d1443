// Uncertainty as identify reports it: parameter intervals as wide as their errors, and predictive bands that hold nine
// in ten ends, on a plant whose code is this file's own.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "tools/identify/identify_score.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

constexpr double kMass = 0.8, kLength = 0.4, kViscous = 0.05, kSensorSd = 0.001;
#if defined(TILLER_FEW_SEEDS)
constexpr int kRuns = 8;
#else
constexpr int kRuns = 40;
#endif

/// A damped pendulum by the midpoint rule at 0.2 ms, pushed at random where `process_sd` (rad/s per root of a second)
/// is not zero. Its frequencies lie below 10 rad/s, so a step errs by less than (10 * 0.2e-3)^3 / 12 < 1e-9 rad and
/// twenty seconds by less than a tenth of the sensor's deviation.
class Pendulum {
 public:
  Pendulum(double process_sd, std::uint64_t seed) : process_sd_(process_sd), random_(seed) {}
  double measured() { return angle_ + kSensorSd * normal_(random_); }
  void swing(double torque, double time_s) {
    const double h = 2e-4;
    const auto acceleration = [&](double angle, double rate) {
      return (torque - kMass * 9.81 * kLength * std::sin(angle) - kViscous * rate) / (kMass * kLength * kLength);
    };
    for (long n = std::lround(time_s / h); n > 0; --n) {
      const double angle = angle_ + 0.5 * h * rate_, rate = rate_ + 0.5 * h * acceleration(angle_, rate_);
      angle_ += h * rate;
      rate_ += h * acceleration(angle, rate);
      if (process_sd_ > 0) rate_ += process_sd_ * std::sqrt(h) * normal_(random_);
    }
  }

 private:
  double process_sd_, angle_ = 0, rate_ = 0;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_{0, 1};
};

struct Case {
  const char* name;
  double period_s;
  double plant_process_sd;  // of the plant; the robot file always says 0.01
};

std::string write_log(const Case& c, int seed, double length_s) {
  const std::string path = (std::filesystem::path(testing::TempDir()) /
                            ("calibration_" + std::string(c.name) + ".csv" + std::to_string(seed % 2)))
                               .string();
  std::ofstream file(path);
  file << "time_s,angle_rad,torque_Nm\n";
  Pendulum pendulum(c.plant_process_sd, static_cast<std::uint64_t>(seed));
  std::mt19937_64 random(static_cast<std::uint64_t>(seed) + 77);
  std::uniform_real_distribution<double> phase(0, 6.28);
  const double first = phase(random), second = phase(random);
  for (int i = 0; i * c.period_s < length_s; ++i) {
    const double t = i * c.period_s, torque = 1.2 * std::sin(2.1 * t + first) + 0.8 * std::sin(5.3 * t + second);
    char row[96];
    std::snprintf(row, sizeof row, "%.6f,%.9f,%.9f\n", t, pendulum.measured(), torque);
    file << row;
    pendulum.swing(torque, c.period_s);
  }
  return path;
}

std::unique_ptr<RobotFile> robot_of(const Case& c) {
  const std::string text = "[model]\nname = \"pendulum\"\nperiod_s = " + std::to_string(c.period_s) + R"(
[parameters]
mass_kg = { uniform = [0.4, 1.2] }
length_m = 0.4
damping_Nms = { uniform = [0.0, 0.3] }
[measurement]
angle_rad = { sd = 0.001 }
[noise]
process_sd = { rate_rad_s = 0.01 }
[start]
sd = { angle_rad = 0.01, rate_rad_s = 0.1 }
[limits]
torque_Nm = { low = -3, high = 3 }
[log]
input = "hold"
)";
  std::string error;
  auto robot = parse_robot_file(text, "calibration.toml", error);
  EXPECT_NE(robot, nullptr) << error;
  return robot;
}

/// Over all runs: squares of (mean - truth) / sd, and held-out ends by horizon.
struct Outcome {
  double squares = 0;
  int errors = 0;
  int tempered = 0;  // the last transitions were a surprise: the fit says so, and is too wide
  double covered[2] = {};
  double ends[2] = {};
};

/// What `identify` does with one file, for the model whose parameters are learnt alone: no other candidate is judged
/// here.
struct Data {
  std::vector<Stretch> stretches;
  std::vector<Grid> grids;
};

Data read(const RobotFile& robot, const std::string& path) {
  Log log;
  std::string error;
  EXPECT_TRUE(read_any_log(path, robot, log, error)) << error;
  return {make_stretches(log, robot.log, robot.config), make_grids(log, robot.log, robot.config)};
}

void add_run(const Case& c, int run, Outcome& outcome) {
  const auto robot = robot_of(c);
  ASSERT_NE(robot, nullptr);
  FitOptions options;
  options.particles = 128;  // which adds a 128th to the mean square below, a fiftieth of its bounds' width
  options.window = 64;
  const Data fitted = read(*robot, write_log(c, 1000 + 2 * run, 8));
  const Data held_out = read(*robot, write_log(c, 1001 + 2 * run, 20));
  const Candidate candidate = make_candidates(*robot).back();
  Fit learnt;
  std::string error;
  ASSERT_TRUE(fit(candidate, fitted.stretches, options, learnt, error)) << error;
  ScoreOptions scored;
  scored.start_every_s = 2.0;  // no two rollouts share a stretch of the log
  const Score held = score(candidate, learnt, held_out.grids, scored);
  outcome.tempered += learnt.exponent < 1.0 ? 1 : 0;
  const double truth[] = {kMass, kViscous};
  int known = 0;
  for (const ParamSummary& p : learnt.params) {
    if (p.fixed) continue;
    const double z = (p.mean - truth[known++]) / p.sd;
    outcome.squares += z * z;
    ++outcome.errors;
  }
  for (std::size_t h = 0; h < 2; ++h) {
    const HorizonError& e = held.states.at(0).horizons.at(h);
    outcome.covered[h] += e.coverage_90 * static_cast<double>(e.rollouts);
    outcome.ends[h] += static_cast<double>(e.rollouts);
  }
}

class Calibration : public testing::TestWithParam<Case> {};

/// Quantile of chi-square over its n degrees of freedom, by Wilson and Hilferty's cube; `normal` is that of the normal.
double chi_square_share(double n, double normal) {
  const double cube_root = 1 - 2 / (9 * n) + normal * std::sqrt(2 / (9 * n));
  return cube_root * cube_root * cube_root;
}

// Bounds that a right method passes 999 times in 1000 on either side. The squares of n errors over their deviations are
// chi-square; the two parameters of a run are correlated, which counts as half their number. The ends of a run share
// its parameters, so a share of n ends has the deviation of half as many, root of 0.09 / (n / 2).
TEST_P(Calibration, IntervalsAndBandsHoldWhatTheySay) {
  constexpr double kNormal = 3.1;
  Outcome all;
  for (int run = 0; run < kRuns; ++run) ASSERT_NO_FATAL_FAILURE(add_run(GetParam(), run, all));
  const double mean_square = all.squares / all.errors, n = 0.5 * all.errors;
  const double least = chi_square_share(n, -kNormal), most = chi_square_share(n, kNormal);
  std::printf("%s: rms z %.2f (%.2f .. %.2f)", GetParam().name, std::sqrt(mean_square), std::sqrt(least),
              std::sqrt(most));
  EXPECT_GT(mean_square, least) << "the intervals are too wide";
  EXPECT_LT(mean_square, most) << "the intervals are too narrow";
  for (int h = 0; h < 2; ++h) {
    const double share = all.covered[h] / all.ends[h], doubt = kNormal * std::sqrt(0.09 / (0.5 * all.ends[h]));
    std::printf(", after %d s %.1f %% of %.0f inside 90 %% (+- %.1f)", h + 1, 100 * share, all.ends[h], 100 * doubt);
    EXPECT_NEAR(share, 0.9, doubt) << "after " << h + 1 << " s";
  }
  std::printf("\n");
  EXPECT_LE(all.tempered, 2);
}

INSTANTIATE_TEST_SUITE_P(Plants, Calibration,
                         testing::Values(Case{"exact_physics", 0.02, 0.0}, Case{"noise_as_configured", 0.02, 0.01},
                                         Case{"a_third_of_the_noise", 0.02, 0.0033},
                                         Case{"slow_exact_physics", 0.05, 0.0},
                                         Case{"slow_noise_as_configured", 0.05, 0.01}),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace tiller::tools
