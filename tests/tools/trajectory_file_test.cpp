// References and demonstrations from CSV files: what arrives in the configuration, and what is refused.
#include "tools/robot/trajectory_file.hpp"
#include "tools/open/robot_open.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "robot_text.hpp"
#include "tools/robot/export_config.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
const tiller_model_t& pendulum() { return *tiller_find_model("pendulum"); }  // angle_rad, rate_rad_s

class TrajectoryFile : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-rows-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ + "/" + name) << text;
    return folder_ + "/" + name;
  }
  /// Reads the text at a period of 0.1 s.
  bool read(const std::string& text) {
    errors_.clear();
    rows_ = {};
    return read_trajectory(write("rows.csv", text), pendulum(), 0.1, rows_, errors_);
  }
  std::unique_ptr<RobotFile> robot(const std::string& keys, const std::string& sections = "") {
    std::string text = test::with("[cost]\n", "[cost]\n" + keys + "\n");
    text.insert(text.find("[limits]"), sections);
    problems_.clear();
    return parse_robot_file(text, folder_ + "/robot.toml", problems_);
  }

  std::string folder_, problems_;
  Words errors_;
  Trajectory rows_;
};

TEST_F(TrajectoryFile, IsBroughtToThePeriodByLinearInterpolation) {
  // from 5 s on, every 0.25 s; columns in another order and one more
  ASSERT_TRUE(read("time_s,rate_rad_s,extra,angle_rad\n5,0,9,1\n5.25,1,9,2\n\n# a comment\n5.5,3,9,4\n"));
  ASSERT_EQ(rows_.rows, 6u);  // 0, 0.1 .. 0.5 s
  const double angle[] = {1.0, 1.4, 1.8, 2.4, 3.2, 4.0}, rate[] = {0.0, 0.4, 0.8, 1.4, 2.2, 3.0};
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_NEAR(rows_.mean[2 * k], angle[k], 1e-12) << k;
    EXPECT_NEAR(rows_.mean[2 * k + 1], rate[k], 1e-12) << k;
  }
  EXPECT_TRUE(rows_.sd.empty());
}

TEST_F(TrajectoryFile, AnglesFollowOnThroughTheCut) {
  ASSERT_TRUE(read("time_s,angle_rad,rate_rad_s\n0,3.0,0\n0.1,-3.1,0\n0.2,-2.9,0\n"));
  EXPECT_NEAR(rows_.mean[2], -3.1 + 2 * M_PI, 1e-12);
  EXPECT_NEAR(rows_.mean[4], -2.9 + 2 * M_PI, 1e-12);
}

TEST_F(TrajectoryFile, OfALogOfTillerTheEstimateIsTaken) {
  ASSERT_TRUE(
      read("time_s,angle_rad,mean.angle_rad,mean.rate_rad_s,sd.angle_rad,sd.rate_rad_s,status\n"
           "0,9,1,2,0.1,0.1,ok\n"));
  EXPECT_EQ(rows_.mean, (std::vector<double>{1, 2}));
  EXPECT_TRUE(rows_.sd.empty()) << "what the estimator does not know is no spread of demonstrations";
}

