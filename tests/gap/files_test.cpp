// The new robot file keeps what it should and reads back; logs of LCM and records give the rows that were sent.
#include <gtest/gtest.h>
#include <lcm/eventlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "effects/effect_info.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tools/gap/report/outputs.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::gap {
namespace {

constexpr const char* kRobot = R"(# Über the arm: a comment that stays.
[robot]
name = "arm"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { uniform = [0.4, 0.6] }   # ± 20 %, weighed in a hurry
length_m = 0.4                       # measured
damping_Nms = { log_normal = [0.01, 1.0] }
[[effects]]
kind = "constant_offset"
port = "joint"
force_SI = { normal = [0.0, 0.1] }   # bias
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

std::unique_ptr<RobotFile> parse(const std::string& text) {
  std::string errors;
  auto file = parse_robot_file(text, "arm.toml", errors);
  EXPECT_TRUE(file) << errors << text;
  return file;
}

Estimate estimate(const char* name, bool fixed, double mean, double sd) {
  Estimate e;
  e.name = name;
  e.unit = "SI";
  e.fixed = fixed;
  e.mean = mean;
  e.sd = sd;
  e.low = mean - 1.96 * sd;
  e.high = mean + 1.96 * sd;
  return e;
}

Explanation found_in(std::uint32_t kind) {
  Explanation x;
  x.effects = {{kind, 0}};
  x.params = {estimate("mass_kg", false, 0.512, 0.001), estimate("length_m", true, 0.4, 0),
              estimate("damping_Nms", false, 0.02, 0.002), estimate("joint.force_SI", false, -0.03, 0.004)};
  return x;
}

TEST(RobotWriter, KeepsTheTextAndReplacesPriors) {
  const auto robot = parse(kRobot);
  Explanation x = found_in(tiller_effect_coulomb_friction);
  x.params.push_back(estimate("joint.friction_SI", false, 0.1, 0.002));
  std::string text, error;
  ASSERT_TRUE(write_robot(*robot, kRobot, x, "fnv1a-77", text, error)) << error;
  std::printf("%s", text.c_str());
  for (const char* kept : {"# Über the arm: a comment that stays.", "# ± 20 %, weighed in a hurry", "# measured",
                           "# bias", "length_m = 0.4 ", "fnv1a-77"})
    EXPECT_NE(text.find(kept), std::string::npos) << kept;
  const auto after = parse(text);
  ASSERT_TRUE(after);
  ASSERT_EQ(after->config.effect_count, 2u);
  EXPECT_EQ(after->config.effects[1].kind, static_cast<std::uint32_t>(tiller_effect_coulomb_friction));
  const tiller_prior_t* p = after->config.priors;
  // mass: at least 2 % of the value wide, within the old bounds
  EXPECT_EQ(p[0].kind, static_cast<std::uint32_t>(tiller_prior_normal));
  EXPECT_NEAR(p[0].a, 0.512, 1e-9);
  EXPECT_NEAR(p[0].b, 0.02 * 0.512, 1e-4);
  EXPECT_NEAR(p[0].low, 0.4, 1e-9);
  EXPECT_NEAR(p[0].high, 0.6, 1e-9);
  EXPECT_EQ(p[1].kind, static_cast<std::uint32_t>(tiller_prior_fixed));
  EXPECT_EQ(p[2].kind, static_cast<std::uint32_t>(tiller_prior_log_normal));
  EXPECT_NEAR(p[2].b, 2 * 0.002 / 0.02, 1e-3);  // twice the fit's, of the logarithm
  EXPECT_NEAR(p[3].a, -0.03, 1e-9);
  EXPECT_NEAR(p[3].b, 0.008, 1e-5);
  EXPECT_NEAR(p[4].a, 0.1, 1e-9);
  EXPECT_NEAR(p[4].b, 0.004, 1e-5);
  EXPECT_EQ(p[4].low, 0);
  // the same again: what was appended is found in its place and not appended twice
  Explanation again = found_in(tiller_effect_viscous_friction);
  again.params.push_back(estimate("joint.friction_SI", false, 0.11, 0.004));
  again.params.push_back(estimate("joint.damping_SI", false, 0.05, 0.001));
  std::string second;
  ASSERT_TRUE(write_robot(*after, text, again, "fnv1a-78", second, error)) << error;
  const auto third = parse(second);
  ASSERT_EQ(third->config.effect_count, 3u);
  EXPECT_NEAR(third->config.priors[4].a, 0.11, 1e-9);
  EXPECT_NEAR(third->config.priors[5].a, 0.05, 1e-9);
}

TEST(RobotWriter, ADelayGetsABound) {
  const auto robot = parse(kRobot);
  Explanation x = found_in(tiller_effect_input_delay);
  x.params.push_back(estimate("torque_Nm.delay_s", false, 0.018, 0.001));
  std::string text, error;
  ASSERT_TRUE(write_robot(*robot, kRobot, x, "h", text, error)) << error;
  const auto after = parse(text);
  EXPECT_NEAR(after->config.priors[4].high, 0.028, 1e-6);
}

TEST(RobotWriter, EveryKindReadsBack) {
  const auto robot = parse(kRobot);
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    if (info.learnt) continue;  // a network stands beside it
    std::uint32_t port = 0;
    while (port < port_count(info.port, *robot->config.model) && !port_fits(info, port, *robot->config.model)) ++port;
    if (port == port_count(info.port, *robot->config.model)) continue;
    Explanation x = found_in(kind);
    x.effects[0].port = port;
    for (int i = 0; i < info.param_count; ++i) {
      const EffectParam& param = info.params[i];
      const double value = std::clamp(0.01, param.low, param.high);
      x.params.push_back(estimate((std::string("p.") + param.name).c_str(), false, value, 0.001));
    }
    std::string text, error;
    EXPECT_TRUE(write_robot(*robot, kRobot, x, "h", text, error)) << info.name << ": " << error;
  }
}

