#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <thread>

#include "effects/effect_info.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"
#include "tools/gap/pipeline/data.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/gap/report/outputs.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/gap/residual/residual_writer.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

struct GapOptions {
  std::string robot, folder;
  std::vector<std::string> before, after;  ///< logs; then find.logs are those of after
  double budget_sigma = -1;                ///< below 0: not given
  std::string mjcf, urdf, description;     ///< to write; what they are made from
  bool json = false;
  gap::Options find;
};

volatile int stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

/// Ctrl-C finishes the step and keeps what is done; a second one ends the program as ever.
class StopOnInterrupt {
 public:
  StopOnInterrupt() {
    struct sigaction action {};
    action.sa_handler = request_stop;
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    sigaction(SIGINT, &action, &before_);
  }
  ~StopOnInterrupt() { sigaction(SIGINT, &before_, nullptr); }
  StopOnInterrupt(const StopOnInterrupt&) = delete;
  StopOnInterrupt& operator=(const StopOnInterrupt&) = delete;

 private:
  struct sigaction before_ {};
};

/// On a terminal one line that overwrites itself, elsewhere a line a step: the step, the time so far, and on a terminal
/// what the step still takes at the pace of what is done of it. How many steps follow goes by what this one finds.
class StepLine {
 public:
  StepLine() : terminal_(isatty(STDERR_FILENO) != 0), started_(Clock::now()) {}
  ~StepLine() { clear(); }
  void show(const char* step, double share) {
    const bool next = last_ != step;
    if (next || share < last_share_) step_started_ = Clock::now();  // several bases are screened one after the other
    last_ = step;
    last_share_ = share;
    constexpr double kTold_s = 30;  // of a log of a build server: it goes on, and how far it is
    if (!terminal_ && !next && since_s(told_) < kTold_s) return;
    told_ = Clock::now();
    const std::string text = step + times(share);
    if (terminal_) {
      std::string bar(20, '.');
      for (std::size_t i = 0; i < bar.size() && static_cast<double>(i) < share * 20; ++i) bar[i] = '#';
      std::fprintf(stderr, "\r\033[K[%s] %s", bar.c_str(), text.c_str());
      std::fflush(stderr);
    } else {
      std::fprintf(stderr, "gap: %s%s\n", text.c_str(), next ? "" : format(" (%.0f %%)", 100 * share).c_str());
    }
  }
  void clear() {
    if (terminal_ && !last_.empty()) std::fprintf(stderr, "\r\033[K");
  }

 private:
  using Clock = std::chrono::steady_clock;
  static double since_s(Clock::time_point then) { return std::chrono::duration<double>(Clock::now() - then).count(); }

  std::string times(double share) const {
    if (since_s(started_) < 1) return "";
    const std::string spent = ", " + format("%.0f", since_s(started_)) + " s";
    const double left_s = since_s(step_started_) * (1 / std::max(share, 1e-9) - 1);
    return share < 0.1 || left_s < 1 ? spent : spent + ", this step about " + format("%.0f", left_s) + " s more";
  }

  bool terminal_;
  Clock::time_point started_, step_started_, told_;
  double last_share_ = 0;
  std::string last_;
};

/// Asked for before hours of computing, not after.
bool can_be_written(const std::string& folder, std::string& error) {
  const std::string probe = (fs::path(folder) / ".tiller_gap").string();
  make_folders_for(probe);
  if (fs::is_directory(folder)) return can_write_file(probe, error);
  std::error_code code;
  error = folder + ": cannot be made a folder" + (fs::exists(folder, code) ? ": a file is in its place" : "") +
          "; name another folder with -o";
  return false;
}

bool read_text(const std::string& path, std::string& text) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  text = stream.str();
  return static_cast<bool>(file);
}

/// The joints at which a residual is tried: those whose residual force goes most with something. Of two joints both.
std::vector<std::uint32_t> residual_joints(const gap::Result& result) {
  constexpr std::size_t kMost = 2;
  std::vector<std::uint32_t> joints;
  for (const gap::AxisMap& map : result.maps)  // the clearest first
    if (joints.size() < kMost && std::find(joints.begin(), joints.end(), map.joint) == joints.end())
      joints.push_back(map.joint);
  return joints;
}

