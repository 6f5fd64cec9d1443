// Episodes: what is carried over, what a resumed or an interrupted series leaves, and how a robot that somebody puts
// back is waited for.

#include "tools/run/episodes.hpp"

#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "episodes_rig.hpp"
#include "read_all.hpp"
#include "tools/base/exit_codes.hpp"
#include "tools/robot/stage_cost.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

using test::Plants;
using test::read_all;
using test::small_robot;

class Episodes : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-episodes-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    options_.run.seconds = 1.0;
    options_.run.quiet = true;
  }
  void TearDown() override { fs::remove_all(folder_); }

  EpisodesResult run(std::uint32_t episodes, const std::string& file) {
    options_.episodes = episodes;
    options_.posterior = file.empty() ? file : folder_ + "/" + file;
    plants_ = Plants{};
    return run_episodes(small_robot(), options_, plants_.open());
  }

  std::string folder_;
  EpisodesOptions options_;
  Plants plants_;
};

TEST_F(Episodes, OnePlantAnotherNoiseASharperPosterior) {
  const EpisodesResult r = run(3, "a.json");
  EXPECT_EQ(r.exit_code, kExitOk);
  ASSERT_EQ(r.rows.size(), 3u);
  EXPECT_EQ(plants_.truths[0], plants_.truths[2]);
  EXPECT_NE(plants_.seeds[0], plants_.seeds[1]);
  EXPECT_NE(plants_.noise_seeds[1], plants_.noise_seeds[2]);
  EXPECT_EQ(plants_.seeds[0], small_robot().config.seed) << "the first episode is what a single run is";
  // three times the data of one episode, from other noise: a deviation falls by 1.7, and at least by 1.2
  for (std::size_t j = 0; j < 2; ++j) EXPECT_LT(r.rows[2].sd[j], r.rows[0].sd[j] / 1.2);
  StoredPosterior stored;
  Words errors;
  ASSERT_TRUE(read_posterior(folder_ + "/a.json", stored, errors)) << join(errors, "\n");
  EXPECT_EQ(stored.episodes, 3u);
  EXPECT_EQ(stored.params, (Words{"pole_mass_kg", "half_length_m"}));
  EXPECT_EQ(stored.is_logarithm, (std::vector<bool>{false, true}));
  EXPECT_NEAR(static_cast<double>(stored.transitions), 150, 3);
}

TEST_F(Episodes, SameSeedSameBits) {
  (void)run(2, "a.json");
  (void)run(2, "b.json");
  options_.run.threads = 2;
  (void)run(2, "c.json");
  EXPECT_EQ(read_all(folder_ + "/a.json"), read_all(folder_ + "/b.json"));
  EXPECT_EQ(read_all(folder_ + "/a.json"), read_all(folder_ + "/c.json"));
}

/// Two episodes, an end of the process, one more: the same file as three in a row.
TEST_F(Episodes, ResumedIsAsIfNeverStopped) {
  (void)run(3, "straight.json");
  (void)run(2, "resumed.json");
  const EpisodesResult r = run(1, "resumed.json");
  EXPECT_EQ(r.rows.at(0).episode, 3u);
  EXPECT_EQ(read_all(folder_ + "/straight.json"), read_all(folder_ + "/resumed.json"));
}

/// Raises SIGINT in its tick `at`.
class Interrupted : public Link {
 public:
  Interrupted(Link& link, int at) : link_(link), at_(at) {}
  Sensed wait(const volatile std::sig_atomic_t& stop) override {
    if (++tick_ == at_) raise(SIGINT);
    return link_.wait(stop);
  }
  tiller_status_t send(const tiller_command_t& c) override { return link_.send(c); }
  bool truth(double* state) const override { return link_.truth(state); }

 private:
  Link& link_;
  int at_, tick_ = 0;
};

TEST_F(Episodes, InterruptedEpisodeIsLeftOut) {
  (void)run(1, "one.json");
  options_.episodes = 5;
  options_.posterior = folder_ + "/cut.json";
  Plants plants;
  const OpenEpisode open = plants.open();
  std::unique_ptr<Interrupted> wrapped;
  int episode = 0;
  const EpisodesResult r = run_episodes(
      small_robot(), options_, [&](const RobotFile& robot, std::vector<double>& truth, std::string& error) {
        wrapped = std::make_unique<Interrupted>(*open(robot, truth, error), ++episode == 2 ? 20 : -1);
        return static_cast<Link*>(wrapped.get());
      });
  EXPECT_EQ(r.rows.size(), 1u);
  EXPECT_TRUE(r.last.interrupted);
  EXPECT_EQ(read_all(folder_ + "/cut.json"), read_all(folder_ + "/one.json"));
}

