#include <cstdio>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/cli/method_options.hpp"
#include "tools/cli/view_options.hpp"
#include "tools/command/commands.hpp"
#include "tools/doctor/tick_forecast.hpp"
#include "tools/links/lcm_arming.hpp"
#include "tools/links/model_plant.hpp"
#include "tools/open/horizon.hpp"
#include "tools/open/substeps.hpp"
#include "tools/refit/refit_by_simulator.hpp"
#include "tools/refit/refit_prior.hpp"
#include "tools/robot/calibration.hpp"
#include "tools/robot/goals.hpp"
#include "tools/robot/transport_names.hpp"
#include "tools/run/arm_keys.hpp"
#include "tools/run/episodes.hpp"
#include "tools/run/run_facts.hpp"
#include "tools/run/run_loop.hpp"
#include "tools/run/run_summary.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string robot, transport, log, report, goals, posterior, save_posterior, alarm_log, histogram;
  Words records;
  std::uint32_t episodes = 1;
  bool sim = false, arm = false, lockstep = false, real_time = false, quiet = false;
  double seconds = 0;
  double calibrate_s = 0;
  bool calibrates = false;
  double wait_s = 10, alarm_log_s = RecorderOptions().alarm_log_s;
  double patience_s = TransportLinkOptions::kPatience_s;
  bool online = false;  // the particles learn within the episodes of a refitted prior
  RefitOptions refit{"posterior", {}};
  std::string simulator;    // of the method bayes_sim
  RefitPrior by_simulator;  // made of it
  Overrides overrides;
  ViewerOptions view;

  bool refits() const { return refit.method != "posterior"; }
};

/// The robot, and the plant that it is where it is in this process.
struct Opened {
  std::unique_ptr<SimPlant> ode;
  std::unique_ptr<ModelPlant> model;
  std::unique_ptr<Link> link;  // after the plants: it goes before them
  std::vector<double> true_params;
};

bool open_plant(const Arguments& a, const RobotFile& robot, Opened& opened, std::string& error) {
  opened = {};
  if (robot.sim.plant == "model") {
    opened.model = ModelPlant::make(robot, error);
    if (!opened.model) return false;
    opened.link = make_model_link(robot, *opened.model);
    opened.true_params = opened.model->true_params();
    return true;
  }
  opened.ode = make_sim_plant(robot, error);
  if (!opened.ode) return false;
  opened.link = make_sim_link(robot, *opened.ode, a.real_time);
  opened.true_params = opened.ode->true_params;
  return true;
}

std::string transport_kind(const Arguments& a, const RobotFile& robot) {
  return a.transport.empty() ? robot.transport.kind : transport_named(a.transport);
}

bool open_link(const Arguments& a, const RobotFile& robot, Opened& opened, std::string& error) {
  std::unique_ptr<Link>& link = opened.link;
  if (a.sim) {
    (void)open_plant(a, robot, opened, error);
  } else {
    TransportLinkOptions options;
    options.kind = transport_kind(a, robot);
    options.kept_off = !a.arm;
    options.lockstep = a.lockstep;
    options.patience_s = a.patience_s;
    options.by_clock = robot.realtime.by_clock;
    if (options.kind.empty()) {
      error = robot.path + ": no [transport] section; add one, name one with --transport, or try --sim";
    } else {
      link = make_transport_link(robot, options, error);
    }
  }
  return link != nullptr;
}

/// The page, from wherever the whole log is.
int report_run(const Arguments& a, const RobotFile& robot, const RunResult& result,
               const std::vector<double>& true_params, const std::vector<double>& sd_without_probing) {
  if (a.report.empty()) return result.exit_code;
  if (result.files.readable_log.empty()) {
    complain("no report: the log that it is made from is not complete");
    return result.exit_code ? result.exit_code : static_cast<int>(kExitLogIncomplete);
  }
  std::string error;
  const bool safe = result.exit_code == kExitSafe;
  const auto fault = static_cast<tiller_status_t>(result.info.first_fault);
  const std::string outcome = safe ? std::string("ended in SAFE: ") + tiller_status_text(fault) : "";
  if (write_run_facts(robot, result, {robot.name, outcome, !safe, true_params, sd_without_probing}, error) &&
      write_report(result.files.readable_log, a.report, error)) {
    std::printf("report: %s\n", std::filesystem::absolute(a.report).c_str());
    return result.exit_code;
  }
  complain(error);
  return result.exit_code ? result.exit_code : static_cast<int>(kExitLogIncomplete);
}

