// Posterior files: written whole or not at all, read with suspicion.

#include "tools/robot/posterior_file.hpp"
#include "read_all.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "robot_text.hpp"
#include "tools/base/output_file.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

using test::read_all;

std::unique_ptr<RobotFile> good_robot() {
  std::string errors;
  auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot;
}

/// What the robot of robot_text.hpp could have learnt: two components, every digit of a double in use.
StoredPosterior good_posterior() {
  StoredPosterior p;
  p.model = "cart_pole";
  p.params = {"pole_mass_kg", "half_length_m", "cart.damping_SI"};
  p.is_logarithm = {false, false, true};
  p.mixture.dimension = 3;
  p.mixture.weight = {1.0 / 3, 2.0 / 3};
  p.mixture.mean = {0.1, 0.5, std::log(0.2), 0.09 + 1e-17, 1.0 / 1.9, std::log(0.21)};
  p.mixture.covariance = {1e-4 / 3, 1e-5, 0, 1e-5, 2e-4, 0, 0, 0, 0.1 / 7, 1e-4, 0, 1e-5, 0, 1e-4, 0, 1e-5, 0, 0.01};
  p.robot = "bench \"one\"\n";
  p.created_by = "tiller 0.1";
  p.episodes = 3;
  p.transitions = 1234567890123;
  p.particles = 256;
  p.effective_samples = 200.25;
  p.noise_scale = 1.1;
  p.exponent = 1;
  return p;
}

class PosteriorFile : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-posterior-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    path_ = folder_ + "/cart.posterior.json";
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::size_t files() const {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder_)) ++count;
    return count;
  }

  std::string folder_, path_;
};

TEST_F(PosteriorFile, ComesBackToTheLastBit) {
  const StoredPosterior p = good_posterior();
  std::string error;
  ASSERT_TRUE(save_posterior(path_, p, error)) << error;
  StoredPosterior q;
  Words errors;
  ASSERT_TRUE(read_posterior(path_, q, errors)) << join(errors, "\n");
  EXPECT_EQ(p.model, q.model);
  EXPECT_EQ(p.params, q.params);
  EXPECT_EQ(p.is_logarithm, q.is_logarithm);
  EXPECT_EQ(p.mixture.weight, q.mixture.weight);
  EXPECT_EQ(p.mixture.mean, q.mixture.mean);
  EXPECT_EQ(p.mixture.covariance, q.mixture.covariance);
  EXPECT_EQ(p.robot, q.robot);
  EXPECT_EQ(p.created_by, q.created_by);
  EXPECT_EQ(p.episodes, q.episodes);
  EXPECT_EQ(p.transitions, q.transitions);
  EXPECT_EQ(p.particles, q.particles);
  EXPECT_EQ(p.effective_samples, q.effective_samples);
  EXPECT_EQ(p.noise_scale, q.noise_scale);
  EXPECT_EQ(p.exponent, q.exponent);
  EXPECT_EQ(posterior_text(p), posterior_text(q));
  EXPECT_EQ(files(), 1u) << "a temporary file is left";
}

struct Spoiled {
  const char* from;  ///< text of the good file
  const char* to;
  std::vector<const char*> told;  ///< parts of the errors
};

