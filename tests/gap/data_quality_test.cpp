// Data that cannot answer are refused, with what, where and how to mend it; data that can are not.
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/localise/noise.hpp"
#include "tools/gap/pipeline/data.hpp"
#include "tools/gap/pipeline/data_quality.hpp"
#include "tools/gap/pipeline/time_scale.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools::gap {
namespace {

constexpr const char* kRobot = R"([robot]
name = "arm"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { uniform = [0.475, 0.525] }
length_m = 0.4
damping_Nms = 0.0
[measurement]
angle_rad = { sd = 0.002 }
[noise]
process_sd = { rate_rad_s = 0.001 }
[start]
sd = { angle_rad = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "mppi"
horizon = 50
knots = 10
rollouts = 64
particles = 4
iterations = 1
noise_sd = { torque_Nm = 0.3 }
[cost]
target = { angle_rad = 0.0 }
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -3, high = 3 }
)";

std::unique_ptr<RobotFile> robot() {
  std::string errors;
  auto file = parse_robot_file(kRobot, "arm.toml", errors);
  EXPECT_TRUE(file) << errors;
  return file;
}

struct Sheet {  // a log as its rows
  std::string header = "time_s,angle_rad,torque_Nm";
  std::vector<double> time, angle, torque;
  std::string text() const {
    std::string out = header + "\n";
    for (std::size_t i = 0; i < time.size(); ++i) {
      char row[96];
      std::snprintf(row, sizeof row, "%.6f,%.9g,%.9g\n", time[i], angle[i], torque[i]);
      out += row;
    }
    return out;
  }
  void erase(std::size_t from, std::size_t to) {
    for (auto* column : {&time, &angle, &torque})
      column->erase(column->begin() + static_cast<std::ptrdiff_t>(from),
                    column->begin() + static_cast<std::ptrdiff_t>(to));
  }
};

Sheet sheet(std::uint64_t seed = 1, double seconds = 8, bool friction = true) {
  Synthetic s;
  s.amplitude = 0.8;
  s.seconds = seconds;
  if (friction) s.force = [](double, double v, double, double) { return -0.05 * std::tanh(v / 0.005); };
  const Grid grid = simulate(s, 300000 + seed);
  Sheet out;
  for (std::size_t k = 0; k < grid.points(); ++k) {
    out.time.push_back(0.01 * static_cast<double>(k));
    out.angle.push_back(grid.state[0][k]);
    out.torque.push_back(grid.input[0][k]);
  }
  return out;
}