/// Deviations of the parameters at the end of the same simulated run, had it not been moved to find out: what the page
/// compares with. Empty: nothing was, or there is no plant that starts again.
std::vector<double> run_without_probing(const Arguments& a, const RobotFile& robot, RunOptions options,
                                        const RunResult& probed) {
  const bool repeatable = a.sim && !a.real_time && a.episodes == 1 && !a.refits() && options.goal_source == nullptr;
  if (a.report.empty() || !repeatable || !(robot.config.probe.weight > 0.0)) return {};
  if (probed.exit_code != kExitOk || probed.interrupted) return {};
  RobotFile without = robot;
  without.config.probe.weight = 0.0;
  options.files = {};
  options.calibrate = false;
  options.arm_sources.clear();
  Opened opened;
  std::string error;
  if (!open_link(a, without, opened, error)) return {};
  if (!a.quiet) std::printf("the same run without probing, for the page ...\n");
  const RunResult result = run_robot(without, *opened.link, options);
  if (result.exit_code != kExitOk || result.interrupted) return {};
  return {result.info.param_sd, result.info.param_sd + robot.config.param_count};
}

/// Beside the run's other files; without any, in the working folder under the robot file's name.
std::string alarm_log_of(const Arguments& a) {
  if (!a.alarm_log.empty()) return a.alarm_log;
  const std::string beside = !a.log.empty() ? a.log : a.records.empty() ? "" : a.records.front();
  if (!beside.empty()) return std::filesystem::path(beside).replace_extension(".alarm.csv").string();
  return std::filesystem::path(a.robot).stem().string() + ".alarm.csv";
}

void tell_next_step(const Arguments& a, const RunResult& result) {
  if (result.files.alarm_log.empty()) return;
  const std::string report = std::filesystem::path(result.files.alarm_log).replace_extension("").string() + ".report";
  std::printf("%.1f s about the alarm: %s\n  next: tiller gap %s %s -o %s\n", result.files.alarm_log_s,
              result.files.alarm_log.c_str(), a.robot.c_str(), result.files.alarm_log.c_str(), report.c_str());
}

/// Time is the plant's, not the wall clock's.
bool is_simulated(const Arguments& a) { return a.lockstep || (a.sim && !a.real_time); }

void write_histogram(const Arguments& a, const RunResult& result) {
  std::string error;
  if (!a.histogram.empty() && !replace_file(a.histogram, histogram_csv(result.pace), error)) complain(error);
}

/// Who may arm and disarm a robot behind a transport. A plant in this process is nobody's danger.
class ArmSources {
 public:
  ArmSources(const Arguments& a, const RobotFile& robot) {
    if (a.sim) return;
    add(std::make_unique<ArmKeys>());
    if (transport_kind(a, robot) != "lcm") return;
    auto messages = std::make_unique<LcmArming>(robot);
    std::string deaf;  // the transport's own refusal says why; without one, the run says what arms it
    if (messages->open(deaf)) add(std::move(messages));
  }
  std::vector<ArmSource*> list() const {
    std::vector<ArmSource*> all;
    for (const auto& source : sources_) all.push_back(source.get());
    return all;
  }

 private:
  void add(std::unique_ptr<ArmSource> source) { sources_.push_back(std::move(source)); }
  std::vector<std::unique_ptr<ArmSource>> sources_;
};