TEST(RobotWriter, WhatDoesNotReadBackIsRefused) {
  const auto robot = parse(kRobot);
  Explanation x = found_in(tiller_effect_coulomb_friction);
  x.effects.assign(TILLER_MAX_EFFECTS, x.effects[0]);
  for (int i = 0; i < TILLER_MAX_EFFECTS; ++i) x.params.push_back(estimate("joint.friction_SI", false, 0.1, 0.01));
  std::string text, error;
  EXPECT_FALSE(write_robot(*robot, kRobot, x, "h", text, error));
  EXPECT_NE(error.find("too many effects"), std::string::npos) << error;
}

TEST(Verdicts, ExitCodes) {
  Result r;
  r.nominal_sigma = 3;
  const struct {
    Verdict verdict;
    int code;
  } all[] = {{Verdict::no_gap, 0},  {Verdict::named, 1},   {Verdict::ambiguous, 2}, {Verdict::partly, 2},
             {Verdict::unnamed, 2}, {Verdict::leading, 2}, {Verdict::off_prior, 2}, {Verdict::unfit, 3}};
  for (const auto& c : all) {
    r.verdict = c.verdict;
    EXPECT_EQ(exit_code_of(r, 1.1), c.code) << verdict_name(c.verdict);
  }
  for (const Verdict within : {Verdict::named, Verdict::ambiguous, Verdict::partly, Verdict::unnamed}) {
    r.verdict = within;
    EXPECT_EQ(exit_code_of(r, 3.5), 0) << verdict_name(within) << " within the budget";
  }
  r.verdict = Verdict::off_prior;
  EXPECT_EQ(exit_code_of(r, 3.5), 2);
}

// ---- logs ----

std::string temporary(const char* name) { return (std::filesystem::path(testing::TempDir()) / name).string(); }

void append(lcm_eventlog_t* file, const char* channel, const std::vector<unsigned char>& bytes, std::int64_t stamp_us) {
  lcm_eventlog_event_t event{};
  event.timestamp = stamp_us;
  event.channellen = static_cast<std::int32_t>(std::strlen(channel));
  event.channel = const_cast<char*>(channel);
  event.datalen = static_cast<std::int32_t>(bytes.size());
  event.data = const_cast<unsigned char*>(bytes.data());
  ASSERT_EQ(lcm_eventlog_write_event(file, &event), 0);
}