std::string write(const std::string& name, const std::string& text) {
  const std::string path = (std::filesystem::path(testing::TempDir()) / name).string();
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

Result judge(const std::vector<std::string>& paths) {
  const auto file = robot();
  Result result;
  std::vector<Log> logs;
  std::vector<Grid> grids;
  if (load_logs(*file, paths, 0, false, logs, grids, &result.data_hash, result))
    check_data_quality(file->config, grids, nullptr, result);
  return result;
}

std::string all_of(const Result& result) {
  std::string text;
  for (const std::string& reason : result.reasons) text += reason + "\n";
  return text;
}

struct Bad {
  const char* name;
  std::string text;
  std::vector<std::string> said;
};

std::vector<Bad> bad_logs() {
  std::vector<Bad> all;
  const auto add = [&](const char* name, auto change, std::vector<std::string> said) {
    Sheet s = sheet();
    change(s);
    all.push_back({name, s.text(), std::move(said)});
  };
  all.push_back({"empty", "", {"empty", "header"}});
  add("wrong_names", [](Sheet& s) { s.header = "t,theta,tau"; },
      {":1:", "no column 'time_s'", "t, theta, tau", "[log]"});
  add("repeated", [](Sheet& s) { s.time[200] = s.time[199]; }, {":202:", "repeats that of line 201", "delete"});
  add("backwards", [](Sheet& s) { s.time[200] -= 0.5; }, {":202:", "backwards", "two files"});
  add("infinite", [](Sheet& s) { s.torque[100] = INFINITY; }, {":102:", "'torque_Nm' is 'inf'", "leave the cell"});
  add("milliseconds",
      [](Sheet& s) {
        for (double& t : s.time) t *= 1e3;
      },
      {"'time_s'", "ms", "[log] units"});
  add("degrees",
      [](Sheet& s) {
        for (double& q : s.angle) q *= 57.29577951;
      },
      {"'angle_rad'", "in degrees", "angle_rad = \"deg\""});
  add("reversed",
      [](Sheet& s) {
        for (double& q : s.angle) q = -q;
      },
      {"reversed in sign"});
  add("milli_newton",
      [](Sheet& s) {
        for (double& u : s.torque) u *= 1e3;
      },
      {"'torque_Nm'", "[limits]", "mNm"});
  add("stuck",
      [](Sheet& s) {
        for (double& q : s.angle) q = 0.3;
      },
      {"'angle_rad' is 0.3 in every row", "stuck"});
  add("no_input",
      [](Sheet& s) {
        for (double& u : s.torque) u = 0;
      },
      {"'torque_Nm' does not change", "log the command that was sent"});
  add("still",
      [](Sheet& s) {
        for (double& q : s.angle) q = 5e-3 * q;
      },
      {"'angle_rad' moves by", "too little movement"});
  add("clipped",
      [](Sheet& s) {
        for (double& q : s.angle) q = std::min(q, 0.4);
      },
      {"'angle_rad' is 0.4", "reached at speed", "saturated"});
  add("saturated_command",
      [](Sheet& s) {
        for (double& u : s.torque) u = u > -0.5 ? 3 : u;
      },
      {"'torque_Nm' lies at its limit 3", "saturated"});
  add("noisy",
      [](Sheet& s) {
        Rng rng(5, 1, 1);
        for (double& q : s.angle) q += 0.05 * rng.normal();
      },
      {"'angle_rad'", "its noise is 0.05", "[measurement] angle_rad.sd"});
  all.push_back({"short", sheet(1, 2).text(), {"too short", "record at least"}});
  return all;
}

TEST(Gate, RefusesEveryBadLog) {
  for (const Bad& bad : bad_logs()) {
    const std::string path = write(std::string("gap_bad_") + bad.name + ".csv", bad.text);
    const Result result = judge({path});
    const std::string text = all_of(result);
    std::printf("%-18s %s", bad.name, text.empty() ? "-\n" : text.c_str());
    ASSERT_FALSE(result.reasons.empty()) << bad.name;
    EXPECT_NE(text.find(path), std::string::npos) << bad.name;
    for (const std::string& word : bad.said)
      EXPECT_NE(text.find(word), std::string::npos) << bad.name << " lacks '" << word << "'";
  }
}

TEST(Gate, CutsALogAtItsGaps) {
  Sheet s = sheet();
  s.erase(300, 380);
  const Result result = judge({write("gap_cut.csv", s.text())});
  EXPECT_TRUE(result.reasons.empty()) << all_of(result);
  EXPECT_NEAR(result.data_s, 7.2, 0.1);
  ASSERT_EQ(result.notes.size(), 1u);
  EXPECT_NE(result.notes[0].find("1 gap(s)"), std::string::npos) << result.notes[0];
}

// A pendulum that swings freely tells of its joint; the same columns with a drive that was not logged tell of nothing.
TEST(Gate, TakesFreeSwings) {
  const auto swing = [](double q, double v, double) { return -9.81 / 0.4 * std::sin(q) - 0.05 * v; };
  std::string text = "time_s,angle_rad\n";
  Rng rng(3, 5, 7);
  double q = 1.2, v = 0;
  for (int k = 0; k < 800; ++k) {
    char row[64];
    std::snprintf(row, sizeof row, "%.6f,%.9g\n", 0.01 * k, q + 2e-3 * rng.normal());
    text += row;
    for (int fine = 0; fine < 20; ++fine) {
      v += 0.0005 * swing(q, v, 0);
      q += 0.0005 * v;
    }
  }
  const Result result = judge({write("gap_free_swing.csv", text)});
  EXPECT_TRUE(result.reasons.empty()) << all_of(result);
  std::string notes;
  for (const std::string& note : result.notes) notes += note + "\n";
  EXPECT_NE(notes.find("no column of an input"), std::string::npos) << notes;
  EXPECT_NE(notes.find("cannot be told"), std::string::npos) << notes;
}

TEST(TimeScale, IsOneForMachinesAndFollowsWhatIsFasterOrSlower) {
  const auto scale = [](double hertz, double period_s) {
    Synthetic s;
    s.period_s = period_s;
    tiller::Config config = synthetic_config(s);
    Grid grid;
    grid.period_s = period_s;
    grid.state.resize(2);
    grid.input.resize(1);
    Rng rng(1, 2, 3);
    for (int k = 0; k < 4000; ++k) {
      grid.state[0].push_back(0.5 * std::sin(6.283185307179586 * hertz * period_s * k) + 2e-3 * rng.normal());
      grid.state[1].push_back(NAN);
      grid.input[0].push_back(0);
    }
    return measure_time_scale(config, {grid});
  };
  for (const double hertz : {0.1, 0.3, 1.0, 3.0, 8.0}) EXPECT_EQ(scale(hertz, 0.01), 1) << hertz;
  EXPECT_EQ(scale(0.01, 0.01), 1) << "who samples at 100 Hz has a reason";
  // a sinusoid's autocorrelation is one half after a sixth of its period: 60 s of 6 minutes, 2.45 ms at 68 Hz
  EXPECT_NEAR(scale(1 / 360.0, 4.0), 30, 4);
  EXPECT_NEAR(scale(68, 1e-4), 0.123, 0.02);
}

TEST(Gate, TakesGoodLogs) {
  for (const bool friction : {false, true}) {
    std::vector<std::string> paths;
    for (std::uint64_t i = 0; i < 3; ++i)
      paths.push_back(write("gap_good_" + std::to_string(i) + ".csv", sheet(i, 8, friction).text()));
    const Result result = judge(paths);
    EXPECT_TRUE(result.reasons.empty()) << all_of(result);
    EXPECT_NEAR(result.noise_ratio, 1.0, 0.1);
    EXPECT_NEAR(result.data_s, 24, 0.3);
    EXPECT_EQ(result.data_hash.substr(0, 6), "fnv1a-");
  }
}

// A controller at its limit for most of one log is no reason to refuse the others; for most of all logs it is.
TEST(Gate, OneLogAtItsLimitAmongOthersIsTaken) {
  Sheet pushed = sheet(7);
  for (double& u : pushed.torque) u = u > -0.5 ? 3 : u;
  const std::string one = write("gap_pushed.csv", pushed.text());
  std::vector<std::string> paths = {one};
  for (std::uint64_t i = 0; i < 3; ++i)
    paths.push_back(write("gap_rest_" + std::to_string(i) + ".csv", sheet(i).text()));
  EXPECT_EQ(all_of(judge(paths)), "");
  EXPECT_NE(all_of(judge({one, one})).find("saturated"), std::string::npos);
}

// What comes to rest at its largest value slows down before, and is no clipping; neither are two-valued commands.
TEST(Gate, RestAtAnExtremeIsNotClipping) {
  Sheet s = sheet();
  for (std::size_t i = 0; i < s.time.size(); ++i) {
    const double t = std::fmod(s.time[i], 4);
    s.angle[i] =
        std::round(1e3 * (t < 2 ? 0.5 - 0.5 * std::cos(1.5707963 * t) : 0.5 + 0.5 * std::cos(1.5707963 * (t - 2)))) /
        1e3;
    if (t > 1.9 && t < 2.4) s.angle[i] = 1.0;
    s.torque[i] = t < 2 ? 3 : -3;
  }
  Log log;
  std::vector<std::string> reasons;
  log.path = "x.csv";
  log.time_s = s.time;
  for (std::size_t i = 0; i < s.time.size(); ++i) log.line.push_back(static_cast<int>(i) + 2);
  log.state = {s.angle, {}};
  log.input = {s.torque};
  check_rows(log, LogMap(), robot()->config, reasons);
  EXPECT_TRUE(reasons.empty()) << reasons[0];
}

// The estimate knows nothing of the movement: within 10 % at 9 readings a period, for white noise and for a coarse
// encoder, and not far off with the 9 ordinates of 100 readings.
TEST(Noise, IsToldFromMovement) {
  Rng rng(7, 1, 1);
  for (const double sd : {1e-4, 1e-2}) {
    for (const double per_period : {9.0, 40.0, 300.0}) {
      std::vector<std::vector<double>> readings(6);
      for (auto& x : readings)
        for (int k = 0; k < 800; ++k) x.push_back(std::sin(6.283185 * k / per_period) + sd * rng.normal());
      EXPECT_NEAR(estimate_noise(readings).sd / sd, 1.0, 0.1) << sd << " " << per_period;
      readings.resize(1);
      readings[0].resize(100);
      EXPECT_NEAR(estimate_noise(readings).sd / sd, 1.0, 0.7);
    }
    std::vector<std::vector<double>> encoder(1);
    for (int k = 0; k < 4000; ++k) encoder[0].push_back(std::round(std::sin(6.283185 * k / 137.0) / 0.01) * 0.01);
    EXPECT_NEAR(estimate_noise(encoder).sd, 0.01 / std::sqrt(12.0), 1e-3);
    EXPECT_NEAR(estimate_noise(encoder).step, 0.01, 1e-9);
  }
}

}  // namespace
}  // namespace tiller::tools::gap