TEST_F(Episodes, ADamagedFileStopsBeforeAnythingMovesAndIsNotOverwritten) {
  std::ofstream(folder_ + "/bad.json") << "{\"format\": \"tiller post";
  testing::internal::CaptureStderr();
  const EpisodesResult r = run(2, "bad.json");
  const std::string told = testing::internal::GetCapturedStderr();
  EXPECT_EQ(r.exit_code, kExitBadInput);
  EXPECT_TRUE(r.rows.empty());
  EXPECT_TRUE(plants_.truths.empty()) << "a plant was opened";
  EXPECT_NE(told.find("bad.json:1: is no JSON"), std::string::npos) << told;
  EXPECT_EQ(read_all(folder_ + "/bad.json"), "{\"format\": \"tiller post");
}

TEST_F(Episodes, AFileThatCannotBeWrittenStopsNothing) {
  options_.load = false;
  testing::internal::CaptureStderr();
  fs::create_directory(folder_ + "/folder.json");
  const EpisodesResult r = run(2, "folder.json");
  const std::string told = testing::internal::GetCapturedStderr();
  EXPECT_EQ(r.exit_code, kExitLogIncomplete);
  EXPECT_EQ(r.rows.size(), 2u);
  EXPECT_NE(told.find("is a folder"), std::string::npos) << told;
}

TEST_F(Episodes, FrozenHasNothingToCarryOver) {
  RobotFile robot = small_robot();
  robot.config.posterior.enabled = 0;
  options_.episodes = 2;
  Plants plants;
  EXPECT_EQ(run_episodes(robot, options_, plants.open()).rows.size(), 2u);
  options_.posterior = folder_ + "/frozen.json";
  testing::internal::CaptureStderr();
  EXPECT_EQ(run_episodes(robot, options_, plants.open()).exit_code, kExitBadInput);
  EXPECT_NE(testing::internal::GetCapturedStderr().find("nothing is learnt"), std::string::npos);
  EXPECT_FALSE(fs::exists(options_.posterior));
}

/// A robot that hangs elsewhere for a second, is put back, slips once, and then stands still.
class PutBack : public Link {
 public:
  Sensed wait(const volatile std::sig_atomic_t&) override {
    ++tick_;
    Sensed s;
    s.now_us = 1000000 + 20000 * tick_;
    s.fresh = true;
    s.measurement.stamp_us = s.now_us;
    s.measurement.sequence = static_cast<std::uint32_t>(tick_);
    const bool away = tick_ < 50 || (tick_ >= 60 && tick_ < 65);
    s.measurement.value[0] = away ? 0.7 : 0.0001;
    s.measurement.value[1] = away ? 1.0 : -M_PI;  // hanging, a turn further
    return s;
  }
  tiller_status_t send(const tiller_command_t& c) override {
    if (c.state == tiller_state_active && first_active_ == 0) first_active_ = tick_;
    if (first_active_ == 0) moved_ = moved_ || c.value[0] != 0.0;
    return tiller_status_ok;
  }
  bool truth(double*) const override { return false; }
  int tick_ = 0, first_active_ = 0;
  bool moved_ = false;
};

TEST_F(Episodes, ARobotIsWaitedForUntilItStandsAtItsStart) {
  PutBack link;
  RunOptions options;
  options.seconds = 0.2;
  options.quiet = true;
  options.await_start = true;
  const RobotFile robot = small_robot();
  const RunResult r = run_robot(robot, link, options);
  // from tick 65 on it stands still; half a second is 25 ticks
  EXPECT_EQ(link.first_active_, 90);
  EXPECT_FALSE(link.moved_) << "moved by something else than the safe command before it stood at its start";
  EXPECT_LT(r.ticks, 20u) << "it learnt from whoever put the robot back";
}

TEST_F(Episodes, StageCostFollowsTheReference) {
  RobotFile robot = small_robot();
  const double x[4] = {0.0, M_PI + 0.1, 0.0, 0.0}, u[1] = {2.0};
  robot.config.cost.input_weight[0] = 0.5;
  EXPECT_NEAR(stage_cost(robot.config, 0, x, u), 4.0 * std::pow(M_PI - 0.1, 2) + 0.5 * 4.0, 1e-12);
  const double rows[8] = {0, M_PI, 0, 0, 0, 0.1 - M_PI, 0, 0};
  robot.config.cost.reference = rows;
  robot.config.cost.reference_steps = 2;
  EXPECT_NEAR(stage_cost(robot.config, 0, x, u), 4.0 * 0.01 + 2.0, 1e-12);
  EXPECT_NEAR(stage_cost(robot.config, 7, x, u), 2.0, 1e-12);
}

}  // namespace
}  // namespace tiller::tools
