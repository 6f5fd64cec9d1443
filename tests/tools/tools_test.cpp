// The parts of the command that are no robot file: text, threads, output that must not be lost, logs, records.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "read_all.hpp"
#include "robot_text.hpp"
#include "tiller/config.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/text.hpp"
#include "tools/base/thread_pool.hpp"
#include "tools/links/latency_watch.hpp"
#include "tools/links/model_plant.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/logs/run_log.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/export_config.hpp"
#include "tools/run/progress.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

using test::read_all;

std::string news_after(LatencyWatch& watch, int measurements, std::uint32_t told_us, double seen_us) {
  std::string news;
  for (int k = 0; k < measurements; ++k) {
    watch.note(told_us, seen_us);
    news += watch.news(true);
  }
  return news;
}

TEST(LatencyWatch, AnUntoldLatencyThatMattersIsToldOnce) {
  LatencyWatch watch(0.02);
  EXPECT_EQ(news_after(watch, 49, 0, 1900), "") << "the first ones come while caches are cold";
  const std::string news = news_after(watch, 1000, 0, 1900);
  EXPECT_NE(news.find("1.90 ms from stamp to departure are accounted for, 9.5 % of the period"), std::string::npos)
      << news;
  EXPECT_NE(news.find("docs/guide/lcm.md"), std::string::npos);
  EXPECT_EQ(news.find("measurements do not tell", 1), std::string::npos) << "once: " << news;
  LatencyWatch bus(0.02);
  for (int k = 0; k < 50; ++k) bus.note(0, 1900);
  EXPECT_NE(bus.news(false).find("input_delay"), std::string::npos);
}

TEST(LatencyWatch, WhatIsToldOrDoesNotMatterIsNoNews) {
  LatencyWatch told(0.02), small(0.02);
  told.note(0, 1900);  // a plant that measures it does not know it yet at first
  EXPECT_EQ(news_after(told, 1000, 2500, 1900), "");
  EXPECT_EQ(news_after(small, 1000, 0, 390), "") << "below 2 % of the period";
}

class Scratch : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    fs::create_directory(folder_ + "/tmp");
    setenv("TMPDIR", (folder_ + "/tmp").c_str(), 1);  // where rescued copies go
  }
  void TearDown() override {
    unsetenv("TMPDIR");
    fs::remove_all(folder_);
  }
  std::string folder_;
};

TEST(Text, NearestFindsTypingErrorsAndMissingUnits) {
  const Words known = {"horizon", "knots", "rollouts", "pole_mass_kg", "angle_rad"};
  EXPECT_EQ(nearest("horzion", known), "horizon");
  EXPECT_EQ(nearest("knot", known), "knots");
  EXPECT_EQ(nearest("pole_mass", known), "pole_mass_kg");
  EXPECT_EQ(nearest("angle", known), "angle_rad");
  EXPECT_EQ(nearest("temperature", known), "");
  EXPECT_EQ(edit_distance("ab", "ba"), 1u);
  EXPECT_EQ(edit_distance("", "abc"), 3u);
}

TEST(Text, NumbersReadBackExactly) {
  for (const double value : {0.1, 1.0 / 3.0, 20.0, 1e-300, 1e6, -0.0, 3.141592653589793, 12345678.9}) {
    EXPECT_EQ(std::strtod(number_text(value).c_str(), nullptr), value) << number_text(value);
  }
  EXPECT_EQ(number_text(20), "20");
  EXPECT_EQ(number_text(0.05), "0.05");
}