TEST_F(PosteriorFile, WhatIsWrongIsNamed) {
  const std::string good = posterior_text(good_posterior());
  const Spoiled cases[] = {
      {"\"tiller posterior\"", "\"tiller prior\"", {"format = \"tiller prior\"", "is no posterior of tiller"}},
      {"\"version\": 1", "\"version\": 2", {"version = 2", "reads version 1", "the tiller that wrote it"}},
      {"\"version\": 1", "\"version\": \"1\"", {"version = \"1\""}},
      {"\"model\": \"cart_pole\"", "\"model\": 3", {"model = 3", "is not a model's name"}},
      {"\"model\"", "\"modle\"", {"model: is missing", "modle = \"cart_pole\": is unknown"}},
      {"\"logarithm\"", "\"log\"", {"parameters[3].coordinate = \"log\"", "\"value\" or \"logarithm\""}},
      {"\"half_length_m\"", "\"pole_mass_kg\"", {"parameters[2].name = \"pole_mass_kg\"", "twice"}},
      {"0.3333333333333333", "0.3333333", {"mixture: the weights' sum is"}},
      {"0.3333333333333333", "-0.1", {"mixture[1].weight = -0.1", "number in [0, 1]"}},
      {"0.3333333333333333", "null", {"mixture[1].weight = null"}},  // how a NaN would be written
      {"0.01\n", "-0.01\n", {"mixture[2].covariance = array", "not positive definite"}},
      {"0.01\n", "1e999\n", {"out_of_range"}},
      {"0.01\n", "NaN\n", {"is no JSON"}},
      {"0.01\n", "\"0.01\"\n", {"mixture[2].covariance", "finite numbers"}},
      {"0.5,", "0.5, 0.5,", {"mixture[1].mean = array", "a list of 3 finite numbers"}},
      {"\"episodes\": 3", "\"episodes\": -3", {"source.episodes = -3", "whole number"}},
      {"\"episodes\": 3", "\"episodes\": 4", {"checksum = \"fnv1a-", "damaged or changed by hand", "delete the line"}},
      {"0.5,", "0.6,", {"checksum"}},
      {"\"checksum\": \"", "\"checksum\": \"0", {"checksum"}},
      {"\"noise_scale\": 1.1,", "", {"source.noise_scale: is missing"}},
      {"\"source\"", "\"sauce\"", {"source: is missing", "sauce = object: is unknown"}},
  };
  for (const Spoiled& c : cases) {
    std::string text = good;
    const std::size_t at = text.find(c.from);
    ASSERT_NE(at, std::string::npos) << c.from;
    text.replace(at, std::string(c.from).size(), c.to);
    StoredPosterior out;
    Words errors;
    EXPECT_FALSE(parse_posterior(text, "cart.json", out, errors)) << c.to;
    const std::string told = join(errors, "\n");
    for (const char* part : c.told) EXPECT_NE(told.find(part), std::string::npos) << part << " in\n" << told;
    for (const std::string& error : errors) {
      EXPECT_EQ(error.rfind("cart.json", 0), 0u) << error;
      EXPECT_NE(error.find("; "), std::string::npos) << "no remedy in " << error;
    }
  }
}

/// Cut off after any number of bytes: never taken. (The last byte is a line's end: without it the file is whole.)
TEST_F(PosteriorFile, EveryTruncationIsRefused) {
  const std::string good = posterior_text(good_posterior());
  for (std::size_t size = 0; size + 1 < good.size(); ++size) {
    StoredPosterior out;
    Words errors;
    ASSERT_FALSE(parse_posterior(good.substr(0, size), "cart.json", out, errors)) << size;
  }
}

/// Any one byte changed: refused, or the same numbers (white space, 1e-05 for 1e-5).
TEST_F(PosteriorFile, NoChangedByteGoesUnseen) {
  const std::string good = posterior_text(good_posterior());
  for (std::size_t at = 0; at < good.size(); ++at) {
    std::string text = good;
    text[at] = static_cast<char>(text[at] ^ (1 << (at % 7)));
    StoredPosterior out;
    Words errors;
    if (!parse_posterior(text, "cart.json", out, errors)) continue;
    EXPECT_EQ(posterior_text(out), good) << at;
  }
}

TEST_F(PosteriorFile, AnyDepthAndAnySizeAreRefused) {
  StoredPosterior out;
  Words errors;
  EXPECT_FALSE(parse_posterior(std::string(500000, '['), "deep.json", out, errors));
  std::string deep = posterior_text(good_posterior());
  const std::size_t at = deep.find("0.5,");
  deep.replace(at, 4, std::string(200000, '[') + std::string(200000, ']') + ",");
  EXPECT_FALSE(parse_posterior(deep, "deep.json", out, errors));
  std::ofstream(path_) << std::string(3 << 20, ' ');
  errors.clear();
  EXPECT_FALSE(read_posterior(path_, out, errors));
  EXPECT_NE(errors.at(0).find("more than any posterior"), std::string::npos);
}