EpisodesOptions episodes_options(const Arguments& a, const std::vector<Goal>& goals, GoalSource* goal_source) {
  EpisodesOptions options;
  options.episodes = a.episodes;
  options.posterior = a.posterior.empty() ? a.save_posterior : a.posterior;
  options.load = !a.posterior.empty();
  options.simulated = a.sim;
  if (a.refits()) options.refit = a.by_simulator ? a.by_simulator : make_refit(a.refit);
  options.run.arm_at_once = a.sim || a.arm;
  options.run.seconds = a.seconds;
  options.run.threads = a.overrides.threads;
  options.run.quiet = a.quiet;
  options.run.files.log = a.log;
  options.run.files.records = a.records;
  options.run.real_time = !is_simulated(a);
  options.run.goals = goals;
  options.run.goal_source = goal_source;
  options.run.files.alarm_log = a.alarm_log_s > 0 ? alarm_log_of(a) : "";
  options.run.files.alarm_log_s = a.alarm_log_s;
  options.run.first_wait_s = a.wait_s;
  options.run.calibrate = a.calibrates;
  return options;
}

/// How far the plan looks ahead and how finely it steps, and what the model asks for: of what the robot file says, or
/// of what was chosen where it says nothing.
void tell_choices(const RobotFile& robot) {
  const tiller_config_t& c = robot.config;
  const std::string horizon = horizon_text(c);
  std::printf("plan: %u steps ahead (%.3g s)%s%s\n", c.planner.horizon, c.planner.horizon * c.period_s,
              horizon.empty() ? "" : "; ", horizon.c_str());
  std::printf("period: %s s, %u substep(s); step error %s\n", number_text(c.period_s).c_str(), c.substeps,
              step_error_text(robot).c_str());
}

/// Predicted time of a tick, before a simulated run hides it; true where it does not fit the period.
bool predict_tick(const Arguments& a, const RobotFile& robot) {
  constexpr double kBudget_s = 0.25;
  const double deadline_s = 1e-6 * robot.config.planner.deadline_us;
  TickForecast forecast;
  std::string error;
  if (!forecast_tick(robot, kBudget_s, false, forecast, error)) return false;  // the run itself says why
  if (!a.quiet) std::printf("tick: %s\n", forecast_text(robot, forecast).c_str());
  if (!a.quiet && deadline_s > 0 && deadline_s < forecast.at_cap.tick_s)
    std::printf("  simulated time lets a plan finish; by the wall clock the deadline of %s ends it\n",
                duration_text(deadline_s).c_str());
  std::fflush(stdout);
  const std::string misfit = misfit_text(robot, forecast);
  if (!misfit.empty()) complain(misfit);
  return !misfit.empty();
}

/// Why the method between episodes cannot be what the other options say; empty: it can.
std::string contradicted_method(const Arguments& a) {
  if (!a.refits() && !a.simulator.empty()) return "--simulator: only --method bayes_sim reads it; give both";
  if (!a.refits())
    return a.online ? "--online: the method posterior learns within the episodes anyway; leave --online out" : "";
  const std::string method = "--method " + a.refit.method;
  if (a.simulator.empty() == (a.refit.method == "bayes_sim"))
    return a.simulator.empty() ? method + ": name the black box with --simulator FILE (docs/guide/simulator.md)"
                               : "--simulator: " + method + " does not read it; choose --method bayes_sim";
  if (a.overrides.frozen)
    return "--frozen, " + method +
           ": the one keeps the prior, the other refits it between episodes; give one (within "
           "an episode the prior stays as it is without --online)";
  if (a.seconds <= 0) return method + ": give each episode a length with --seconds";
  if (a.episodes == 1 && a.posterior.empty() && a.save_posterior.empty())
    return method +
           ": of one episode without a file, nothing would read the refitted prior; give --episodes, "
           "--posterior or --save-posterior";
  return "";
}

/// SimOpt controls with what it has refitted between the episodes, and does not learn within them.
bool prepare_refit(Arguments& a, RobotFile& robot) {
  if (!a.refits()) return true;
  if (!a.online) robot.config.posterior.enabled = 0;
  std::string error;
  if (a.refit.method == "bayes_sim") {
    a.by_simulator = make_simulator_refit(a.simulator, robot, a.refit.how.simulations, a.refit.how.iterations, error);
    if (a.by_simulator) return true;
  } else if (check_refit(a.refit, robot, error)) {
    return true;
  }
  complain(error);
  return false;
}

