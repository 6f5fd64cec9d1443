#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"
#include "tools/gap/pipeline/data.hpp"
#include "tools/learn/learnt_writer.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
using learn::Form;

enum LearnExit : int { kNothingLearnt = 2, kUnfitLogs = 3 };

struct Arguments {
  std::string robot, folder, form = "auto";
  Words logs;
  learn::LearnOptions options;
  bool quiet = false;
};

bool load(const RobotFile& robot, const Arguments& a, std::vector<Grid>& grids) {
  std::vector<Log> logs;
  gap::Result scratch;
  if (gap::load_logs(robot, a.logs, kMostSteps, false, logs, grids, nullptr, scratch)) return true;
  for (const std::string& reason : scratch.reasons) complain(reason);
  return false;
}

/// On a terminal one line that overwrites itself, elsewhere a line for each new thing.
class Progress {
 public:
  void show(const std::string& what, double share) {
    const bool terminal = isatty(STDERR_FILENO) != 0;
    if (!terminal && what == last_) return;
    last_ = what;
    std::fprintf(stderr, terminal ? "\r\033[Klearn: %s, %.0f %%" : "learn: %s\n", what.c_str(), 100.0 * share);
    std::fflush(stderr);
  }
  ~Progress() {
    if (!last_.empty() && isatty(STDERR_FILENO) != 0) std::fputs("\r\033[K", stderr);
  }

 private:
  std::string last_;
};

/// The network and the robot file that names it. False after a complaint.
bool write_robot(const Arguments& a, const RobotFile& robot, const learn::Learnt& learnt, std::string& path) {
  const learn::Candidate& c = learnt.candidates[static_cast<std::size_t>(learnt.chosen)];
  const std::string file = robot.name + "_network.json";
  std::ifstream in(a.robot, std::ios::binary);
  std::stringstream old;
  old << in.rdbuf();
  std::string error;
  if (!save_network((fs::path(a.folder) / file).string(), c.network, error)) return complain(error), false;
  std::string text;
  if (!learn::learnt_robot_text(robot, old.str(), learnt, file, text, error)) return complain(error), false;
  path = (fs::path(a.folder) / (robot.name + "_learnt.toml")).string();
  if (!replace_file(path, text, error)) return complain(error), false;
  if (parse_robot_file(text, path, error)) return true;
  complain(path + ": does not read back: write it beside the old robot file with -o\n" + error);
  return false;
}

int write_results(const Arguments& a, const RobotFile& robot, const learn::Learnt& learnt) {
  std::string error, path;
  bool good = learnt.chosen < 0 || write_robot(a, robot, learnt, path);
  const fs::path json = fs::path(a.folder) / "learn.json", page = fs::path(a.folder) / "learn.html";
  if (!replace_file(json.string(), learn::learnt_json(robot, learnt, path), error)) return complain(error);
  std::printf("result: %s\n", fs::absolute(json).c_str());
  if (!path.empty() && good)
    std::printf("robot file: %s\n  next: tiller run %s --sim\n", fs::absolute(path).c_str(), path.c_str());
  if (!draw_page("learn_report", json.string(), page.string(), error)) {
    complain(error);
    good = false;
  } else {
    std::printf("report: %s\n", fs::absolute(page).c_str());
  }
  if (!good) return kExitLogIncomplete;
  return learnt.chosen < 0 ? static_cast<int>(kNothingLearnt) : static_cast<int>(kExitOk);
}

int learn_command(Arguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  std::string error;
  if (!a.folder.empty()) {
    std::error_code code;
    fs::create_directories(a.folder, code);
    if (code || !can_write_file((fs::path(a.folder) / "learn.json").string(), error))
      return complain("-o " + a.folder + ": " + (code ? code.message() : error) +
                      "; name a folder that can be written");
  }
  std::vector<Grid> grids;
  if (!load(*robot, a, grids)) return kUnfitLogs;
  a.options.form = a.form == "network" ? Form::network : a.form == "gaussian" ? Form::gaussian : Form::automatic;
  const StopFlag stop;
  a.options.stop = &stop.flag();
  Progress progress;
  if (!a.quiet) a.options.progress = [&](const std::string& what, double share) { progress.show(what, share); };
  learn::Learnt learnt;
  if (!learn::learn(*robot, grids, a.options, learnt, error)) return complain(error), kUnfitLogs;
  if (stop.flag() != 0) return complain("interrupted; nothing was written"), kExitInterrupted;
  std::fputs(learn::learnt_text(learnt).c_str(), stdout);
  if (!a.folder.empty()) return write_results(a, *robot, learnt);
  return learnt.chosen < 0 ? static_cast<int>(kNothingLearnt) : static_cast<int>(kExitOk);
}

}  // namespace

void add_learn_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("learn", "learn forces that no known effect explains, on top of the physics");
  auto a = std::make_shared<Arguments>();
  learn::LearnOptions& o = a->options;
  command->add_option("ROBOT", a->robot, "robot file (.toml): model, priors, sensors, [log]")->required();
  command->add_option("LOGS", a->logs, "logs: CSV, LCM event logs, records of `tiller run --record`")->required();
  command->add_option("-o,--out", a->folder, "folder for the network, the robot file with it, learn.json and the page");
  command
      ->add_option("--form", a->form,
                   "network: an ensemble of perceptrons; gaussian: a sparse Gaussian process; auto: the better one on "
                   "what is held out (default)")
      ->check(CLI::IsMember({"auto", "network", "gaussian"}));
  command->add_option("--members", o.ensemble.members, "networks of the ensemble (default 5)")
      ->check(CLI::Range(1, TILLER_MAX_NETWORK_MEMBERS));
  command->add_option("--hidden", o.ensemble.hidden, "widths of the hidden layers (default 16,16)")
      ->delimiter(',')
      ->expected(1, 2)
      ->check(CLI::Range(1, TILLER_MAX_NETWORK_WIDTH));
  command->add_option("--inducing", o.gaussian.inducing, "inducing points of the Gaussian process (default 48)")
      ->check(CLI::Range(4, 256));
  command->add_option("--hold-out", o.hold_out, "last share of every log, kept for the judgement (default 0.25)")
      ->check(number_between(0.05, 0.8));
  command
      ->add_option("--most-ratio", o.most_ratio,
                   "rollout errors on what is held out, with over without, that still earn a place (default 0.9)")
      ->check(number_between(0.0, 1.0));
  command->add_option("--seed", o.ensemble.seed, "of every random number (default 1)")->check(CLI::Range(1, 1000000));
  command->add_flag("-q,--quiet", a->quiet, "no progress");
  command->footer(
      "The last quarter of every log judges: rollouts of one second with what was learnt against those without. What\n"
      "does not earn its place is refused. Name the missing effect first, if it has a name: `tiller gap`.\n\n"
      "Exit code: 0 learnt; 2 refused; 3 the logs cannot answer; 4 wrong option, robot file or file name.\n\n"
      "Examples:\n"
      "  tiller learn robot.toml logs/*.csv -o learnt\n"
      "  tiller learn robot.toml run.mcap --form gaussian -o learnt && tiller run learnt/robot_learnt.toml --sim");
  command->callback([a, &exit_code] {
    a->options.gaussian.seed = a->options.ensemble.seed;
    exit_code = learn_command(*a);
  });
}

}  // namespace tiller::tools
