#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "tools/base/output_file.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/command/commands.hpp"
#include "tools/doctor/tick_forecast.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/tune/tune.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

struct TuneArguments {
  std::string robot, out;
  Words search;
  tune::TuneOptions options;
  bool quiet = false;
};

std::string beside(const std::string& robot, const char* ending) {
  const fs::path path = robot;
  return (path.parent_path() / (path.stem().string() + ending)).string();
}

bool choose_keys(const TuneArguments& a, const RobotFile& robot, const std::string& text,
                 std::vector<tune::SearchKey>& keys) {
  std::string error;
  for (const std::string& argument : a.search) {
    tune::SearchKey key;
    if (!tune::parse_search(argument, key, error) || !tune::check_search(text, key, error)) {
      complain(error);
      return false;
    }
    for (const tune::SearchKey& other : keys)
      if (other.path == key.path) {
        complain("--search " + argument + ": " + key.path + " is searched twice; leave one out");
        return false;
      }
    keys.push_back(key);
  }
  if (a.search.empty()) keys = tune::default_search(robot, text);
  if (!keys.empty()) return true;
  complain(robot.path + ": nothing to search by default; name keys, such as --search planner.horizon=20:80");
  return false;
}

/// On a terminal one line that overwrites itself, elsewhere a line a trial.
class Progress {
 public:
  explicit Progress(const tune::TuneOptions& options) : options_(options) {}

  void show(std::size_t index, const std::vector<tune::Trial>& trials) {
    const double spent_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    const double left_s = spent_s / ++done_ * static_cast<double>(options_.trials - (index + 1));
    const bool terminal = isatty(STDERR_FILENO) != 0, last = index + 1 >= options_.trials;
    const std::string left = last ? "" : format("; about %.0f s left", left_s);
    std::fprintf(stderr, terminal ? "\r\033[K%s%s%s" : "%s%s%s", tune::progress_text(options_, index, trials).c_str(),
                 left.c_str(), terminal && !last ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  const tune::TuneOptions& options_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  int done_ = 0;  // by this call: a resumed search has the others from its log
};

/// The new file, read back from where it is going to stand: what it names lies beside the old one.
bool write_tuned(const TuneArguments& a, const std::string& text) {
  std::string error, errors;
  const auto tuned = parse_robot_file(text, a.out, errors);
  if (!tuned) {
    complain(a.out + ": the tuned file names files relative to the robot file; write it beside it with -o\n" + errors);
    return false;
  }
  if (!replace_file(a.out, text, error)) {
    complain(error);
    return false;
  }
  std::printf("robot file: %s\n  next: tiller run %s --sim\n", fs::absolute(a.out).c_str(), a.out.c_str());
  TickForecast forecast;
  constexpr double kBudget_s = 0.25;
  if (!forecast_tick(*tuned, kBudget_s, false, forecast, error)) return true;
  const std::string misfit = misfit_text(*tuned, forecast);
  if (!misfit.empty()) complain(misfit);
  return true;
}

int tune_command(TuneArguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  std::ifstream file(a.robot, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  const std::string text = stream.str();
  tune::TuneOptions& options = a.options;
  if (!choose_keys(a, *robot, text, options.keys)) return kExitBadInput;
  if (a.out.empty()) a.out = beside(a.robot, "_tuned.toml");
  if (options.log.empty()) options.log = fs::path(a.out).replace_extension(".csv").string();
  std::string error;
  std::error_code code;
  if (fs::equivalent(a.out, a.robot, code)) return complain("-o " + a.out + ": is the robot file itself; name another");
  if (!can_write_file(a.out, error)) return complain("-o " + error + "; name a file that can be written");
  Progress progress(options);
  if (!a.quiet) options.progress = [&](std::size_t i, const std::vector<tune::Trial>& all) { progress.show(i, all); };
  const StopFlag stop;
  tune::Tuned result;
  if (!tune::tune(*robot, text, options, stop.flag(), result, error)) return complain(error);
  if (result.interrupted) {
    std::fprintf(stderr, "\ntiller: interrupted after %zu of %u trials; the same command with --resume goes on\n",
                 result.trials.size(), options.trials);
    return kExitInterrupted;
  }
  std::fputs(tune::report_text(options, result).c_str(), stdout);
  std::printf("trials: %s\n", fs::absolute(options.log).c_str());
  if (result.best == 0) return kExitOk;
  return write_tuned(a, result.text) ? kExitOk : kExitLogIncomplete;
}

}  // namespace

void add_tune_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("tune", "search settings of planner, cost and priors on the simulated plant");
  auto a = std::make_shared<TuneArguments>();
  tune::TuneOptions& o = a->options;
  o.threads = std::max(1u, std::thread::hardware_concurrency());
  command->add_option("ROBOT", a->robot, "robot file (.toml) with a [sim] section")->required();
  command
      ->add_option("--search", a->search,
                   "KEY=LOW:HIGH, or KEY=log:LOW:HIGH for even steps of the logarithm; as often as wanted. KEY is a "
                   "number of the file in planner, cost, posterior, parameters, effects or noise: planner.horizon, "
                   "planner.noise_sd.force_N, parameters.pole_mass_kg.uniform.1. Default: horizon (half to twice), "
                   "noise_sd (a quarter to four times), input and input rate weights (a tenth to ten times)")
      ->allow_extra_args(false);
  command->add_option("--trials", o.trials, "sets of values that are tried, the file's own first (default 60)")
      ->check(CLI::Range(2, 100000));
  command->add_option("--seconds", o.seconds, "robot time of each episode (default 5)")
      ->check(number_between(0.1, 3600));
  command->add_option("--train", o.train, "episodes of a trial, each with its seed (default 6)")
      ->check(CLI::Range(1, 1000));
  command->add_option("--test", o.test, "episodes on other seeds, for before and after (default 12)")
      ->check(CLI::Range(1, 1000));
  command->add_option("--seed", o.first_seed, "first training seed; tiller run --sim --seed repeats one (default 1)")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{9007199254740992}));
  command->add_option("-o,--out", a->out, "the tuned robot file (default: ROBOT_tuned.toml beside the robot file)");
  command->add_option("--log", o.log, "CSV with a row a trial (default: beside the tuned file, ending .csv)");
  command->add_flag("--resume", o.resume, "go on with the trials of the log; the result is that of an uncut run");
  command->add_option("--threads", o.threads, "episodes side by side; results are the same bits (default: all)")
      ->check(CLI::Range(1u, 256u));
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Each trial runs the controller in lockstep against the plant of [sim], once a training seed. Its return is minus\n"
      "the mean stage cost, always by the cost of ROBOT as it is. CMA-ES chooses the trials. Before and after are\n"
      "compared on seeds that no trial has seen (docs/guide/tune.md).\n\n"
      "Examples:\n"
      "  tiller tune robots/cart_pole.toml -o out/cart_tuned.toml\n"
      "      the default keys, 60 trials; then tiller run out/cart_tuned.toml --sim\n"
      "  tiller tune my_robot.toml --search planner.horizon=20:80 --search planner.noise_sd.force_N=log:0.5:10 --trials 100\n"
      "      two keys; after a cut, the same command with --resume");
  command->callback([a, &exit_code] { exit_code = tune_command(*a); });
}

}  // namespace tiller::tools