/// The robot file's own length is that of [probe] calibrate_s.
bool take_calibration(const Arguments& a, RobotFile& robot) {
  if (!a.calibrates) return true;
  if (a.calibrate_s > 0) robot.calibration.seconds = a.calibrate_s;
  std::string error;
  if (allow_calibration(robot, error)) return true;
  complain(error);
  return false;
}

int run_command(Arguments& a) {
  auto robot = read_robot_or_complain(a.robot);
  if (!robot || !apply_overrides(a.overrides, *robot) || !prepare_refit(a, *robot)) return kExitBadInput;
  if (!take_calibration(a, *robot)) return kExitBadInput;
  robot->transport.kind = transport_kind(a, *robot);
  if (!a.quiet) tell_choices(*robot);
  bool told = !a.sim || robot->config.planner.deadline_us > 0;
  if (a.sim) told = predict_tick(a, *robot) || told;
  // a plan that ends by the wall clock is not repeatable: in lockstep the iterations alone decide
  if (is_simulated(a)) robot->config.planner.deadline_us = 0;
  std::string unwritable;  // a page is worth knowing of before the robot moves; a log is kept in memory where it must
  if (!a.report.empty() && !can_write_file(a.report, unwritable)) return complain("--report " + unwritable);
  std::vector<Goal> goals;
  Words problems;
  const std::unique_ptr<GoalSource> goal_source = make_goal_source(a.goals, *robot);
  std::string deaf;
  if (goal_source && !goal_source->open(deaf)) return complain(deaf);
  if (!a.goals.empty() && !goal_source && !read_goals(a.goals, *robot, goals, problems)) {
    for (const std::string& problem : problems) (void)complain(problem);
    return kExitBadInput;
  }
  if (a.episodes > 1 && a.seconds <= 0) return complain("--episodes: give each a length with --seconds");
  if (!a.report.empty() && a.log.empty()) {
    a.log = std::filesystem::path(a.report).replace_extension(".csv").string();
  }
  Opened opened;
  std::unique_ptr<Viewer> viewer;  // one for all episodes
  const OpenEpisode open = [&](const RobotFile& now, std::vector<double>& true_params, std::string& error) {
    // a robot behind a transport stays connected; a plant in this process starts again
    if ((a.sim || !opened.link) && !open_link(a, a.sim ? now : *robot, opened, error))
      return static_cast<Link*>(nullptr);
    true_params = opened.true_params;
    if (!a.view.kind.empty() && !viewer) {
      const RunStory story = {robot->name, "", true, true_params};
      viewer = Viewer::open(a.view, *robot, run_facts_json(*robot, RunResult{}, story), error);
      if (!viewer) return static_cast<Link*>(nullptr);
    }
    return opened.link.get();
  };
  const ArmSources arm_sources(a, *robot);
  EpisodesOptions episodes = episodes_options(a, goals, goal_source.get());
  episodes.run.arm_sources = arm_sources.list();
  if (!a.view.kind.empty())
    episodes.run.watch = [&viewer](const tiller_t* controller, const LoggedTick& tick) {
      viewer->show(controller, tick);
    };
  const EpisodesResult all = run_episodes(*robot, episodes, open);
  if (viewer) std::printf("%s\n", viewer->close().c_str());
  if (all.last.ticks == 0) return all.exit_code;
  RunOptions options;
  options.files.true_params = opened.true_params;
  options.real_time = !is_simulated(a);
  if (a.episodes > 1) std::printf("\n%s\nthe last one: ", episodes_table(*robot, all.rows).c_str());
  std::fputs(summary(*robot, options, all.last).c_str(), stdout);
  if (const std::string counted = opened.link->counters(); !counted.empty()) std::printf("  %s\n", counted.c_str());
  if (const std::string counted = goal_source ? goal_source->counters() : ""; !counted.empty())
    std::printf("  %s\n", counted.c_str());
  for (const ArmSource* source : episodes.run.arm_sources)
    if (const std::string counted = source->counters(); !counted.empty()) std::printf("  %s\n", counted.c_str());
  const std::string misfit = misfit_text(*robot, 1e-6 * all.last.pace.tick_time.quantile_us(0.5));
  if (!told && !misfit.empty()) complain(misfit);
  if (!all.last.files.readable_log.empty()) std::printf("log: %s\n", all.last.files.readable_log.c_str());
  tell_next_step(a, all.last);
  write_histogram(a, all.last);
  const std::vector<double> sd_without = run_without_probing(a, *robot, episodes.run, all.last);
  const int reported = report_run(a, *robot, all.last, opened.true_params, sd_without);
  return all.exit_code ? all.exit_code : reported;
}