/// Where the laboratory `learn` is installed and its forces beat the nine weights of a residual on logs that neither
/// has seen, its robot file takes the place of `text`, with the network beside it. Where it is not, that is said.
bool add_learnt(const GapOptions& options, const RobotFile& robot, std::string& text) {
  std::string error;
  if (!run_python_tool("laboratory", {"--check"}, error)) {
    std::fprintf(stderr,
                 "gap: nine weights at one joint are offered, for the laboratory `tiller learn`, which would "
                 "learn forces at all joints, is not installed: pip install 'tiller[labs]', or run it once\n");
    return false;
  }
  std::fprintf(stderr, "gap: learning what is left at all joints (tiller learn)\n");
  const std::string stem = robot.name + "_gap";
  const fs::path folder = options.folder, begin = folder / (stem + "_before.toml"),
                 learnt = folder / (stem + "_learnt.toml");
  if (!replace_file(begin.string(), text, error)) return complain(error), false;
  Words words = {"learn",          begin.string(),    "-o",     folder.string(), "--stem", stem,
                 "--no-catalogue", "--beat-residual", "--quiet"};
  words.insert(words.end(), options.find.logs.begin(), options.find.logs.end());
  const bool good = run_python_tool("laboratory", words, error);
  const bool taken = good && stop_requested == 0 && read_text(learnt.string(), text);
  std::error_code ignored;
  fs::remove(begin, ignored);
  fs::remove(learnt, ignored);
  if (taken && !options.json)
    std::printf("forces at all joints were learnt (tiller learn): %s\n", (folder / "learn.html").c_str());
  else if (!good && !options.json)
    std::printf("tiller learn has nothing better than nine weights at one joint\n");
  return taken;
}

/// Puts the unnamed effect for what is left into `text`, and its joint law beside the file; `text` stays where the logs
/// do not speak for it.
bool add_residual(const GapOptions& options, const RobotFile& robot, const gap::Result& result,
                  const std::string& posterior, std::string& text) {
  std::vector<Log> logs;
  std::vector<Grid> grids;
  gap::Result scratch;
  gap::ResidualOffer offer;
  std::string error;
  gap::ResidualSearch search;
  search.joints = residual_joints(result);
  search.stop = &stop_requested;
  search.begins = [&robot](std::uint32_t joint) {
    std::fprintf(stderr, "gap: learning what is left at %s as a force without a name\n",
                 robot.config.model->joints[joint].name);
  };
  constexpr double kVeryStrong_nats = 10.0;
  if (!gap::load_logs(robot, options.find.logs, options.find.most_steps, false, logs, grids, nullptr, scratch))
    return false;
  const bool offered = gap::offer_residual(text, robot.path, grids, kVeryStrong_nats, offer, error, search);
  if (stop_requested == 0 && add_learnt(options, robot, text)) return true;
  if (!offered) {
    if (!options.json && !error.empty()) std::printf("nothing is learnt of the rest: %s\n", error.c_str());
    return false;
  }
  text = offer.text;
  if (!save_posterior(posterior, offer.posterior, error)) complain(error);
  if (!options.json)
    std::printf("what has no name is learnt as a residual; begin with tiller run --posterior %s\n", posterior.c_str());
  return true;
}

/// The new robot file, where something was named or a residual can be offered. False after a complaint.
bool write_new_robot(const GapOptions& options, const RobotFile& robot, const std::string& old_text,
                     const gap::Result& result, std::string& path) {
  using gap::Verdict;
  const bool rest = result.verdict == Verdict::unnamed || result.verdict == Verdict::partly;
  bool worth = false;
  if (!rest && result.verdict != Verdict::named && result.verdict != Verdict::ambiguous) return true;
  std::string text = old_text, error;
  const fs::path folder = options.folder;
  if (result.verdict != Verdict::unnamed && !result.ranking.empty() && !result.ranking[0].effects.empty()) {
    worth = gap::write_robot(robot, old_text, result.ranking[0], result.data_hash, text, error);
  }
  const std::string posterior = (folder / (robot.name + "_gap.posterior.json")).string();
  if (error.empty() && rest && add_residual(options, robot, result, posterior, text)) worth = true;
  if (error.empty() && !worth) return true;
  const fs::path own = fs::path(robot.path).parent_path();
  text = gap::with_paths_from(text, own.empty() ? "." : own.string(), folder.string());
  const std::string target = (folder / (robot.name + "_gap.toml")).string();
  if (!error.empty() || !replace_file(target, text, error)) {
    complain("the new robot file was not written: " + error);
    return false;
  }
  path = target;
  return true;
}

/// What the simulator's description is made from.
std::string description_of(const GapOptions& options, const RobotFile& robot) {
  return options.description.empty() ? robot.sim.file : options.description;
}