TEST_F(TrajectoryFile, IsRefusedWithFileLineAndRemedy) {
  const struct {
    const char *text, *says;
  } cases[] = {
      {"", "rows.csv:1: the file: is empty"},
      {"time_s,angle_rad,rate_rad_s\n", "has a header and no rows"},
      {"angle_rad,rate_rad_s\n0,0\n", "rows.csv:1: time_s: the header has no such column"},
      {"time_ms,angle_rad,rate_rad_s\n0,0,0\n", "is it 'time_ms'? Values are in SI units"},
      {"time_s,angle_deg,rate_rad_s\n0,0,0\n", "angle_rad: the header has no such column; is it 'angle_deg'?"},
      {"time_s,angle_rad\n0,0\n", "rate_rad_s: the header has no such column"},
      {"time_s,angle_rad,angle_rad,rate_rad_s\n0,0,0,0\n", "has this column twice"},
      {"time_s,angle_rad,rate_rad_s\n0,0,0\n0.1,nan,0\n", "rows.csv:3: angle_rad = nan: is not finite"},
      {"time_s,angle_rad,rate_rad_s\n0,inf,0\n", "angle_rad = inf: is not finite"},
      {"time_s,angle_rad,rate_rad_s\n0,,0\n", "rows.csv:2: angle_rad: is empty"},
      {"time_s,angle_rad,rate_rad_s\n0,1\n", "rows.csv:2: rate_rad_s: is empty"},
      {"time_s,angle_rad,rate_rad_s\n0,12 deg,0\n", "angle_rad = 12 deg: is no number; write the number alone, in SI"},
      {"time_s,angle_rad,rate_rad_s\n0,0,0\n0.2,0,0\n0.1,0,0\n",
       "rows.csv:4: time_s = 0.1: is not after the row before"},
      {"time_s,angle_rad,rate_rad_s\n0,0,0\n0,0,0\n", "rows.csv:3: time_s = 0: is not after"},
      {"time_s,angle_rad,rate_rad_s\n0,0,0\n5e6,0,0\n", "write seconds"},
      {"time_s,mean.angle_rad,mean.rate_rad_s,sd.angle_rad,sd.rate_rad_s\n0,0,0,0,1\n",
       "sd.angle_rad = 0: is not positive"},
  };
  for (const auto& c : cases) {
    EXPECT_FALSE(read(c.text)) << c.text;
    ASSERT_FALSE(errors_.empty()) << c.text;
    EXPECT_NE(join(errors_, "\n").find(c.says), std::string::npos) << c.says << "\n in \n" << join(errors_, "\n");
    for (const std::string& error : errors_) EXPECT_NE(error.find("; "), std::string::npos) << error;
  }
  EXPECT_FALSE(read("time_s,angle_rad,rate_rad_s\n0,x,y\n0.1,0,z\n"));
  EXPECT_EQ(errors_.size(), 3u) << "all at once";
}

Trajectory run_of(const std::vector<double>& mean) { return {mean, {}, mean.size() / 2}; }

// Two demonstrations at distance 2 d have S = 2 d d'. With D = 2, nx = 2 the off-diagonal is weighed by 1/4, and the
// floor is a hundredth of the range. W' W must be the inverse of that.
TEST_F(TrajectoryFile, ADemonstrationIsShrunkTowardsItsDiagonal) {
  const Demonstration d =
      estimate_demonstration({run_of({1.0, 2.0, 0.0, 0.0}), run_of({3.0, 6.0, 0.0, 0.0})}, pendulum());
  ASSERT_EQ(d.rows, 2u);
  EXPECT_DOUBLE_EQ(d.mean[0], 2.0);
  EXPECT_DOUBLE_EQ(d.mean[1], 4.0);
  const double c00 = 2.0 + 0.03 * 0.03, c01 = 4.0 / 4.0, c11 = 8.0 + 0.06 * 0.06;
  const double* w = d.root.data();
  const double p[] = {w[0] * w[0] + w[2] * w[2], w[0] * w[1] + w[2] * w[3], w[1] * w[1] + w[3] * w[3]};
  EXPECT_NEAR(p[0] * c00 + p[1] * c01, 1.0, 1e-12);
  EXPECT_NEAR(p[0] * c01 + p[1] * c11, 0.0, 1e-12);
  EXPECT_NEAR(p[1] * c01 + p[2] * c11, 1.0, 1e-12);
  EXPECT_NEAR(d.root[4], 1.0 / 0.03, 1e-9) << "where all agree, the floor is what is left";
}

TEST_F(TrajectoryFile, DemonstrationsMeetOnOneTurnAndEndWithTheShortest) {
  const Demonstration d = estimate_demonstration(
      {run_of({0.1, 0, 0.2, 0, 0.3, 0}), run_of({0.1 + 2 * M_PI, 0, 0.2 + 2 * M_PI, 0})}, pendulum());
  EXPECT_EQ(d.rows, 2u);
  EXPECT_NEAR(d.mean[0], 0.1, 1e-12);
  EXPECT_NEAR(d.mean[2], 0.2, 1e-12);
}

const char* const kHeader = "time_s,position_m,angle_rad,velocity_m_s,rate_rad_s\n";

