// Parts of the outer loop: numbers in a robot file's text, ranges, the search, the log.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/open/robot_open.hpp"
#include "tools/tune/evolution.hpp"
#include "tools/tune/number_edit.hpp"
#include "tools/tune/trial_log.hpp"

namespace tiller::tools::tune {
namespace {

namespace fs = std::filesystem;

std::string cart_pole() {
  std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/cart_pole.toml", std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

double number_at(const std::string& text, const std::string& path) {
  NumberAt at;
  std::string error;
  EXPECT_TRUE(find_number(text, path, at, error)) << path << ": " << error;
  return at.value;
}

TEST(NumberEdit, ChangesOneNumberAndNothingElse) {
  const std::string before = cart_pole();
  const struct {
    const char *path, *was, *now;
  } cases[] = {{"planner.horizon", "horizon = 50", "horizon = 7"},
               {"planner.noise_sd.force_N", "noise_sd = { force_N = 8 }", "noise_sd = { force_N = 7 }"},
               {"planner.noise_sd", "noise_sd = { force_N = 8 }", "noise_sd = { force_N = 7 }"},
               {"parameters.pole_mass_kg.uniform.1", "uniform = [0.05, 0.15]", "uniform = [0.05, 7]"},
               {"effects.0.damping_SI.uniform.0", "uniform = [0.1, 0.3]", "uniform = [7, 0.3]"},
               {"cost.terminal_weight.angle_rad", "angle_rad = 100.0", "angle_rad = 7"}};
  for (const auto& c : cases) {
    std::string expected = before, text = before, error;
    ASSERT_NE(expected.find(c.was), std::string::npos) << c.was;
    expected.replace(expected.find(c.was), std::string(c.was).size(), c.now);
    EXPECT_TRUE(set_number(text, c.path, "7", error)) << c.path << ": " << error;
    EXPECT_EQ(text, expected) << c.path;
    EXPECT_EQ(number_at(text, c.path), 7.0);
  }
}

TEST(NumberEdit, CountsLettersOfManyBytesAsOne) {
  std::string error;
  std::string text =
      "[planner] # Gr\xC3\xBC\xC3\x9F"
      "e\nnoise_sd = { \"\xC3\xA4\xE2\x82\xAC\" = 1, force_N = 8 } # \xC3\xA9\n";
  EXPECT_TRUE(set_number(text, "planner.noise_sd.force_N", "2.5", error)) << error;
  EXPECT_NE(text.find(", force_N = 2.5 } # \xC3\xA9\n"), std::string::npos) << text;
}

TEST(NumberEdit, AddsAKeyBelowItsSection) {
  std::string text = cart_pole(), error;
  EXPECT_TRUE(set_number(text, "planner.temperature", "0.25", error)) << error;
  EXPECT_EQ(number_at(text, "planner.temperature"), 0.25);
  EXPECT_NE(text.find("[planner]\ntemperature = 0.25\nkind = \"mppi\""), std::string::npos);
  std::string errors;
  EXPECT_NE(parse_robot_file(text, "cart.toml", errors), nullptr) << errors;
  EXPECT_FALSE(set_number(text, "planer.horizon", "3", error));
  EXPECT_NE(error.find("did you mean planner?"), std::string::npos) << error;
}

TEST(SearchKeys, RangesOfBothScales) {
  SearchKey key;
  std::string error;
  ASSERT_TRUE(parse_search("planner.noise_sd.force_N=log:0.5:8", key, error)) << error;
  EXPECT_DOUBLE_EQ(key.value(0), 0.5);
  EXPECT_NEAR(key.value(0.5), 2.0, 1e-12);
  EXPECT_NEAR(key.coordinate(key.value(0.3)), 0.3, 1e-12);
  EXPECT_EQ(key.text(0.5), "2");
  ASSERT_TRUE(parse_search("planner.rollouts=100:300", key, error)) << error;
  ASSERT_TRUE(check_search(cart_pole(), key, error)) << error;
  EXPECT_TRUE(key.whole);
  for (double v = 0; v <= 1; v += 0.01) {
    const double value = key.value(v);
    EXPECT_EQ(std::fmod(value, key.multiple), 0.0) << value;
    EXPECT_TRUE(value >= 100 && value <= 300) << value;
  }
}

TEST(SearchKeys, WhatIsWrongIsToldWithARemedy) {
  const struct {
    const char *argument, *says;
  } wrong[] = {{"planner.horizon", "is no KEY=LOW:HIGH"},
               {"planner.horizon=20", "is no KEY=LOW:HIGH"},
               {"planner.horizon=a:b", "is no KEY=LOW:HIGH"},
               {"planner.horizon=80:20", "write the smaller number first"},
               {"planner.noise_sd=log:0:3", "a logarithm wants a low end above 0"},
               {"planner.horizn=20:80", "did you mean planner.horizon?"},
               {"planer.horizon=20:80", "did you mean planner?"},
               {"limits.force_N.high=5:30", "yours to set"},
               {"planner.horizon=20:1e9", "narrow the range"},
               {"planner.kind=0:3", "no number in the file"},
               {"planner.noise_sd.force=1:2", "did you mean force_N?"},
               {"cost.state_weight=1:2", "name one: cost.state_weight.angle_rad"},
               {"parameters.pole_mas_kg=1:2", "did you mean pole_mass_kg?"},
               {"parameters.pole_mass_kg.uniform=0.1:0.2", "holds several values"},
               {"effects.3.damping_SI=1:2", "the file has no '3' in effects"}};
  for (const auto& w : wrong) {
    SearchKey key;
    std::string error;
    const bool good = parse_search(w.argument, key, error) && check_search(cart_pole(), key, error);
    EXPECT_FALSE(good) << w.argument;
    EXPECT_NE(error.find(w.says), std::string::npos) << error;
    EXPECT_NE(error.find(std::string("--search ") + std::string(w.argument).substr(0, 6)), std::string::npos) << error;
  }
}

TEST(SearchKeys, DefaultsComeFromTheFile) {
  std::string errors;
  const std::string text = cart_pole();
  const auto robot = parse_robot_file(text, "cart.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  Words paths;
  for (const SearchKey& key : default_search(*robot, text)) {
    paths.push_back(key.path);
    EXPECT_NEAR(key.coordinate(number_at(text, key.path)), key.log ? 0.5 : 1.0 / 3, 0.02) << key.path;
  }
  EXPECT_EQ(join(paths),
            "planner.horizon, planner.noise_sd.force_N, cost.input_weight.force_N, cost.input_rate_weight.force_N");
}

double best_of(std::size_t d, std::uint64_t seed, std::size_t evaluations, double (*f)(const double*, std::size_t)) {
  Evolution evolution(std::vector<double>(d, 0.2), 0.25, seed);
  double best = -INFINITY;
  for (std::size_t done = 0; done < evaluations; done += evolution.population()) {
    const std::vector<double> points = evolution.ask();
    std::vector<double> returns;
    for (std::size_t k = 0; k < evolution.population(); ++k) {
      for (std::size_t i = 0; i < d; ++i) EXPECT_TRUE(points[k * d + i] >= 0 && points[k * d + i] <= 1);
      returns.push_back(f(&points[k * d], d));
      best = std::max(best, returns.back());
    }
    evolution.tell(points, returns);
  }
  return best;
}

double ellipsoid(const double* x, std::size_t d) {  // axes from 1 to 100, turned by 45 degrees in each pair
  double sum = 0;
  for (std::size_t i = 0; i < d; ++i) {
    const double a = x[i] - 0.6, b = x[(i + 1) % d] - 0.6;
    sum -= std::pow(100.0, static_cast<double>(i) / static_cast<double>(std::max<std::size_t>(d - 1, 1))) *
           std::pow(d > 1 ? (a + b) / std::sqrt(2.0) + 0.3 * a : a, 2);
  }
  return sum;
}
double ellipsoid_2(const double* x, std::size_t) {
  const double a = x[0] + x[1] - 1.2, b = x[0] - x[1];
  return -100 * a * a - b * b;
}

// CMA-ES gains a decade of distance, two of the value, in about 10 to 20 d generations once it has learnt the axes.
TEST(Evolution, ConvergesOnTurnedEllipsoids) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    EXPECT_GT(best_of(1, seed, 120, ellipsoid), -1e-6) << seed;
    EXPECT_GT(best_of(2, seed, 400, ellipsoid_2), -1e-6) << seed;
    EXPECT_GT(best_of(4, seed, 1600, ellipsoid), -1e-6) << seed;
  }
}

TEST(Evolution, RefusedTrialsRankLastAndBoundsHold) {
  const auto corner = [](const double* x, std::size_t) { return x[0] > 0.9 ? -INFINITY : x[0] + x[1]; };
  EXPECT_GT(best_of(2, 5, 300, corner), 1.85) << "the best lies at (.9, 1), beside what is refused and on the face";
}

TEST(Evolution, SameSeedSameBits) {
  EXPECT_EQ(best_of(3, 7, 60, ellipsoid), best_of(3, 7, 60, ellipsoid));
  EXPECT_NE(best_of(3, 7, 60, ellipsoid), best_of(3, 8, 60, ellipsoid));
}

class Log : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-tune-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    path_ = folder_ + "/log.csv";
  }
  void TearDown() override { fs::remove_all(folder_); }
  Trial trial(double a) const {
    Trial t;
    t.values = {number_text(a)};
    t.scores = {-a / 3, -a * 1e-17, -INFINITY};
    t.safe = 1;
    return t;
  }
  std::string folder_, path_, error_;
  std::vector<SearchKey> keys_ = {{"planner.horizon", 10, 40, false, true, 1}};
};