TEST(ThreadPool, DoesEveryIndexOnce) {
  for (const unsigned threads : {1u, 2u, 5u}) {
    ThreadPool pool(threads);
    std::vector<std::atomic<int>> done(1000);
    const auto work = [](void* arg, std::uint32_t i) { ++(*static_cast<std::vector<std::atomic<int>>*>(arg))[i]; };
    for (const std::uint32_t n : {0u, 1u, 2u, 17u, 1000u}) {
      for (int repeat = 0; repeat < 200; ++repeat) pool.run(n, work, &done);
    }
    // index i took part in every run of more than i
    EXPECT_EQ(done[0], 800) << threads;
    EXPECT_EQ(done[1], 600) << threads;
    EXPECT_EQ(done[16], 400) << threads;
    EXPECT_EQ(done[999], 200) << threads;
  }
}

TEST_F(Scratch, OutputFileWritesAndMakesFolders) {
  OutputFile file;
  file.open(folder_ + "/a/b/log.csv");
  file.write("one\n");
  file.flush();
  EXPECT_EQ(read_all(folder_ + "/a/b/log.csv"), "one\n");
  file.write("two\n");
  EXPECT_TRUE(file.close());
  EXPECT_EQ(file.message(), "");
  EXPECT_EQ(read_all(file.readable_path()), "one\ntwo\n");
}

// Root may write anywhere, so the test gives the right up for as long as it needs to be refused.
class AsNobody {
 public:
  AsNobody() : was_root_(geteuid() == 0) {
    if (was_root_) changed_ = seteuid(65534) == 0;
  }
  ~AsNobody() {
    if (changed_) (void)!seteuid(0);
  }
  bool refused() const { return !was_root_ || changed_; }

 private:
  bool was_root_;
  bool changed_ = false;
};

TEST_F(Scratch, ReadOnlyFolderLosesNothing) {
  fs::permissions(folder_, fs::perms::all);
  fs::permissions(folder_ + "/tmp", fs::perms::all);
  fs::create_directory(folder_ + "/closed");
  fs::permissions(folder_ + "/closed", fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_exec);
  OutputFile file;
  {
    const AsNobody nobody;
    ASSERT_TRUE(nobody.refused());
    file.open(folder_ + "/closed/log.csv");
    EXPECT_FALSE(file.complete());
    for (int i = 0; i < 1000; ++i) {
      file.write(std::to_string(i) + "\n");
      file.flush();
    }
    EXPECT_FALSE(file.close());
  }
  std::printf("%s\n", file.message().c_str());
  EXPECT_NE(file.message().find(folder_ + "/closed/log.csv: cannot be created: Permission denied"), std::string::npos);
  ASSERT_NE(file.readable_path(), "") << "nothing was rescued";
  const std::string rescued = read_all(file.readable_path());
  EXPECT_EQ(rescued.substr(0, 4), "0\n1\n");
  EXPECT_EQ(std::count(rescued.begin(), rescued.end(), '\n'), 1000);
}

TEST_F(Scratch, FullDiskIsToldAndRescued) {
  OutputFile file;
  file.open("/dev/full");  // every write fails with ENOSPC
  file.write("row\n");
  file.flush();
  EXPECT_FALSE(file.complete());
  EXPECT_FALSE(file.close());
  std::printf("%s\n", file.message().c_str());
  EXPECT_NE(file.message().find("No space left on device"), std::string::npos);
  EXPECT_NE(file.message().find("incomplete"), std::string::npos);
  EXPECT_EQ(read_all(file.readable_path()), "row\n");
}

TEST_F(Scratch, NothingWritableAnywhereIsSaidPlainly) {
  setenv("TMPDIR", "/proc", 1);
  OutputFile file;
  file.open("/dev/full");
  file.write("row\n");
  EXPECT_FALSE(file.close());
  EXPECT_EQ(file.readable_path(), "");
  EXPECT_NE(file.message().find("free space, or name another folder"), std::string::npos) << file.message();
}

std::unique_ptr<RobotFile> good() {
  std::string errors;
  auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot;
}