/// The simulator's description with what was found, by tiller_tools.simulator_patch. False after a complaint.
bool write_description(const GapOptions& options, const RobotFile& robot, const gap::Result& result,
                       const std::string& json_path) {
  using gap::Verdict;
  if (options.mjcf.empty() && options.urdf.empty()) return true;
  const std::string& target = options.mjcf.empty() ? options.urdf : options.mjcf;
  if (result.verdict != Verdict::named && result.verdict != Verdict::ambiguous && result.verdict != Verdict::partly) {
    if (!options.json) std::printf("nothing was named that a simulator lacks: %s is not written\n", target.c_str());
    return true;
  }
  std::string error;
  Words words = {json_path, description_of(options, robot), "-o", target};
  if (!robot.sim.frame.empty()) words.insert(words.end(), {"--frame", robot.sim.frame});
  if (!can_write_file(target, error) || !run_python_tool("simulator_patch", words, error))
    return complain(error), false;
  if (!options.json)
    std::printf("description for the simulator (what it cannot say is listed at its end): %s\n",
                fs::absolute(target).c_str());
  return true;
}

/// Empty: good.
std::string wrong_description(const GapOptions& options, const RobotFile& robot) {
  if (options.mjcf.empty() && options.urdf.empty()) return "";
  const std::string option = options.mjcf.empty() ? "--write-urdf" : "--write-mjcf";
  if (options.folder.empty()) return option + " needs -o FOLDER, which holds the results";
  if (options.description.empty() && (robot.sim.file.empty() || !options.mjcf.empty()))
    return option + " needs the file that the robot was imported from: --description FILE" +
           (options.mjcf.empty() ? " ([sim] of " + robot.path + " names no file)" : "");
  const std::string from = description_of(options, robot);
  std::error_code none;
  if (!fs::is_regular_file(from, none)) return from + ": there is no such file; name another with --description";
  return "";
}

/// gap.json, the new robot file and the page. The tables are printed already: what fails here loses no result.
bool write_results(const GapOptions& options, const RobotFile& robot, const std::string& old_text,
                   const gap::Result& result, std::string& json) {
  std::string new_robot, error;
  const fs::path file = fs::path(options.folder) / "gap.json", page = fs::path(options.folder) / "gap.html";
  // what was found is kept whatever becomes of a residual, which may take minutes
  json = gap::gap_json(robot, options.find, result, "");
  if (!replace_file(file.string(), json, error)) return complain(error), false;
  bool good = write_description(options, robot, result, file.string());
  good = write_new_robot(options, robot, old_text, result, new_robot) && good;
  json = gap::gap_json(robot, options.find, result, new_robot);
  if (!replace_file(file.string(), json, error)) return complain(error), false;
  if (!draw_page("gap_report", file.string(), page.string(), error)) {
    complain(error);
    good = false;
  } else if (!options.json) {
    std::printf("report: %s\n", fs::absolute(page).c_str());
  }
  if (!options.json) {
    std::printf("result: %s\n", fs::absolute(file).c_str());
    if (!new_robot.empty()) std::printf("robot file with what was found: %s\n", fs::absolute(new_robot).c_str());
  }
  return good;
}

gap::Result search_logs(const RobotFile& robot, gap::Options& options, const std::string& label) {
  StepLine line;
  options.progress = [&](const char* step, double share) { line.show((label + step).c_str(), share); };
  options.stop = &stop_requested;
  return gap::find_gap(robot, options);
}

/// How the model that goes on is noted in the result of after.
gap::BeforeTold told_of(const GapOptions& options, const gap::Result& before) {
  gap::BeforeTold told;
  told.logs = options.before;
  told.hash = before.data_hash;
  told.verdict = gap::verdict_name(before.verdict);
  told.sentence = before.sentence;
  told.data_s = before.data_s;
  return told;
}

constexpr double kOtherNoise = 1.25;  // a sensor's noise over that of before: told

void note_noise(const gap::Result& before, gap::Result& after) {
  const double ratio = after.noise_ratio / before.noise_ratio;
  if (!(ratio > kOtherNoise || ratio < 1 / kOtherNoise)) return;
  after.notes.push_back("The sensors' noise is " + format("%.2g", ratio) + " times that of before (the worst channel " +
                        "of each): a sensor, its cable or its mounting changed.");
}

