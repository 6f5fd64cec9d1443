#include <unistd.h>
#include <cmath>
#include <csignal>
#include <cstdio>

#include "effects/effect_info.hpp"
#include "tools/base/interval_text.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"
#include "tools/gap/excite/excite.hpp"

namespace tiller::tools {
namespace {

using gap::Proposal;
using gap::Rival;
using gap::Separation;

enum ExciteExit : int { kNotAllSeparable = 2 };

struct Arguments {
  std::string robot, report, out;
  Words candidates, limits, keep;
  double seconds = 10, nats = 20;
  std::uint64_t seed = 1;
  std::uint32_t tries = 960;
  bool quiet = false;
};

/// "force_N=5" or "force_N=-2:5" of the known names.
bool parse_range(const std::string& text, const Words& known, const char* option, int& index, double& low, double& high,
                 std::string& error) {
  const std::size_t equals = text.find('=');
  index = equals == std::string::npos ? -1 : index_of(known, text.substr(0, equals));
  const std::string numbers = equals == std::string::npos ? "" : text.substr(equals + 1);
  const std::size_t colon = numbers.find(':');
  char *end_low = nullptr, *end_high = nullptr;
  const std::string first = numbers.substr(0, colon),
                    second = colon == std::string::npos ? "" : numbers.substr(colon + 1);
  low = std::strtod(first.c_str(), &end_low);
  high = colon == std::string::npos ? low : std::strtod(second.c_str(), &end_high);
  if (colon == std::string::npos) low = -high;
  const bool numeric =
      !first.empty() && *end_low == 0 && (colon == std::string::npos || (!second.empty() && *end_high == 0));
  if (index >= 0 && numeric && low < high) return true;
  error = std::string(option) + " " + text + ": write name=largest or name=low:high, name one of " + join(known);
  return false;
}

bool read_limits(const Arguments& a, const RobotFile& robot, gap::ExciteOptions& options, std::string& error) {
  const tiller_safety_config_t& s = robot.config.safety;
  for (std::uint32_t i = 0; i < robot.names.inputs.size(); ++i)
    options.range.push_back({s.input_low[i], s.input_high[i], s.input_rate_per_s[i], s.safe_command[i]});
  int index = 0;
  double low = 0, high = 0;
  for (const std::string& text : a.limits) {
    if (!parse_range(text, robot.names.inputs, "--limit", index, low, high, error)) return false;
    gap::InputRange& r = options.range[static_cast<std::size_t>(index)];
    if (low < r.low || high > r.high) {
      error = "--limit " + text + ": wider than [limits] of " + robot.path + " (" + number_text(r.low) + " .. " +
              number_text(r.high) + ")";
      return false;
    }
    r.low = low, r.high = high;
  }
  for (std::size_t m = 0; m < robot.names.measurements.size(); ++m) {
    const double least = s.measurement_low[m], most = s.measurement_high[m];
    if (std::isfinite(least) || std::isfinite(most))
      options.keep.push_back({robot.config.measured_state[m], least, most});
  }
  for (const std::string& text : a.keep) {
    if (!parse_range(text, robot.names.states, "--keep", index, low, high, error)) return false;
    options.keep.push_back({static_cast<std::uint32_t>(index), low, high});
  }
  return true;
}

bool read_candidates(const Arguments& a, const RobotFile& robot, std::vector<Rival>& rivals, std::string& error) {
  if (!a.report.empty() && !gap::read_rivals(robot, a.report, rivals, error)) return false;
  for (const std::string& text : a.candidates) {
    Rival rival;
    if (!gap::parse_rival(robot, text, rival, error)) return false;
    rivals.push_back(std::move(rival));
  }
  if (!rivals.empty()) return true;
  error =
      "no candidates: --gap report/gap.json takes those that `tiller gap` could not tell apart, --candidates "
      "coulomb_friction,stribeck_friction names them";
  return false;
}

/// Plain enough for any player: time and inputs, each in force until the next row.
std::string csv_of(const RobotFile& robot, const Proposal& p) {
  std::string text = "time_s," + join(robot.names.inputs, ",") + "\n";
  for (std::size_t k = 0; k < p.sequence.points(); ++k) {
    text += format("%.6f", p.sequence.period_s * static_cast<double>(k));
    for (std::uint32_t i = 0; i < p.sequence.inputs; ++i)
      text += format(",%.6g", p.sequence.value[k * p.sequence.inputs + i]);
    text += "\n";
  }
  return text;
}

std::string candidates_text(const std::vector<Rival>& rivals) {
  std::string text = "candidates:\n";
  for (std::size_t r = 0; r < rivals.size(); ++r) {
    text += format("  %c  %s", static_cast<char>('A' + r), rivals[r].name.c_str());
    std::size_t first = rivals[r].value.size();
    for (const gap::EffectAt& e : rivals[r].effects) first -= static_cast<std::size_t>(effect_info(e.kind).param_count);
    for (std::size_t i = first; i < rivals[r].value.size(); ++i)
      text += format(", %s %.3g%s", rivals[r].params[i].c_str(), rivals[r].value[i],
                     rivals[r].given[i] ? "" : " (a guess, also 0.4 and 2.5 times it)");
    text += "\n";
  }
  return text;
}

std::string duration(double seconds) { return seconds < 1 ? "under 1 s" : format("%.0f s", std::ceil(seconds)); }

std::string pairs_text(const Arguments& a, const Proposal& p) {
  std::string text = format("\nexpected log odds in nats over %g s, and the time to %g nats:\n", a.seconds, a.nats);
  text += "  pair    this sequence   multisine of equal rms   record for\n";
  for (const Separation& s : p.pairs)
    text += format("  %c, %c  %14.3g %24.3g   %s\n", static_cast<char>('A' + s.a), static_cast<char>('A' + s.b), s.nats,
                   s.baseline_nats, s.separable ? duration(s.seconds).c_str() : "no input found separates them");
  for (const Separation& s : p.pairs) {
    const char one = static_cast<char>('A' + s.a), other = static_cast<char>('A' + s.b);
    if (s.nested)
      text += format(
          "  %c, %c: %c can do what %c does; the record shows %c where it is true, and else nothing against it\n", one,
          other, one, other, one);
    if (!s.separable) text += format("  %c, %c: not by any input; instead: ", one, other) + s.advice + "\n";
  }
  return text;
}

std::string reach_text(const RobotFile& robot, const Proposal& p) {
  std::string text = "\nreached by any candidate and any draw of the priors:";
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    text += format(" %s %s%s", robot.names.states[i].c_str(), interval_text(p.state_low[i], p.state_high[i], 3).c_str(),
                   i + 1 < robot.names.states.size() ? "," : "\n");
  return text;
}

/// One line that overwrites itself on a terminal; nothing elsewhere.
void show_progress(const char* step, double share) {
  static int last = -1;
  const int percent = static_cast<int>(100 * share);
  if (percent == last) return;
  last = percent;
  std::fprintf(stderr, "\r%s %d %% ", step, percent);
}

int write_csv(const Arguments& a, const RobotFile& robot, const Proposal& p) {
  std::string error;
  if (!replace_file(a.out, csv_of(robot, p), error)) return complain(error);
  std::printf("\nsequence: %s, %.1f s, rms", a.out.c_str(), p.sequence.seconds());
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
    std::printf(" %s %.3g", robot.names.inputs[i].c_str(), p.rms[i]);
  const double repeats = std::ceil(p.record_s / a.seconds);
  std::printf("\nrecord for %s", duration(std::max(p.record_s, std::min(a.seconds, p.sequence.seconds()))).c_str());
  if (repeats > 1) std::printf(" (%.0f times the sequence)", repeats);
  std::printf(", then: tiller gap %s <that log>.csv -o report\n", a.robot.c_str());
  return p.all_separable ? static_cast<int>(kExitOk) : static_cast<int>(kNotAllSeparable);
}

int excite_command(const Arguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  gap::ExciteOptions options;
  options.seconds = a.seconds;
  options.target_nats = a.nats;
  options.seed = a.seed;
  options.rounds = std::max(1u, a.tries / options.population);
  std::vector<Rival> rivals;
  std::string error;
  if (!read_limits(a, *robot, options, error) || !read_candidates(a, *robot, rivals, error)) return complain(error);
  const bool shows = !a.quiet && isatty(STDERR_FILENO);
  if (shows) options.progress = show_progress;
  const StopFlag stop;
  options.stop = &stop.flag();
  Proposal proposal;
  if (!propose_excitation(rivals, options, proposal, error)) return complain(error);
  if (shows) std::fprintf(stderr, "\r%40s\r", "");
  std::printf("%s%s%s", candidates_text(rivals).c_str(), pairs_text(a, proposal).c_str(),
              reach_text(*robot, proposal).c_str());
  return write_csv(a, *robot, proposal);
}

}  // namespace

void add_excite_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("excite", "propose an input sequence that distinguishes candidate effects");
  auto a = std::make_shared<Arguments>();
  command->add_option("ROBOT", a->robot, "robot file (.toml): model, priors, sensors, noise, [limits]")->required();
  command->add_option("--gap", a->report, "gap.json of `tiller gap`: its ambiguity set, with the values it found");
  command
      ->add_option("--candidates", a->candidates,
                   "kind@port:parameter=value, separated by commas; more parameters after another ':', several effects "
                   "joined by '+', 'nominal' for the robot file as it is. Port and values may be left out")
      ->delimiter(',');
  command
      ->add_option("-o,--out", a->out, "the sequence: CSV of time_s and the inputs, each in force until the next row")
      ->required();
  command->add_option("--seconds", a->seconds, "length of the sequence (default 10)")->check(number_between(0.5, 300));
  command->add_option("--nats", a->nats, "log odds to record for (default 20: e^20 to one)")
      ->check(number_between(1, 1e4));
  command->add_option("--limit", a->limits, "input=largest or input=low:high, within [limits]")->delimiter(',');
  command
      ->add_option("--keep", a->keep,
                   "state=largest or state=low:high that no candidate may leave under any draw of the priors; those "
                   "of [measurement] low and high always count")
      ->delimiter(',');
  command->add_option("--tries", a->tries, "sequences that are tried (default 960)")->check(CLI::Range(48u, 1000000u));
  command->add_option("--seed", a->seed, "of the search (default 1)");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Searches steps, chirps, multisines, square waves, hold-and-release and slow ramps for the sequence under which\n"
      "the candidates' outputs differ most after the others were refitted (docs/guide/excite.md). Begins at [start] of the\n"
      "robot file, open loop; play it on the robot, log what is measured, and give the log to `tiller gap`.\n\n"
      "Exit codes: 0 done; 1 wrong input; 2 done, but some pair is not separable by any input that was found.\n\n"
      "Examples:\n"
      "  tiller excite my_robot.toml --gap report/gap.json -o excite.csv\n"
      "      what the report could not tell apart\n"
      "  tiller excite robots/pendulum.toml --candidates input_delay:delay_s=0.02,actuator_lag:time_constant_s=0.02 \\\n"
      "      --keep angle_rad=2 --limit torque_Nm=1 --seconds 8 -o excite.csv\n"
      "      two suspicions, within bounds");
  command->callback([a, &exit_code] { exit_code = excite_command(*a); });
}

}  // namespace tiller::tools