TEST_F(Log, GoesOnBehindTheLastWholeRow) {
  Trial refused;
  refused.values = {"12"};
  refused.refused = "cart.toml:3: horizon = 12: too short, or so\nsecond line";
  {
    TrialLog log;
    ASSERT_TRUE(log.create(path_, "settings", keys_, 3, error_)) << error_;
    ASSERT_TRUE(log.add(trial(11), error_) && log.add(refused, error_) && log.add(trial(13), error_)) << error_;
  }
  const auto whole = fs::file_size(path_);
  std::ofstream(path_, std::ios::app) << "4,14,-0.2";  // cut off by a loss of power
  TrialLog log;
  ASSERT_TRUE(log.resume(path_, "settings", keys_, 3, error_)) << error_;
  EXPECT_EQ(fs::file_size(path_), whole);
  ASSERT_EQ(log.trials().size(), 3u);
  EXPECT_EQ(log.trials()[2].scores, trial(13).scores) << "to the last bit";
  EXPECT_EQ(log.trials()[2].safe, 1);
  EXPECT_EQ(log.trials()[1].mean(), -INFINITY);
  EXPECT_FALSE(log.trials()[1].refused.empty());
  ASSERT_TRUE(log.add(trial(14), error_)) << error_;
  TrialLog again;
  ASSERT_TRUE(again.resume(path_, "settings", keys_, 3, error_)) << error_;
  EXPECT_EQ(again.trials().size(), 4u);
}

TEST_F(Log, NeitherOverwritesNorMixes) {
  {
    TrialLog log;
    ASSERT_TRUE(log.create(path_, "settings", keys_, 3, error_)) << error_;
    ASSERT_TRUE(log.add(trial(11), error_));
  }
  TrialLog second, other, seeds;
  EXPECT_FALSE(second.create(path_, "settings", keys_, 3, error_));
  EXPECT_NE(error_.find("--resume"), std::string::npos) << error_;
  EXPECT_FALSE(other.resume(path_, "settings of another file", keys_, 3, error_));
  EXPECT_NE(error_.find("other settings"), std::string::npos) << error_;
  EXPECT_FALSE(seeds.resume(path_, "settings", keys_, 4, error_));
  TrialLog device;
  EXPECT_FALSE(device.resume("/dev/zero", "settings", keys_, 3, error_));
  EXPECT_NE(error_.find("/dev/zero"), std::string::npos) << error_;
}

}  // namespace
}  // namespace tiller::tools::tune