TEST_F(TrajectoryFile, ReachesTheConfiguration) {
  write("track.csv", std::string(kHeader) + "0,0,3,0,0\n0.04,4,3,0,0\n");
  write("a.csv", std::string(kHeader) + "0,0,3,0,0\n0.1,1,3,0,0\n");
  write("b.csv", std::string(kHeader) + "0,0.2,3,0,0\n0.1,0.8,3,0,0\n");
  const auto read = robot(
      "terminal = \"lqr\"\nreference = \"track.csv\"\ndemonstration = [\"a.csv\", \"b.csv\"]\n"
      "demonstration_weight = 0.5\nsaturating_weight = 3\nsaturating_width = { angle_rad = 0.4 }\n"
      "bounds = { position_m = { low = -1, high = 2, weight = 10 }, velocity_m_s = { high = 3, hard = true } }\n",
      "[[cost.obstacles]]\nx_state = \"position_m\"\ny_state = \"angle_rad\"\nx_m = 1\ny_m = 2\nradius_m = 0.5\nweight = 7\n");
  ASSERT_NE(read, nullptr) << problems_;
  const tiller_cost_config_t& c = read->config.cost;
  EXPECT_EQ(c.terminal, static_cast<std::uint32_t>(tiller_terminal_lqr));
  ASSERT_EQ(c.reference_steps, 3u);
  EXPECT_NEAR(c.reference[4], 2.0, 1e-12);  // half way, one period of 20 ms on
  EXPECT_EQ(c.demonstration_steps, 6u);
  EXPECT_NEAR(c.demonstration_mean[0], 0.1, 1e-12);
  EXPECT_EQ(c.demonstration_weight, 0.5);
  EXPECT_EQ(c.saturating_weight, 3);
  EXPECT_EQ(c.saturating_width[1], 0.4);
  EXPECT_EQ(c.saturating_width[0], INFINITY);
  EXPECT_EQ(c.state_low[0], -1);
  EXPECT_EQ(c.state_high[0], 2);
  EXPECT_EQ(c.state_low[2], -INFINITY);
  EXPECT_EQ(c.state_high[2], 3);
  EXPECT_EQ(c.bound_weight[0], 10);
  EXPECT_EQ(c.hard_bounds, 1u << 2);
  ASSERT_EQ(c.term_count, 1u);
  EXPECT_EQ(c.terms[0].states[1], 1u);
  EXPECT_EQ(c.terms[0].params[2], 0.5);
}

TEST_F(TrajectoryFile, ADistributionOfMeansAndDeviations) {
  write("d.csv",
        "time_s,mean.position_m,mean.angle_rad,mean.velocity_m_s,mean.rate_rad_s,sd.position_m,sd.angle_rad,"
        "sd.velocity_m_s,sd.rate_rad_s\n0,1,2,3,4,0.5,0.25,1,2\n");
  const auto read = robot("demonstration = \"d.csv\"\ndemonstration_weight = 1");
  ASSERT_NE(read, nullptr) << problems_;
  const double* w = read->config.cost.demonstration_root;
  EXPECT_EQ(w[0], 2.0);
  EXPECT_EQ(w[5], 4.0);
  EXPECT_EQ(w[15], 0.5);
  EXPECT_EQ(w[1], 0.0);
}

TEST_F(TrajectoryFile, OneDemonstrationIsNone) {
  write("a.csv", std::string(kHeader) + "0,0,3,0,0\n");
  EXPECT_EQ(robot("demonstration = [\"a.csv\"]\ndemonstration_weight = 1"), nullptr);
  EXPECT_NE(problems_.find("one demonstration has no spread; list several"), std::string::npos) << problems_;
  write("b.csv", std::string(kHeader) + "0,0,3,0,0\n");
  EXPECT_EQ(robot("demonstration = [\"a.csv\", \"b.csv\"]"), nullptr);
  EXPECT_NE(problems_.find("cost.demonstration_weight"), std::string::npos) << problems_;
}

// Every mistake of a trajectory stands at the robot file's line, with the trajectory's own line behind it.
TEST_F(TrajectoryFile, MistakesAreToldThroughTheRobotFile) {
  write("track.csv", std::string(kHeader) + "0,0,3,0,x\n0.1,0,3,nan,0\n");
  EXPECT_EQ(robot("reference = \"track.csv\""), nullptr);
  EXPECT_NE(problems_.find("cost.reference = \"track.csv\": " + folder_ +
                           "/track.csv:2: rate_rad_s = x: is no number; write"),
            std::string::npos)
      << problems_;
  EXPECT_NE(problems_.find("track.csv:3: velocity_m_s = nan"), std::string::npos) << problems_;
}

}  // namespace
}  // namespace tiller::tools