constexpr char kRunFooter[] =
    "Over a transport the run begins in STANDBY. Keys: a arms, d or space disarms. Scripts say --arm. Ctrl-C stops\n"
    "the robot with its safe command and keeps the log.\n\n"
    "Examples:\n"
    "  tiller run robots/cart_pole.toml --sim --seconds 10 --report out/run.html\n"
    "      the controller against the simulated plant, as fast as it goes, with a page at the end\n"
    "  tiller run robots/cart_pole.toml --sim --episodes 5 --seconds 6 --posterior out/cart.posterior.json\n"
    "      what one episode learnt is the next one's prior; run it again, and it goes on from the file\n"
    "  tiller run robots/cart_pole.toml --sim --episodes 5 --seconds 6 --method simopt --kl 1\n"
    "      SimOpt: control with a Gaussian over the parameters, one bounded step of it after each episode\n"
    "  tiller run robot.toml --sim --episodes 5 --seconds 6 --method bayes_sim --simulator mine.toml --simulations 900\n"
    "      Online BayesSim: control with the posterior of a simulator of your own, learnt anew after each episode\n"
    "  tiller run robots/cart_pole.toml --transport lcm --log run.csv\n"
    "      a robot (or `tiller sim robots/cart_pole.toml --serve lcm`) over LCM: sensors are shown, the key a arms,\n"
    "      Ctrl-C ends\n"
    "  tiller run robots/cart_pole.toml --transport lcm --arm\n"
    "      the same for a script: it moves at once";

// What the posterior learns from one episode to the next. Returns the names of the methods.
Words add_learning_options(CLI::App& command, Arguments& a) {
  auto* posterior = command.add_option(
      "--posterior", a.posterior,
      "file: the prior if it is there (in the place of the robot file's), written after every complete episode");
  command.add_option("--save-posterior", a.save_posterior, "the same file, only written")->excludes(posterior);
  command
      .add_option("--episodes", a.episodes,
                  "runs of --seconds one after the other, each from the start; the posterior of "
                  "one is the prior of the next (docs/guide/episodes.md)")
      ->check(CLI::Range(1, 100000));
  MethodOptionsText said{refit_methods(), "what the next episode's prior is made by", "(default 1, a step an episode)",
                         "(default 1 for each learnt parameter)"};
  said.methods.insert(said.methods.begin(), "posterior");
  said.methods.emplace_back("bayes_sim");
  a.refit.how.iterations = 1;
  add_method_options(command, said, a.refit.method, a.refit.how);
  command.add_option("--simulator", a.simulator,
                     "simulator file of --method bayes_sim: Online BayesSim, its black box simulates between episodes");
  command.add_flag("--online", a.online,
                   "the particles learn within each episode, too, from the prior that --method has refitted (default: "
                   "only the method posterior learns within episodes)");
  return said.methods;
}

}  // namespace