TEST_F(PosteriorFile, WrittenByHandNeedsNoChecksum) {
  std::string text = posterior_text(good_posterior());
  const std::size_t at = text.find(",\n  \"checksum\"");
  ASSERT_NE(at, std::string::npos);
  text = text.substr(0, at) + "\n}\n";
  StoredPosterior out;
  Words errors;
  EXPECT_TRUE(parse_posterior(text, "hand.json", out, errors)) << join(errors, "\n");
}

TEST_F(PosteriorFile, FoldersDevicesAndMissingFilesAreTold) {
  StoredPosterior out;
  Words errors;
  EXPECT_FALSE(read_posterior(folder_, out, errors));
  EXPECT_FALSE(read_posterior("/dev/zero", out, errors));
  EXPECT_FALSE(read_posterior(folder_ + "/none.json", out, errors));
  ASSERT_EQ(errors.size(), 3u);
  EXPECT_NE(errors[0].find("is a folder"), std::string::npos);
  EXPECT_NE(errors[1].find("no ordinary file"), std::string::npos);
  EXPECT_NE(errors[2].find("No such file"), std::string::npos);
}

TEST_F(PosteriorFile, BecomesThePriorOfItsRobotInTheRobotsOrder) {
  StoredPosterior p = good_posterior();
  const auto robot = good_robot();
  Words errors;
  ASSERT_TRUE(take_prior(p, "cart.json", *robot, errors)) << join(errors, "\n");
  const char* field = nullptr;
  EXPECT_EQ(tiller_config_check(&robot->config, &field), tiller_status_ok) << field;
  const std::vector<double> straight = robot->memory.joint->mean;

  StoredPosterior turned = p;  // parameters 3, 1, 2
  const std::size_t from[3] = {2, 0, 1};
  for (std::size_t i = 0; i < 3; ++i) {
    turned.params[i] = p.params[from[i]];
    turned.is_logarithm[i] = p.is_logarithm[from[i]];
    for (std::size_t c = 0; c < 2; ++c) {
      turned.mixture.mean[c * 3 + i] = p.mixture.mean[c * 3 + from[i]];
      for (std::size_t j = 0; j < 3; ++j)
        turned.mixture.covariance[(c * 3 + i) * 3 + j] = p.mixture.covariance[(c * 3 + from[i]) * 3 + from[j]];
    }
  }
  const auto other = good_robot();
  ASSERT_TRUE(take_prior(turned, "cart.json", *other, errors)) << join(errors, "\n");
  EXPECT_EQ(other->memory.joint->mean, straight);
  EXPECT_EQ(other->memory.joint->root, robot->memory.joint->root);
}

TEST_F(PosteriorFile, OfAnotherRobotIsRefused) {
  struct Case {
    void (*spoil)(StoredPosterior&);
    std::vector<const char*> told;
  };
  const Case cases[] = {
      {[](StoredPosterior& p) { p.model = "pendulum"; }, {"model = \"pendulum\"", "cart_pole"}},
      {[](StoredPosterior& p) { p.params[1] = "length_m"; },
       {"has nothing of half_length_m", "holds length_m, which has no prior"}},
      {[](StoredPosterior& p) { p.is_logarithm[2] = false; },
       {"cart.damping_SI: is kept as a value", "uniform or normal"}},
      {[](StoredPosterior& p) { p.is_logarithm[0] = true; }, {"pole_mass_kg: is kept as a logarithm", "log_normal"}},
      {[](StoredPosterior& p) { p.mixture.mean[3] = 0.16; }, {"mixture[2].mean: pole_mass_kg = 0.16", "outside"}},
      {[](StoredPosterior& p) { p.mixture.mean[2] = 0.8; }, {"cart.damping_SI = 2.2", "outside"}},
  };
  for (const Case& c : cases) {
    StoredPosterior p = good_posterior();
    c.spoil(p);
    const auto robot = good_robot();
    Words errors;
    EXPECT_FALSE(take_prior(p, "cart.json", *robot, errors));
    EXPECT_EQ(robot->config.prior_mixture, nullptr);
    const std::string told = join(errors, "\n");
    for (const char* part : c.told) EXPECT_NE(told.find(part), std::string::npos) << part << " in\n" << told;
  }
}