/// The model of before, from its logs by the usual search, takes the place of `robot` and `text`; then the logs of
/// after are asked what changed. Result::before is filled in any case; `robot` stays where there is no such model.
gap::Result find_change(GapOptions& options, std::unique_ptr<RobotFile>& robot, std::string& text) {
  gap::Options first = options.find;
  first.logs = options.before;
  first.hold_out.clear();
  first.budget_sigma = gap::Options().budget_sigma;
  gap::Result before = search_logs(*robot, first, "before: ");
  gap::BeforeTold told = told_of(options, before);
  gap::Result failed = before;
  failed.before = told;
  if (before.verdict == gap::Verdict::unfit) {
    failed.sentence = "The logs of before cannot be used.";
    return failed;
  }
  if (stop_requested != 0) {
    failed.sentence = "Stopped before the logs of after were looked at. Of those of before: " + before.sentence;
    failed.interrupted = true;
    return failed;
  }
  std::string error, with;
  if (!gap::write_robot(*robot, text, before.ranking[before.model_place], before.data_hash, with, error)) {
    failed.verdict = gap::Verdict::unfit;
    failed.sentence = "The model of before cannot be written as a robot file.";
    failed.reasons = {error};
    return failed;
  }
  auto made = parse_robot_file(with, robot->path, error);
  text = with;
  robot = std::move(made);
  if (!options.folder.empty()) {
    const std::string path = (fs::path(options.folder) / (robot->name + "_before.toml")).string();
    if (replace_file(path, text, error))
      told.robot_file = path;
    else
      complain(error);
  }
  options.find.before = &before.model;
  gap::Result after = search_logs(*robot, options.find, "after: ");
  options.find.before = nullptr;
  after.before = told;
  if (after.verdict == gap::Verdict::unfit) return after;
  note_noise(before, after);
  if (before.model.sigma > gap::kExplained_sigma)
    after.notes.push_back("The model of before leaves " + format("%.2f", before.model.sigma) +
                          " sigma on its own logs, and that is the measure here: what changed by less is not seen. " +
                          before.sentence);
  for (const std::string& note : before.notes) after.notes.push_back("Before: " + note);
  after.cpu_s += before.cpu_s;
  return after;
}

/// Empty: good.
std::string wrong_logs(const GapOptions& options) {
  const bool logs = !options.find.logs.empty();
  if (options.before.empty() && options.after.empty()) return logs ? "" : "LOGS is required: the logs to compare with";
  if (logs)
    return options.find.logs.front() + ": is neither of --before nor of --after; with these, name no other logs";
  if (options.before.empty()) return "--after needs what to compare with: --before LOGS";
  if (options.after.empty()) return "--before needs what to compare with: --after LOGS";
  std::error_code none;
  for (const std::string& log : options.before)
    for (const std::string& other : options.after)
      if (log == other || fs::equivalent(log, other, none))
        return other + ": is in --before and in --after; a log can be of one of them alone";
  return "";
}