void add_run_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("run", "steer a robot (or its simulated plant) by its robot file");
  auto a = std::make_shared<Arguments>();
  command->add_option("ROBOT", a->robot, "robot file (.toml)")->required();
  auto* sim = command->add_flag("--sim", a->sim, "the plant of [sim] in this process, as fast as it goes");
  command->add_flag("--real-time", a->real_time, "with --sim: not faster than the wall clock")->needs(sim);
  command->add_option("--transport", a->transport, "instead of the robot file's: " + join(transport_words()))
      ->check(CLI::IsMember(transport_words()))
      ->excludes(sim);
  command->add_flag(
      "--arm", a->arm,
      "over a transport: permit motion as soon as the drives are ready. Without it the run begins in "
      "STANDBY, with the drives off: it shows what the sensors read, and moves nothing until the key a, or "
      "a message arm_t over LCM, arms (docs/guide/first_power_up.md)");
  auto* lockstep = command->add_flag(
      "--lockstep", a->lockstep,
      "time is that of the measurements; each tick waits for one, and the same seed gives the same commands");
  command
      ->add_option("--patience", a->patience_s,
                   "lockstep: wall time in s to wait for a measurement; then the tick comes without one (default 2)")
      ->check(number_between(0.001, 1e9))
      ->needs(lockstep);
  command
      ->add_option("--seconds", a->seconds,
                   "end after this much robot time (default: at Ctrl-C); counts anew when a key or a message arms")
      ->check(number_between(0.001, 1e9));
  command
      ->add_option(
          "--calibrate", a->calibrate_s,
          "S, or nothing for [probe] calibrate_s: first move for so many s for learning alone: the motion that tells most of the parameters, inside "
          "of [probe] box, planned anew in every tick; then the task (docs/guide/calibrate.md)")
      ->expected(0, 1)
      ->check(number_between(0.001, 3600));
  command->add_option("--wait", a->wait_s, "wall time in s to wait for the first measurement")
      ->check(number_between(0.001, 1e9));
  command->add_option(
      "--goals", a->goals,
      "CSV of goals: time_s, then states, outputs or angles of frames by name; each row is the target from "
      "its time on after the first measurement, or after a key or a message has armed (docs/reference/costs.md). lcm: "
      "from the channel GOAL of [transport]; ros2: JointTrajectory and PoseStamped (docs/guide/ros2.md)");
  command->add_option("--log", a->log, "write a CSV row per tick")->check([](const std::string& path) {
    const std::string ending = std::filesystem::path(path).extension().string();
    const bool other = ending == ".mcap" || ending == ".lcm" || ending == ".lcmlog";
    return other ? path + ": --log writes CSV; --record writes " + ending : std::string();
  });
  command->add_option("--report", a->report, "write a one-file HTML page (and its CSV beside it)");
  command
      ->add_option("--record", a->records,
                   "write every input and output, for tiller replay, gap and identify; as often as wanted. The ending "
                   "tells the format: .mcap (Foxglove, PlotJuggler), .lcm (lcm-logplayer), else a record of this build")
      ->allow_extra_args(false);
  command->add_option("--alarm-log", a->alarm_log,
                      "where the ticks about an alarm of an inadequate model go, a CSV for `tiller gap` (default: "
                      "<log>.alarm.csv beside the log or the record, else <robot>.alarm.csv in this folder); written "
                      "only if there is one");
  command->add_option("--alarm-seconds", a->alarm_log_s, "length of that file in s (default 20); 0: none")
      ->check(number_between(0, 1000));
  command->add_option("--histogram", a->histogram,
                      "write a CSV of how long ticks took and how late they began: upper_us, ticks, wake_ups");
  const Words known = add_learning_options(*command, *a);
  add_view_options(*command, a->view);
  command->add_flag("--quiet", a->quiet, "no progress");
  add_override_options(*command, a->overrides);
  command->footer(kRunFooter);
  command->callback([a, command, known, &exit_code] {
    a->calibrates = command->count("--calibrate") > 0;
    std::string wrong = misplaced_option(*command, known, a->refit.method, a->refit.how);
    if (wrong.empty()) wrong = contradicted_method(*a);
    if (wrong.empty()) wrong = contradicted_view(a->view);
    exit_code = wrong.empty() ? run_command(*a) : complain(wrong);
  });
}

}  // namespace tiller::tools