template <class Message>
std::vector<unsigned char> encoded(const Message& message) {
  std::vector<unsigned char> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

// 60 measurements at 100 Hz; the first is answered by nothing, the command to number 30 is lost, 40 has no angle.
std::string lcm_log(int count, const char* name, const char* prefix = "TILLER_") {
  const std::string path = temporary(name);
  lcm_eventlog_t* file = lcm_eventlog_create(path.c_str(), "w");
  for (int i = 0; i < 60; ++i) {
    tiller_lcm::measurement_t m{};
    m.stamp_us = 1000000 + 10000 * i;
    m.sequence = 100 + i;
    m.count = count;
    m.valid_mask = i == 40 ? 0 : 1;
    m.value[0] = 0.01 * i;
    append(file, (std::string(prefix) + "MEASUREMENT").c_str(), encoded(m), m.stamp_us);
    append(file, "CAMERA", {1, 2, 3}, m.stamp_us);
    if (i == 0 || i == 30) continue;
    tiller_lcm::command_t c{};
    c.stamp_us = m.stamp_us + 500;
    c.sequence = m.sequence;
    c.count = 1;
    c.value[0] = 0.1 * i;
    append(file, (std::string(prefix) + "COMMAND").c_str(), encoded(c), c.stamp_us);
  }
  lcm_eventlog_destroy(file);
  return path;
}

TEST(LogFormats, LcmLog) {
  const auto robot = parse(kRobot);
  const std::string path = lcm_log(1, "gap_run.lcm");
  EXPECT_EQ(log_format(path), "lcm");
  Log log;
  std::string error;
  ASSERT_TRUE(read_any_log(path, *robot, log, error)) << error;
  ASSERT_EQ(log.rows(), 59u);  // from the first command on
  EXPECT_NEAR(log.time_s[58], 0.58, 1e-9);
  EXPECT_NEAR(log.state[0][0], 0.01, 1e-12);
  EXPECT_TRUE(log.state[1].empty()) << "the rate is not measured";
  EXPECT_NEAR(log.input[0][28], 2.9, 1e-12);
  EXPECT_NEAR(log.input[0][29], 2.9, 1e-12) << "a lost command is held over";
  EXPECT_NEAR(log.input[0][30], 3.1, 1e-12);
  EXPECT_TRUE(std::isnan(log.state[0][39]));
}

TEST(LogFormats, WrongLcmLogsAreTold) {
  const auto robot = parse(kRobot);
  const auto refused = [&](const std::string& path) {
    Log log;
    std::string error;
    EXPECT_FALSE(read_any_log(path, *robot, log, error));
    return error;
  };
  EXPECT_NE(refused(lcm_log(2, "gap_two.lcm")).find("2 values where [measurement] of arm.toml names 1"),
            std::string::npos);
  const std::string other = refused(lcm_log(1, "gap_other.lcm", "ARM_"));
  for (const char* word :
       {"no messages on channel TILLER_MEASUREMENT", "ARM_COMMAND (58)", "CAMERA (60)", "channel_prefix"})
    EXPECT_NE(other.find(word), std::string::npos) << other;
}

TEST(LogFormats, Record) {
  const auto robot = parse(kRobot);
  const std::string path = temporary("gap_run.rec");
  OutputFile file;
  file.open(path);
  write_record_header(file, robot->config);
  for (int i = 0; i < 50; ++i) {
    RecordEntry entry;
    entry.record.tick = static_cast<std::uint64_t>(i);
    entry.record.has_measurement = i % 10 == 9 ? 0 : 1;
    entry.record.measurement.stamp_us = 5000000 + 10000 * i;
    entry.record.measurement.value[0] = 0.02 * i;
    entry.record.command.value[0] = 1.0 - 0.1 * i;
    write_record(file, entry);
  }
  ASSERT_TRUE(file.close());
  EXPECT_EQ(log_format(path), "record");
  Log log;
  std::string error;
  ASSERT_TRUE(read_any_log(path, *robot, log, error)) << error;
  ASSERT_EQ(log.rows(), 45u);
  EXPECT_NEAR(log.time_s[44], 0.48, 1e-9);
  EXPECT_NEAR(log.input[0][9], 0.0, 1e-12);
  EXPECT_EQ(log.line[9], 11);
}

TEST(LogFormats, AnMcapFileThatIsCutOffIsTold) {
  const auto robot = parse(kRobot);
  const std::string path = temporary("gap_run.mcap");
  std::FILE* file = std::fopen(path.c_str(), "wb");
  std::fwrite("\x89MCAP0\r\n", 1, 8, file);
  std::fclose(file);
  EXPECT_EQ(log_format(path), "mcap");
  Log log;
  std::string error;
  EXPECT_FALSE(read_any_log(path, *robot, log, error));
  EXPECT_NE(error.find("gap_run.mcap"), std::string::npos) << error;
}

/// A new robot file in another folder finds what the old one named, and texts that name no file stay.
TEST(GapRobot, PathsLeadToTheSameFilesFromAnotherFolder) {
  namespace fs = std::filesystem;
  const fs::path home = fs::path(testing::TempDir()) / "gap_paths", other = home / "out";
  fs::create_directories(other);
  for (const char* name : {"own.hpp", "a.csv"}) std::fclose(std::fopen((home / name).c_str(), "wb"));
  const std::string text =
      "[robot]\nname = \"own.hpp\"\n[model]\nfile = \"own.hpp\" # ours\n[posterior]\nprior_file = \"none.json\"\n"
      "[cost]\ndemonstration = [\"a.csv\", \"/a.csv\"]\n";
  const std::string moved = with_paths_from(text, home.string(), other.string());
  EXPECT_NE(moved.find("name = \"own.hpp\""), std::string::npos) << moved;
  EXPECT_NE(moved.find("# ours"), std::string::npos) << moved;
  EXPECT_NE(moved.find("prior_file = \"none.json\""), std::string::npos) << "there is none: " << moved;
  EXPECT_EQ(std::count(moved.begin(), moved.end(), '/'), 3) << moved;
  EXPECT_TRUE(fs::equivalent(other / "../own.hpp", home / "own.hpp"));
  EXPECT_EQ(with_paths_from(text, home.string(), (other / "..").string()), text) << "the same folder";
  fs::remove_all(home);
}

}  // namespace
}  // namespace tiller::tools::gap
