#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "planners/planner.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/command/commands.hpp"
#include "tools/distill/distill.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

const Words kReadable = {"state", "goal", "belief_mean", "belief_spread", "last_command"};

struct DistillArguments {
  std::string robot, out, page;
  Words reads;
  distill::DistillOptions options;
  bool quiet = false, no_page = false;
};

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  return stream.str();
}

bool choose_reads(const Words& asked, std::uint32_t& reads) {
  for (const std::string& name : asked) {
    const int index = index_of(kReadable, name);
    if (index < 0) {
      complain("--reads " + name + ": is none of " + join(kReadable) + "; name those that the policy is to read");
      return false;
    }
    reads |= 1u << index;
  }
  return true;
}

bool check_hidden(const std::vector<int>& hidden) {
  const auto fits = [](int width) { return width >= 1 && width <= TILLER_MAX_NETWORK_WIDTH; };
  if (!hidden.empty() && hidden.size() <= 2 && std::all_of(hidden.begin(), hidden.end(), fits)) return true;
  complain("--hidden: takes the widths of one or two layers, each 1.." + std::to_string(TILLER_MAX_NETWORK_WIDTH) +
           ", such as --hidden 32,32");
  return false;
}

/// Beside the policy, which it names: relative where both lie in the robot file's folder.
bool write_robot(const DistillArguments& a, const std::string& teacher, std::string& path, std::string& error) {
  const fs::path robot = a.robot;
  path = (robot.parent_path() / (robot.stem().string() + "_policy.toml")).string();
  const bool beside = fs::absolute(a.out).parent_path() == fs::absolute(path).parent_path();
  const std::string file = beside ? fs::path(a.out).filename().string() : fs::absolute(a.out).string();
  std::string text, errors;
  if (!distill::policy_robot_text(text_of(a.robot), teacher, file, text, error)) return false;
  if (parse_robot_file(text, path, errors)) return replace_file(path, text, error);
  error = errors;
  return false;
}

bool write_page(const DistillArguments& a, const RobotFile& robot, const distill::Distilled& result,
                std::string& error) {
  const std::string json = fs::path(a.out).replace_extension(".report.json").string();
  return replace_file(json, distill::distill_json(robot, a.options, result), error) &&
         draw_page("distill_report", json, a.page, error);
}

int write_all(const DistillArguments& a, const RobotFile& robot, const distill::Distilled& result) {
  std::string error, robot_path;
  if (!save_policy(a.out, result.policy, error)) return complain(error), kExitLogIncomplete;
  std::printf("policy: %s, %zu weights\n", fs::absolute(a.out).c_str(), result.policy.network.weights.size());
  if (!write_robot(a, a.options.teacher, robot_path, error)) return complain(error), kExitLogIncomplete;
  std::printf("robot file: %s\n  next: tiller run %s --sim\n", fs::absolute(robot_path).c_str(), robot_path.c_str());
  if (a.no_page) return kExitOk;
  if (!write_page(a, robot, result, error)) return complain(error), kExitLogIncomplete;
  std::printf("report: %s\n", fs::absolute(a.page).c_str());
  return kExitOk;
}

int distill_command(DistillArguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  distill::DistillOptions& options = a.options;
  if (!choose_reads(a.reads, options.reads) || !check_hidden(options.hidden)) return kExitBadInput;
  std::string error;
  RobotFile teacher;
  if (!distill::with_teacher(*robot, options.teacher, teacher, error)) return complain(a.robot + ": " + error);
  options.teacher = find_planner(teacher.config.planner.kind)->name;
  if (!can_write_file(a.out, error)) return complain("-o " + error + "; name a file that can be written");
  if (a.page.empty()) a.page = fs::path(a.out).replace_extension(".html").string();
  if (!a.quiet) options.progress = [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); };
  const StopFlag stop;
  distill::Distilled result;
  if (!distill::distill(*robot, options, stop.flag(), result, error)) return complain(error);
  if (result.interrupted) {
    std::fprintf(stderr, "\ntiller: interrupted; nothing was written\n");
    return kExitInterrupted;
  }
  std::fputs(distill::distill_text(result).c_str(), stdout);
  return write_all(a, *robot, result);
}

void add_course_options(CLI::App& command, distill::DistillOptions& o) {
  command.add_option("--iterations", o.iterations, "rounds of lessons (default 6)")->check(CLI::Range(1, 100));
  command.add_option("--episodes", o.episodes, "episodes of a round (default 40)")->check(CLI::Range(2, 100000));
  command.add_option("--seconds", o.seconds, "robot time of each episode (default 5)")
      ->check(number_between(0.1, 3600));
  command
      .add_option("--validation", o.validation,
                  "undisturbed episodes after a round; they choose the round (default 16)")
      ->check(CLI::Range(1, 10000));
  command.add_option("--test", o.test, "held-out draws on which whole controllers compare in the end (default 12)")
      ->check(CLI::Range(0, 10000));
  command.add_option("--seed", o.seed, "of draws, noise and weights (default 1)")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 40));
  command.add_option("--threads", o.threads, "episodes side by side; results are the same bits (default: all)")
      ->check(CLI::Range(1u, 256u));
}

}  // namespace

void add_distill_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("distill", "teach a small network what a planner does, for small targets");
  auto a = std::make_shared<DistillArguments>();
  distill::DistillOptions& o = a->options;
  o.threads = std::max(1u, std::thread::hardware_concurrency());
  command->add_option("ROBOT", a->robot, "robot file (.toml)")->required();
  command->add_option("-o,--out", a->out, "the policy (.json)")->required();
  command->add_option("--teacher", o.teacher, "planner that answers, with its settings in ROBOT (default: its kind)");
  command->add_option("--hidden", o.hidden, "widths of one or two layers of tanh (default 32,32)")
      ->delimiter(',')
      ->default_str("32,32");
  command
      ->add_option("--reads", a->reads,
                   "what the policy reads, of state,goal,belief_mean,belief_spread,last_command (default: state and "
                   "belief; goal too where the cost has a reference)")
      ->delimiter(',');
  add_course_options(*command, o);
  command->add_option("--page", a->page, "the page (default: beside the policy, ending .html)");
  command->add_flag("--no-page", a->no_page, "no page");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "In each round the model of ROBOT is steered with hidden parameters drawn from the priors; the teacher says at\n"
      "every tick what it would do, and a tanh network is fitted to its answers (DAgger). Beside the policy, a robot file\n"
      "ROBOT_policy.toml is written whose planner is the policy, and the teacher its fallback (docs/guide/distill.md).\n\n"
      "Examples:\n"
      "  tiller distill robots/planar_quadrotor.toml -o out/quadrotor_policy.json\n"
      "      the file's own planner as the teacher, with the default settings\n"
      "  tiller distill my_robot.toml -o my_policy.json --teacher ilqr --hidden 24,24 --iterations 8 --episodes 60\n"
      "      then tiller run my_robot_policy.toml --sim, and tiller export my_robot_policy.toml for a firmware");
  command->callback([a, &exit_code] { exit_code = distill_command(*a); });
}

}  // namespace tiller::tools