TEST_F(PosteriorFile, StandsInTheRobotFile) {
  std::string error, errors;
  ASSERT_TRUE(save_posterior(path_, good_posterior(), error)) << error;
  std::string text = test::kGoodRobot;
  text.replace(text.find("[posterior]\n"), 12, "[posterior]\nprior_file = \"cart.posterior.json\"\n");
  const auto robot = parse_robot_file(text, folder_ + "/bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  ASSERT_NE(robot->config.prior_mixture, nullptr);
  EXPECT_EQ(robot->config.prior_mixture->components, 2u);
  EXPECT_EQ(robot->config.prior_mixture->dimension, 3u);

  StoredPosterior other = good_posterior();
  other.model = "pendulum";
  ASSERT_TRUE(save_posterior(path_, other, error)) << error;
  EXPECT_EQ(parse_robot_file(text, folder_ + "/bench.toml", errors), nullptr);
  for (const char* part : {"bench.toml:", "posterior.prior_file = \"cart.posterior.json\"", "model = \"pendulum\""})
    EXPECT_NE(errors.find(part), std::string::npos) << part << " in\n" << errors;
}

TEST_F(PosteriorFile, UnusableOnesAreNotWritten) {
  std::string error;
  ASSERT_TRUE(save_posterior(path_, good_posterior(), error)) << error;
  const std::string before = read_all(path_);
  StoredPosterior bad = good_posterior();
  bad.mixture.mean[0] = NAN;
  EXPECT_FALSE(save_posterior(path_, bad, error));
  EXPECT_NE(error.find("not written"), std::string::npos);
  bad = good_posterior();
  bad.mixture.covariance[0] = -1.0;
  EXPECT_FALSE(save_posterior(path_, bad, error));
  EXPECT_EQ(read_all(path_), before);
}

/// The disk is full in the middle of the file (here: a limit on the file's size, which needs no rights to set).
TEST_F(PosteriorFile, FullDiskLeavesTheOldFile) {
  std::string error;
  ASSERT_TRUE(save_posterior(path_, good_posterior(), error)) << error;
  const std::string before = read_all(path_);
  StoredPosterior next = good_posterior();
  next.episodes = 4;
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  rlimit old{}, small{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old), 0);
  small = old;
  small.rlim_cur = 700;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const bool written = save_posterior(path_, next, error);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &old), 0);
  std::signal(SIGXFSZ, ignored);
  EXPECT_FALSE(written);
  EXPECT_NE(error.find("cannot be written"), std::string::npos) << error;
  EXPECT_NE(error.find("stands there still"), std::string::npos) << error;
  EXPECT_EQ(read_all(path_), before);
  EXPECT_EQ(files(), 1u);
  ASSERT_TRUE(save_posterior(path_, next, error)) << error;
}