TEST(RunLog, HeaderNamesEveryColumnOnce) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  const RunLog log(*robot, true, std::vector<double>(robot->names.params.size(), 1.0));
  const std::string header = log.header();
  EXPECT_EQ(header.rfind("time_s,position_m,angle_rad,force_N,mean.position_m,", 0), 0u) << header;
  for (const char* column : {",sd.rate_rad_s,", ",mean.cart.damping_SI,", ",q05.pole_mass_kg,", ",q95.half_length_m,",
                             ",ess,", ",tick_us,", ",deadline_us,", ",state,status,", ",true.angle_rad,"}) {
    EXPECT_NE(header.find(column), std::string::npos) << column;
  }
  EXPECT_EQ(header.find("cart_mass_kg"), std::string::npos) << "a fixed parameter needs no column";
}

TEST_F(Scratch, RunLogRowsHaveTheHeadersColumns) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  RunLog log(*robot, false, {});
  log.open(folder_ + "/run.csv");
  LoggedTick tick;
  tick.info.plan_cost = NAN;
  log.add(tick);  // no measurement, a cost that is not a number: empty fields, not words
  ASSERT_TRUE(log.close());
  std::istringstream lines(read_all(folder_ + "/run.csv"));
  std::string header;
  std::string row;
  std::getline(lines, header);
  std::getline(lines, row);
  EXPECT_EQ(std::count(header.begin(), header.end(), ','), std::count(row.begin(), row.end(), ','));
  EXPECT_EQ(row.rfind("0.000000,,,0,", 0), 0u) << row;
  EXPECT_EQ(row.find("nan"), std::string::npos);
}

TEST(Progress, BlockTellsWhatARunIsWatchedFor) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  Progress progress(*robot, Progress::Style::silent, 12, {1, 0.1, 0.5, 0.2, 0.01});
  LoggedTick tick;
  tick.info.state = tiller_state_active;
  tick.info.effective_samples = 97;
  tick.info.param_mean[1] = 0.1;
  tick.info.param_sd[1] = 0.004;
  tick.time_s = 3;
  tick.tick_us = 1234;
  tick.q05[1] = 0.09;
  tick.q95[1] = 0.11;
  for (const std::string& text : {progress.block(tick), progress.line(tick)}) {
    for (const char* part :
         {"3.00", "12 s", "ACTIVE", "angle_rad", "cost", "pole_mass_kg", "0.1 +- 0.004", "97", "1.23 ms"}) {
      EXPECT_NE(text.find(part), std::string::npos) << part << " in\n" << text;
    }
  }
  EXPECT_NE(progress.block(tick).find("true 0.1"), std::string::npos);
}

TEST_F(Scratch, RecordFilesRefuseWhatTheyAreNot) {
  tiller::Config config;
  std::shared_ptr<const JointPrior> joint;
  std::vector<RecordEntry> entries;
  std::string error;
  EXPECT_FALSE(read_record_file(folder_ + "/none.rec", config, joint, entries, error));
  EXPECT_NE(error.find("No such file"), std::string::npos);
  std::ofstream(folder_ + "/short.rec") << "TILL";
  EXPECT_FALSE(read_record_file(folder_ + "/short.rec", config, joint, entries, error));
  EXPECT_NE(error.find("is no record of tiller"), std::string::npos);
  OutputFile file;
  file.open(folder_ + "/cut.rec");
  write_record_header(file, good()->config);
  write_record(file, RecordEntry{});
  file.write("half an entry");
  ASSERT_TRUE(file.close());
  error.clear();
  EXPECT_TRUE(read_record_file(folder_ + "/cut.rec", config, joint, entries, error)) << error;
  EXPECT_EQ(entries.size(), 1u) << "a record that was cut off keeps its whole ticks";
  EXPECT_EQ(config.prior_mixture, nullptr);

  // a joint prior goes with the record: the file that it came from may be another by then
  const auto robot = good();
  const JointPrior carried(3, {1.0}, {0.1, 0.5, -1.5}, {0.01, 0, 0, 0.02, 0.03, 0, 0, 0, 0.4});
  robot->config.prior_mixture = &carried.mixture;
  OutputFile with_prior;
  with_prior.open(folder_ + "/prior.rec");
  write_record_header(with_prior, robot->config);
  write_record(with_prior, RecordEntry{});
  ASSERT_TRUE(with_prior.close());
  entries.clear();
  ASSERT_TRUE(read_record_file(folder_ + "/prior.rec", config, joint, entries, error)) << error;
  ASSERT_EQ(config.prior_mixture, &joint->mixture);
  EXPECT_EQ(joint->weight, carried.weight);
  EXPECT_EQ(joint->mean, carried.mean);
  EXPECT_EQ(joint->root, carried.root);
}

