#include <cstdio>
#include <filesystem>
#include <memory>

#include "tools/cli/log_arguments.hpp"
#include "tools/cli/view_options.hpp"
#include "tools/command/commands.hpp"
#include "tools/replay/replay.hpp"
#include "tools/run/foresight.hpp"
#include "tools/run/run_facts.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string log, robot;
  bool real_time = false;
  ViewerOptions view;
  Overrides overrides;
};

/// Ticks of a log as the run had them: the replaying controller knows what a log does not hold.
class LogView {
 public:
  LogView(const RobotFile& robot, Viewer& viewer)
      : robot_(robot), viewer_(viewer), foresight_(robot.config.planner.horizon, robot.config.model->state_count) {}

  void show(const tiller_t* controller, const RecordEntry& entry, const tiller_info_t& info) {
    if (begin_us_ < 0) begin_us_ = entry.record.now_us;
    tick_.entry = entry;
    tick_.info = info;
    tick_.status = static_cast<tiller_status_t>(entry.record.status);
    tick_.time_s = 1e-6 * static_cast<double>(entry.record.now_us - begin_us_);
    tick_.tick_us = 1e-3 * static_cast<double>(entry.record.tick_ns);
    for (std::uint32_t i = 0; i < robot_.config.param_count; ++i) {
      if (robot_.config.priors[i].kind == tiller_prior_fixed) continue;
      (void)tiller_get_quantile(controller, i, 0.05, &tick_.q05[i]);
      (void)tiller_get_quantile(controller, i, 0.95, &tick_.q95[i]);
    }
    if (robot_.config.planner.predict_spread != 0) foresight_.look(controller, info);
    tick_.was_foreseen = foresight_.recall(info, tick_.foreseen_mean, tick_.foreseen_sd);
    viewer_.show_all(controller, tick_);
  }

 private:
  const RobotFile& robot_;
  Viewer& viewer_;
  Foresight foresight_;
  LoggedTick tick_;
  std::int64_t begin_us_ = -1;
};

int view_command(Arguments a) {
  put_log_first(a.log, a.robot);
  if (std::error_code ignored; !std::filesystem::exists(a.log, ignored)) return complain(a.log + ": no such file");
  const auto robot = read_robot_of_log("view", a.log, a.robot);
  if (!robot || !apply_overrides(a.overrides, *robot)) return kExitBadInput;
  RecordedRun run;
  std::string error;
  if (!read_recorded_run(a.log, *robot, run, error)) return complain(error);
  if (!run.note.empty()) std::printf("%s: %s\n", a.log.c_str(), run.note.c_str());
  const RunStory story = {robot->name + ", " + std::filesystem::path(a.log).filename().string(), "", true, {}};
  auto viewer = Viewer::open(a.view, *robot, run_facts_json(*robot, RunResult{}, story), error);
  if (!viewer) return complain(error);
  LogView view(*robot, *viewer);
  ReplayOptions options;
  options.real_time = a.real_time;
  options.watch = [&](const tiller_t* controller, const RecordEntry& entry, const tiller_info_t& info) {
    view.show(controller, entry, info);
  };
  ReplayResult result;
  if (!replay_through_file(*robot, run, options, result, error)) return complain(a.log + ": " + error);
  std::printf("%s\n", viewer->close().c_str());
  if (result.different + result.behind_different > 0)
    std::printf(
        "%zu of %zu commands of the replay are not the log's: states, plans and particles are the replay's "
        "(`tiller replay` tells where they part)\n",
        result.different + result.behind_different, run.entries.size());
  return run.cut_off ? kExitLogIncomplete : kExitOk;
}

}  // namespace

void add_view_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("view", "show a log in Rerun or Foxglove, with the plans and particles behind it");
  auto a = std::make_shared<Arguments>();
  a->view.kind = "rerun";
  command
      ->add_option("LOG", a->log,
                   "of tiller run --record (record, MCAP or LCM log) or --log (CSV), of lcm-logger, or from elsewhere: "
                   "whatever `tiller replay` reads")
      ->required();
  command->add_option("ROBOT", a->robot, "the robot file of that run; an MCAP carries it");
  add_view_options(*command, a->view);
  command->add_flag("--real-time", a->real_time, "at the pace of the log (default: as fast as it goes)");
  add_override_options(*command, a->overrides);
  command->footer(
      "The log goes through a controller again, as `tiller replay` has it: plans, predicted bands and particles come\n"
      "from there, measurements and commands from the log.\n\n"
      "Examples:\n"
      "  tiller run robots/cart_pole.toml --sim --seconds 5 --record out/run.mcap\n"
      "  tiller view out/run.mcap\n"
      "      in Rerun\n"
      "  tiller view out/run.mcap --view foxglove --view-file out/view.mcap --view-layout out/view.json\n"
      "      a file and a layout that Foxglove opens");
  command->callback([a, &exit_code] { exit_code = view_command(*a); });
}

}  // namespace tiller::tools