TEST_F(PosteriorFile, WhereNoFileCanStandIsTold) {
  std::string error;
  const StoredPosterior p = good_posterior();
  fs::create_directory(path_);
  EXPECT_FALSE(save_posterior(path_, p, error));
  EXPECT_NE(error.find("is a folder"), std::string::npos) << error;
  EXPECT_FALSE(save_posterior("/dev/full", p, error));
  EXPECT_NE(error.find("no ordinary file"), std::string::npos) << error;
  EXPECT_FALSE(fs::exists("/dev/.full.tmp"));
  EXPECT_FALSE(save_posterior("/proc/none/cart.json", p, error));
  EXPECT_NE(error.find("/proc/none/cart.json: cannot be created"), std::string::npos) << error;
  if (geteuid() != 0) {
    const std::string closed = folder_ + "/closed";
    fs::create_directory(closed);
    ASSERT_EQ(chmod(closed.c_str(), 0555), 0);
    EXPECT_FALSE(save_posterior(closed + "/cart.json", p, error));
    EXPECT_NE(error.find("Permission denied"), std::string::npos) << error;
  }
  EXPECT_TRUE(save_posterior(folder_ + "/made/for/it/cart.json", p, error)) << error;
}

TEST_F(PosteriorFile, AnotherWriterIsNotDisturbed) {
  std::string error;
  const int other = open((folder_ + "/.cart.posterior.json.tmp").c_str(), O_RDWR | O_CREAT, 0666);
  ASSERT_EQ(flock(other, LOCK_EX), 0);
  ASSERT_EQ(write(other, "half", 4), 4);
  EXPECT_FALSE(save_posterior(path_, good_posterior(), error));
  EXPECT_NE(error.find("another process is writing it"), std::string::npos) << error;
  EXPECT_FALSE(fs::exists(path_));
  close(other);  // it died: what it left is used again
  EXPECT_TRUE(save_posterior(path_, good_posterior(), error)) << error;
  EXPECT_EQ(files(), 1u);
}

TEST_F(PosteriorFile, LinksGoOnPointing) {
  std::string error;
  fs::create_directory(folder_ + "/shelf");
  const std::string target = folder_ + "/shelf/real.json";
  std::ofstream(target) << "old";
  fs::create_symlink(target, path_);
  ASSERT_TRUE(save_posterior(path_, good_posterior(), error)) << error;
  EXPECT_TRUE(fs::is_symlink(path_));
  EXPECT_EQ(read_all(target), posterior_text(good_posterior()));
}

/// Killed while it saves, two hundred times, every second time after its first save: what stands there is always one of the two posteriors, whole.
TEST_F(PosteriorFile, KilledWhileSavingLeavesAWholeFile) {
  StoredPosterior a = good_posterior(), b = good_posterior();
  b.episodes = 4;
  for (int i = 0; i < 60; ++i) b.mixture.weight.push_back(0.0);  // of another length
  for (int i = 0; i < 60; ++i) {
    b.mixture.mean.insert(b.mixture.mean.end(), {0.1, 0.5, -1.5});
    b.mixture.covariance.insert(b.mixture.covariance.end(), {1, 0, 0, 0, 1, 0, 0, 0, 1});
  }
  std::string error;
  ASSERT_TRUE(save_posterior(path_, a, error)) << error;
  const std::string text_a = posterior_text(a), text_b = posterior_text(b);
  int seen_b = 0, started[2];
  ASSERT_EQ(pipe(started), 0);
  for (int round = 0; round < 200; ++round) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      std::string ignored;
      for (bool first = true;; first = false) {
        (void)replace_file(path_, text_b, ignored);
        if (first && round % 2 == 1) (void)!write(started[1], "b", 1);
        (void)replace_file(path_, text_a, ignored);
      }
    }
    char saved;  // on a busy machine it may be long before a child does
    if (round % 2 == 1) {
      ASSERT_EQ(read(started[0], &saved, 1), 1);
    }
    usleep(static_cast<useconds_t>(200 + round * 37 % 3000));
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status));
    const std::string now = read_all(path_);
    ASSERT_TRUE(now == text_a || now == text_b) << "round " << round << ": " << now.size() << " bytes";
    seen_b += now == text_b;
  }
  close(started[0]);
  close(started[1]);
  EXPECT_GT(seen_b, 0) << "the kills never came between two saves";
  EXPECT_LE(files(), 2u) << "more than one temporary file is left";
}

}  // namespace
}  // namespace tiller::tools