// The uniform draw is exact; the others are checked against their means over 20,000 draws, whose standard error is
// sd / 141: the bands are four of these.
TEST(Draw, FollowsThePriors) {
  struct Lcg {
    std::uint64_t state = 1;
  } lcg;
  const auto uniform = [](void* context) {
    auto& g = *static_cast<Lcg*>(context);
    g.state = g.state * 6364136223846793005ull + 1442695040888963407ull;
    return (static_cast<double>(g.state >> 11) + 0.5) * 0x1p-53;
  };
  const auto mean_of = [&](const tiller_prior_t& prior) {
    double sum = 0;
    for (int i = 0; i < 20000; ++i) {
      const double value = draw_from_prior(prior, uniform, &lcg);
      EXPECT_GE(value, prior.low);
      EXPECT_LE(value, prior.high);
      sum += value;
    }
    return sum / 20000;
  };
  EXPECT_EQ(mean_of({tiller_prior_fixed, 0, 3, 0, 3, 3}), 3);
  EXPECT_NEAR(mean_of({tiller_prior_uniform, 0, 1, 3, 1, 3}), 2, 4 * 0.577 / 141);
  EXPECT_NEAR(mean_of({tiller_prior_normal, 0, 5, 2, -INFINITY, INFINITY}), 5, 4 * 2.0 / 141);
  // mean of a log-normal: median exp(s^2 / 2); its sd here is 0.604
  EXPECT_NEAR(mean_of({tiller_prior_log_normal, 0, 1, 0.5, 0, INFINITY}), std::exp(0.125), 4 * 0.604 / 141);
}

/// A goal is no force in the plant either, and what the file knows of its servo is the truth there.
TEST(ModelPlants, HaveTheRobotFilesServos) {
  std::string errors, error;
  const auto robot = parse_robot_file(
      "[model]\nname = \"pendulum\"\nperiod_s = 0.02\n[parameters]\nmass_kg = 0.5\nlength_m = 0.4\n"
      "damping_Nms = 0.01\n[[effects]]\nkind = \"position_servo\"\nport = \"torque_Nm\"\n"
      "stiffness_SI = { uniform = [20, 60] }\ndamping_SI = 2\nlimit_SI = 0\n[measurement]\nangle_rad = { sd = 0.001 }\n"
      "[start]\nstate = { angle_rad = 0 }\n[planner]\nkind = \"mppi\"\n[cost]\ntarget = { angle_rad = 1 }\n"
      "state_weight = { angle_rad = 1 }\n[limits]\ntorque_Nm = { low = -2, high = 2, safe = 0 }\n"
      "[safety]\nsensor_timeout_s = 0.1\n[sim]\nplant = \"model\"\n",
      "servo.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const auto plant = ModelPlant::make(*robot, error);
  ASSERT_NE(plant, nullptr) << error;
  EXPECT_EQ(plant->true_params()[3], 40.0);
  const double goal = 0.8;
  for (int k = 0; k < 100; ++k) plant->advance(&goal);
  // at rest the servo holds the pendulum's weight: stiffness (goal - q) = m g l sin q
  const double q = plant->state()[0];
  EXPECT_NEAR(40.0 * (goal - q), 0.5 * 9.81 * 0.4 * std::sin(q), 1e-3);
}

}  // namespace
}  // namespace tiller::tools
