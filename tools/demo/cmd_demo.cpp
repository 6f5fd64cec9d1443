#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/shipped_robots.hpp"
#include "tools/command/commands.hpp"
#include "tools/robot/robot_schema.hpp"
#include "tools/run/run_facts.hpp"
#include "tools/run/run_loop.hpp"
#include "tools/run/run_summary.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

constexpr double kUpright_rad = 0.2;

struct Arguments {
  std::string folder = "out";
  double seconds = 12;
  bool no_report = false, fast = false;
  Overrides overrides;
};

std::string demo_robot() { return (fs::path(shipped_robots()) / "cart_pole.toml").string(); }

/// The folder asked for where files can be made in it, else one for temporary files.
std::string usable_folder(const std::string& asked, bool& moved) {
  std::error_code code;
  std::string error;
  const bool writable = can_write_file((fs::path(asked) / ".tiller-can-write").string(), error);
  moved = !writable;
  if (writable) return asked;
  std::string made = (fs::temp_directory_path(code) / "tiller-demo-XXXXXX").string();
  if (!mkdtemp(made.data())) return asked;
  std::fprintf(stderr, "tiller: %s: files cannot be made there; writing to %s instead (choose with --out FOLDER)\n",
               fs::absolute(asked).c_str(), made.c_str());
  return made;
}

/// Angles count turns: upright is a multiple of 2 pi from zero.
bool is_upright(const RobotFile& robot, const RunResult& result, double& angle_rad) {
  const int angle = index_of(robot.names.states, "angle_rad");
  const auto& state = result.last_true_state;
  if (angle < 0 || state.empty()) return false;
  angle_rad = std::remainder(state[static_cast<std::size_t>(angle)], 2 * M_PI);
  return std::fabs(angle_rad) < kUpright_rad;
}

void print_intro(const RobotFile& robot) {
  std::printf(
      "A pole hangs from a cart. The controller knows the cart's mass; the pole's mass, its length and the cart's\n"
      "friction it knows to +- 50 %%. It sees two noisy encoders, swings the pole up, and learns on the way.\n"
      "Robot file: %s   seed %llu   planner %s   %s\n\n",
      robot.path.c_str(), static_cast<unsigned long long>(robot.sim.seed),
      planner_names()[robot.config.planner.kind].c_str(), tiller_instruction_set());
}

int report_demo(const Arguments& a, const RobotFile& robot, const std::string& folder, const RunResult& result,
                const RunStory& story) {
  if (a.no_report || result.files.readable_log.empty()) return kExitOk;
  const std::string page = (fs::path(folder) / "demo.html").string();
  std::printf("drawing the report ...\n");
  std::fflush(stdout);
  std::string error;
  if (!write_run_facts(robot, result, story, error) || !write_report(result.files.readable_log, page, error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  std::printf("report: %s\n", fs::absolute(page).c_str());
  return kExitOk;
}

int demo_command(const Arguments& a) {
  auto robot = read_robot_or_complain(demo_robot());
  if (!robot || !apply_overrides(a.overrides, *robot)) return kExitBadInput;
  if (a.fast) robot->config.planner.deadline_us = 0;  // no clock, so the same seed gives the same run
  std::string error;
  const auto plant = make_sim_plant(*robot, error);
  if (!plant) return complain(error);
  bool moved = false;
  const std::string folder = usable_folder(a.folder, moved);
  print_intro(*robot);
  const auto link = make_sim_link(*robot, *plant, !a.fast);
  RunOptions options;
  options.seconds = a.seconds;
  options.threads = a.overrides.threads;
  options.files.log = (fs::path(folder) / "demo.csv").string();
  options.files.true_params = plant->true_params;
  const RunResult result = run_robot(*robot, *link, options);
  if (result.exit_code == kExitBadInput) return kExitBadInput;
  double angle_rad = NAN;
  const bool upright = is_upright(*robot, result, angle_rad);
  const std::string outcome =
      format("%s: the pole is %.3f rad from upright after %.1f s (below %.1f rad counts)",
             upright ? "UPRIGHT" : "NOT UPRIGHT", std::fabs(angle_rad), result.time_s, kUpright_rad);
  std::printf("\n%s\n", outcome.c_str());
  std::fputs(summary(*robot, options, result).c_str(), stdout);
  if (!result.files.readable_log.empty()) std::printf("log: %s\n", fs::absolute(result.files.readable_log).c_str());
  const int reported = report_demo(a, *robot, folder, result,
                                   {"tiller demo: cart-pole swing-up", outcome, upright, options.files.true_params});
  if (result.exit_code != kExitOk) return result.exit_code;
  return moved ? static_cast<int>(kExitLogIncomplete) : reported;
}

}  // namespace

void add_demo_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("demo", "swing up a cart-pole whose parameters are unknown; leaves a report");
  auto a = std::make_shared<Arguments>();
  command->add_option("--out", a->folder, "folder for demo.csv and demo.html (default out)");
  command->add_option("--seconds", a->seconds, "robot time (default 12)")->check(number_between(0.1, 600.0));
  command->add_flag("--fast", a->fast, "do not wait for the wall clock");
  command->add_flag("--no-report", a->no_report, "the CSV only");
  add_override_options(*command, a->overrides);
  command->footer(
      "Examples:\n"
      "  tiller demo\n"
      "      12 s of robot time; true parameters of seed 1; out/demo.html at the end\n"
      "  tiller demo --seed 7 --planner cem --frozen\n"
      "      another robot, another planner, and no learning: compare the reports");
  command->callback([a, &exit_code] { exit_code = demo_command(*a); });
}

}  // namespace tiller::tools
