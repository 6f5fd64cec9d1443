// ./dev bench learned distill: small policies beside the planners that taught them.
//
// Each robot's policy (32 x 32 tanh, state and posterior moments in) is distilled on the robot's model by draws of seed
// 1000 and kept in build/; each draw then steers the plant of the robot file's [sim], whose hidden parameters are drawn
// from the priors by the seed, twice: whole controllers with their posterior, once with the teacher, once with the
// policy alone (no fallback). Cost: mean stage cost a tick at the true state.
//
//   bench_distill [--seeds N] [--robot NAME] [--csv FILE] [--quick]
//
// Every draw is one line of the CSV (build/bench_distill.csv); a run that was cut goes on behind the last one.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "bench/table/bench_table.hpp"
#include "tools/distill/distill.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;
using tools::distill::HeldOut;

constexpr double kGoal = 1.10;
constexpr std::uint64_t kTrainingSeed = 1000;
constexpr unsigned kThreads = 2;

struct Task {
  const char *robot, *teacher;
  double seconds;
  std::uint32_t iterations, episodes;
};
constexpr Task kTasks[] = {
    {"planar_quadrotor", "ilqr", 4, 4, 30}, {"two_link_arm", "ilqr", 3, 4, 40}, {"cart_pole", "mppi", 5, 6, 40}};

struct Settings {
  std::uint64_t seeds = 50;
  std::string robot, csv = "build/bench_distill.csv";
  bool quick = false;
};
using Lines = std::map<std::string, std::map<std::uint64_t, HeldOut>>;  // by robot, by seed

volatile std::sig_atomic_t never = 0;

int fail(const std::string& text) {
  std::fprintf(stderr, "bench_distill: %s\n", text.c_str());
  return 1;
}

// ---- the file --------------------------------------------------------------------------------------

std::string key_of(const Task& task, const Settings& s) { return task.robot + std::string(s.quick ? "_quick" : ""); }

void read_lines(const std::string& path, Lines& lines) {
  std::ifstream file(path);
  std::string text;
  while (std::getline(file, text)) {
    if (file.eof()) break;  // cut before its line feed
    std::replace(text.begin(), text.end(), ',', ' ');
    std::istringstream words(text);
    std::string key;
    HeldOut one;
    if (words >> key >> one.seed >> one.teacher_cost >> one.policy_cost >> one.teacher_safe >> one.policy_safe)
      lines[key][one.seed] = one;
  }
}

void write_line(const std::string& path, const std::string& key, const HeldOut& one) {
  std::ofstream file(path, std::ios::app);
  file.precision(9);
  file << key << "," << one.seed << "," << one.teacher_cost << "," << one.policy_cost << "," << one.teacher_safe << ","
       << one.policy_safe << "\n";
}

// ---- one robot --------------------------------------------------------------------------------------

bool load_policy(const std::string& path, tools::StoredPolicy& policy) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  std::string error;
  return file && tools::parse_policy(text.str(), policy, error);
}

bool train(const Task& task, const Settings& s, const tools::RobotFile& robot, tools::StoredPolicy& policy,
           std::string& error) {
  const std::string path = "build/bench_distill_" + key_of(task, s) + ".json";
  if (load_policy(path, policy)) return true;
  tools::distill::DistillOptions options;
  options.teacher = task.teacher;
  options.seconds = task.seconds;
  options.iterations = s.quick ? 2 : task.iterations;
  options.episodes = s.quick ? 6 : task.episodes;
  options.validation = s.quick ? 2 : 12;
  options.test = 0;
  options.seed = kTrainingSeed;
  options.threads = kThreads;
  options.progress = [&](const std::string& line) { std::fprintf(stderr, "%s: %s\n", task.robot, line.c_str()); };
  tools::distill::Distilled result;
  if (!tools::distill::distill(robot, options, never, result, error)) return false;
  policy = result.policy;
  return tools::save_policy(path, policy, error);
}

bool run_draws(const Task& task, const Settings& s, const tools::RobotFile& robot,
               std::map<std::uint64_t, HeldOut>& done, std::string& error) {
  tools::StoredPolicy stored;
  tools::RobotFile teacher, policy;
  if (!train(task, s, robot, stored, error) || !tools::distill::with_teacher(robot, task.teacher, teacher, error) ||
      !tools::distill::with_policy(teacher, stored, policy, error))
    return false;
  for (std::uint64_t seed = 1; seed <= s.seeds; ++seed) {
    if (done.count(seed) != 0) continue;
    HeldOut one;
    if (!tools::distill::play_held_out(teacher, policy, seed, task.seconds, never, one, error)) return false;
    done[seed] = one;
    write_line(s.csv, key_of(task, s), one);
  }
  return true;
}

void report(Table& table, const Task& task, const Settings& s, const std::map<std::uint64_t, HeldOut>& done) {
  std::vector<HeldOut> draws;
  std::vector<double> ratios;
  double safe = 0, teacher_safe = 0;
  for (const auto& [seed, one] : done) {
    if (seed > s.seeds) continue;
    draws.push_back(one);
    ratios.push_back(one.policy_cost / one.teacher_cost);
    safe += one.policy_safe;
    teacher_safe += one.teacher_safe;
  }
  table.heading(std::string(task.robot) + ", taught by " + task.teacher + ", " + std::to_string(draws.size()) +
                " draws");
  for (const HeldOut& one : draws)
    std::printf("  draw %2d: teacher %9.4g, policy %9.4g, ratio %.3f%s%s\n", static_cast<int>(one.seed),
                one.teacher_cost, one.policy_cost, one.policy_cost / one.teacher_cost,
                one.teacher_safe ? ", teacher in SAFE" : "", one.policy_safe ? ", policy in SAFE" : "");
  table.row("cost of all draws over the teacher's", tools::distill::cost_ratio(draws), "", at_most(kGoal));
  std::sort(ratios.begin(), ratios.end());
  table.row("median of the draws' ratios", ratios[ratios.size() / 2], "");
  table.row("worst draw's ratio", ratios.back(), "");
  table.row("draws that end in SAFE: policy", safe, "");
  table.row("draws that end in SAFE: teacher", teacher_safe, "");
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Small policies beside the planners that taught them", "bench_distill");
  Settings s;
  auto* seeds = app.add_option("--seeds", s.seeds, "draws of the hidden parameters")->check(CLI::PositiveNumber);
  app.add_option("--robot", s.robot, "this one alone");
  app.add_option("--csv", s.csv, "a line for each draw; a run that was cut goes on from there");
  app.add_flag("--quick", s.quick, "three draws of policies that were taught little");
  CLI11_PARSE(app, argc, argv);
  if (s.quick && seeds->count() == 0) s.seeds = 3;
  if (!std::ofstream(s.csv, std::ios::app)) return fail(s.csv + ": cannot be written; name another file with --csv");
  Lines lines;
  read_lines(s.csv, lines);
  Table table;
  for (const Task& task : kTasks) {
    if (!s.robot.empty() && s.robot != task.robot) continue;
    std::string error, errors;
    const auto robot = tools::read_robot_file(TILLER_ROBOTS + std::string("/") + task.robot + ".toml", errors);
    if (!robot) return fail(errors);
    auto& done = lines[key_of(task, s)];
    if (!run_draws(task, s, *robot, done, error)) return fail(error);
    report(table, task, s, done);
  }
  return table.finish();
}