int gap_command(GapOptions& options) {
  std::string error = wrong_logs(options);
  if (!error.empty()) return complain(error), kExitGapUsage;
  if (!options.after.empty()) options.find.logs = options.after;
  if (options.budget_sigma >= 0)
    options.find.budget_sigma = options.budget_sigma;
  else if (!options.before.empty())
    options.find.budget_sigma = 0;  // a change is told however small
  auto robot = read_robot_or_complain(options.robot);
  if (!robot) return kExitGapUsage;
  if (!(error = wrong_description(options, *robot)).empty()) return complain(error), kExitGapUsage;
  if (!options.folder.empty() && !can_be_written(options.folder, error)) return complain(error), kExitGapUsage;
  const StopOnInterrupt on_interrupt;
  std::string text;
  if (!read_text(robot->path, text))
    return complain(robot->path + ": cannot be read again: " + std::strerror(errno)), kExitGapUsage;
  gap::Result result =
      options.before.empty() ? search_logs(*robot, options.find, "") : find_change(options, robot, text);
  for (const std::string& note : result.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
  if (!options.json) std::fputs(gap::gap_text(*robot, result).c_str(), stdout);
  std::fflush(stdout);  // a residual may take minutes yet
  std::string json;
  bool good = true;
  if (!options.folder.empty())
    good = write_results(options, *robot, text, result, json);
  else
    json = gap::gap_json(*robot, options.find, result, "");
  if (options.json) good = std::fputs(json.c_str(), stdout) >= 0 && good;
  good = std::fflush(stdout) == 0 && good;
  if (!good) return kExitGapIncomplete;
  return result.interrupted || stop_requested != 0 ? kExitInterrupted
                                                   : gap::exit_code_of(result, options.find.budget_sigma);
}

std::string check_kind(const std::string& name) {
  if (find_effect(name.c_str()) >= 0) return "";
  Words known;
  for (std::uint32_t k = 0; k < effect_kind_count(); ++k) known.emplace_back(effect_info(k).name);
  const std::string near = nearest(name, known);
  return "there is no effect '" + name + "'; " + (near.empty() ? "" : "did you mean " + near + "? ") +
         "known: " + join(known);
}

constexpr char kGapFooter[] =
    "Compares what the model predicts with what was measured, in sigma: standard deviations of what sensor and\n"
    "process noise of the robot file leave; 1 is nothing but noise. Where there is more, it says where (joint, axis,\n"
    "region), which effect of the catalogue explains it (`tiller effects`), with parameters, or which several do\n"
    "equally well and how to tell them apart, or that none does; and shows on held-out windows what adding it brings.\n"
    "\n"
    "Exit codes: 0 no gap, or one within --budget, named or not; over the budget 1 named, 2 ambiguous, partly\n"
    "explained or unnamed; 2 a parameter off its prior; 3 the data cannot answer (what, where, how to mend it is\n"
    "printed); 4 wrong option, robot file or folder; 5 a result could not be written; 130 stopped by Ctrl-C, what was\n"
    "done is kept.\n"
    "\n"
    "With --before and --after it says what changed: which parameters (a mass, a gain, a friction, a delay) have\n"
    "another value and which effects are new, with sizes and 95 % intervals; code 0 where nothing changed, 1 where\n"
    "the change has a name. Both need logs of the amount above; the motions need not be the same.\n"
    "\n"
    "Examples:\n"
    "  tiller gap my_robot.toml run1.csv run2.csv run3.csv -o out/gap\n"
    "      look at out/gap/gap.html; out/gap/my_robot_gap.toml is the robot file with what was found\n"
    "  tiller gap my_robot.toml nightly/*.csv --budget 1.5 --json > gap.json || echo \"model and robot part\"\n"
    "      in CI: fails where a gap of more than 1.5 sigma opens (docs/guide/gap.md)\n"
    "  tiller gap my_robot.toml --before normal/*.csv --after today/*.csv -o out/change\n"
    "      what changed; out/change/my_robot_before.toml and my_robot_gap.toml are the robot then and now\n"
    "  tiller gap my_robot.toml run*.csv -o out/gap --description arm.xml --write-mjcf arm_found.xml\n"
    "      gives the friction, masses and gains that were found back to MuJoCo, with intervals as comments";

}  // namespace

void add_gap_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand(
      "gap", "find where model and logs disagree, name the missing effect, add it to the robot file");
  auto options = std::make_shared<GapOptions>();
  gap::Options& find = options->find;
  find.threads = std::max(1u, std::thread::hardware_concurrency());
  command->add_option("ROBOT", options->robot, "robot file (.toml): model, priors, sensors, [log]")->required();
  command->add_option("LOGS", find.logs,
                      "logs: CSV, ROS bags, ULog, MCAP, LCM event logs, records of `tiller run --record`");
  command->add_option("--before", options->before,
                      "logs of the robot as it was: with --after, what changed between the two is told");
  command->add_option("--after", options->after, "logs of the robot as it is, in the place of LOGS");
  command->add_option("--hold-out", find.hold_out, "logs for the proof alone (default: a share of LOGS)");
  command->add_option("-o,--out", options->folder, "folder for gap.html, gap.json and the new robot file");
  auto* mjcf = command->add_option("--write-mjcf", options->mjcf,
                                   "with -o: the MJCF with what was found, as far as an MJCF can say it");
  command->add_option("--write-urdf", options->urdf, "the same for a URDF")->excludes(mjcf);
  command->add_option("--description", options->description,
                      "MJCF or URDF that the robot was imported from (default for a URDF: [sim] file)");
  command
      ->add_option("--budget", options->budget_sigma,
                   "gap over 1 s up to which the exit code is 0, in sigma (default 1.1; with --before 0)")
      ->check(number_between(0, 1e6));
  command->add_option("--only", find.only, "effects to consider, separated by commas (default: all; `tiller effects`)")
      ->delimiter(',')
      ->check(check_kind);
  command->add_option("--max-effects", find.max_effects, "most effects in one explanation (default 3)")
      ->check(CLI::Range(1, 6));
  command
      ->add_option("--threads", find.threads, "threads that share the work; results are the same bits (default: all)")
      ->check(CLI::Range(1, 256));
  command
      ->add_option("--most-steps", find.most_steps,
                   "steps of the robot's period to work on (default 20000); of longer logs the pieces that tell most; "
                   "0: all")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--seed", find.seed, "of the permutations (default 1)")->check(CLI::PositiveNumber);
  command->add_flag("--json", options->json, "gap.json on standard output instead of the tables");
  command->footer(kGapFooter);
  command->callback([options, &exit_code] { exit_code = gap_command(*options); });
}

}  // namespace tiller::tools
