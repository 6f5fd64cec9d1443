#include "tools/run/run_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "abi/controller.hpp"
#include "io/monotonic_clock.hpp"
#include "tiller/config.hpp"
#include "tools/base/exit_codes.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/logs/recorder.hpp"
#include "tools/robot/stage_cost.hpp"
#include "tools/robot/task_clock.hpp"
#include "tools/run/arming.hpp"
#include "tools/run/foresight.hpp"
#include "tools/run/host_controller.hpp"
#include "tools/run/progress.hpp"
#include "tools/run/run_start.hpp"
#include "tools/run/run_summary.hpp"

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class Runner {
 public:
  Runner(const RobotFile& robot, Link& link, const RunOptions& options)
      : robot_(robot),
        config_(robot.config),
        link_(link),
        options_(options),
        realtime_(robot, options.real_time),
        host_(options.threads),
        arming_(link, options.arm_at_once, options.arm_sources),
        recorder_(robot, recorder_options()),
        foresight_(robot.config.planner.horizon, robot.config.model->state_count),
        progress_(robot, Progress::style_for_stdout(options.quiet), options.seconds, options.true_params) {
    for (std::uint32_t j = 0; j < config_.cost.output_count; ++j) output_target_[j] = config_.cost.outputs[j].target;
    if (recorder_.wanted()) config_.record_ticks = std::max(config_.record_ticks, 1u);
    if (options_.keep_rows) result_.rows.begin(robot_, expected_ticks());
  }

  RunResult run() {
    if (!begin()) return result_;
    recorder_.start(config_);
    tell_realtime();
    if (const std::string how = arming_.begin(); !how.empty()) say(how, true);
    while (!is_over()) {
      const auto begin = Clock::now();
      decide_arming();
      tick();
      if (Clock::now() - begin > std::chrono::duration<double>(config_.period_s)) ++result_.pace.overruns;
      if (!is_over()) sensed_ = link_.wait(stop_.flag());
    }
    end();
    return result_;
  }

 private:
  /// Drives that follow, and then commands: one that enables late would meet a command that has moved on.
  void decide_arming() {
    const std::string news = arming_.step(host_.get(), info_);
    if (!news.empty()) announce(format("at %.2f s: ", time_s()) + news, true);
    if (!arming_.begins_task()) return;
    since_us_ = sensed_.now_us;
    next_goal_ = 0;
    if (options_.seconds > 0) progress_.set_end(time_s() + options_.seconds);
  }

  bool knows_truth() {
    double state[TILLER_MAX_STATES];
    return link_.truth(state);
  }

  RecorderOptions recorder_options() {
    RecorderOptions recorder;
    recorder.log = options_.log;
    recorder.records = options_.records;
    recorder.alarm_log = options_.alarm_log;
    recorder.alarm_log_s = options_.alarm_log_s;
    recorder.true_params = options_.true_params;
    recorder.has_truth = knows_truth();
    if (options_.lcm_goals) recorder.goals = kGoalStates | (config_.cost.output_count > 0 ? kGoalOutputs : 0);
    for (const Goal& goal : options_.goals)
      recorder.goals |= (goal.states.empty() ? 0 : kGoalStates) | (goal.outputs.empty() ? 0 : kGoalOutputs);
    recorder.lossless = !options_.real_time;
    if (options_.real_time) recorder.epoch_us = wall_us() - monotonic_us();
    return recorder;
  }

  bool begin() {
    std::string error;
    RunStart start(robot_, link_, stop_, progress_);
    const bool begun = host_.make(robot_, config_, options_.real_time, error) &&
                       start.wait_for_first(options_.first_wait_s, sensed_, error) &&
                       (!options_.await_start || start.wait_for_start(sensed_, error));
    start_us_ = since_us_ = sensed_.now_us;
    if (begun) return true;
    std::fprintf(stderr, "tiller: %s\n", error.c_str());
    result_.exit_code = kExitBadInput;
    result_.interrupted = options_.await_start && stop_.flag() != 0;
    return false;
  }

  bool is_over() const {
    if (stop_.flag() != 0) return true;
    if (static_cast<double>(safe_ticks_) * config_.period_s > kSafeFor_s) return true;
    return options_.seconds > 0 && task_s() >= options_.seconds;
  }

  /// With room to spare, so that no tick waits for memory; an hour of them where the run has no end.
  std::size_t expected_ticks() const {
    const double seconds = options_.seconds > 0 ? 1.5 * options_.seconds : 3600;
    return static_cast<std::size_t>(std::clamp(seconds / config_.period_s + 64, 64.0, 1e6));
  }

  double time_s() const { return 1e-6 * static_cast<double>(sensed_.now_us - start_us_); }
  /// Since the task began: with the first measurement, or when somebody armed.
  double task_s() const { return 1e-6 * static_cast<double>(sensed_.now_us - since_us_); }

  void tick() {
    RecordEntry entry;
    if (sensed_.fault != tiller_status_ok && info_.state != tiller_state_safe) {
      (void)tiller_stop(host_.get(), sensed_.fault);
      entry.stop_status = static_cast<std::uint32_t>(sensed_.fault);
    }
    pursue_goals(entry);
    const auto begin = Clock::now();
    status_ = tiller_tick(host_.get(), sensed_.now_us, sensed_.fresh ? &sensed_.measurement : nullptr, &command_);
    const std::int64_t took_ns = std::chrono::nanoseconds(Clock::now() - begin).count();
    result_.pace.tick_time.add(took_ns);
    tick_us_ = 1e-3 * static_cast<double>(took_ns);
    const double deadline_us = config_.planner.deadline_us;
    if (deadline_us > 0 && tick_us_ > deadline_us) ++result_.late_ticks;
    (void)link_.send(command_);
    for (ArmSource* source : options_.arm_sources) source->note_sent(command_);
    tiller_get_info(host_.get(), &info_);
    note_tick(entry);
    (void)tiller_prepare(host_.get());  // the command is out: what waits for no measurement is done while none is due
  }

  void pursue(const Goal& goal, RecordEntry& entry) {
    if (!goal.states.empty() && tiller_set_target(host_.get(), goal.states.data()) == tiller_status_ok) {
      std::copy(goal.states.begin(), goal.states.end(), config_.cost.target);
      entry.goal |= kGoalStates;
    }
    if (!goal.outputs.empty() && tiller_set_output_target(host_.get(), goal.outputs.data()) == tiller_status_ok) {
      std::copy(goal.outputs.begin(), goal.outputs.end(), output_target_);
      entry.goal |= kGoalOutputs;
    }
  }

  /// Sets the goal that is due, if it is not the one in force.
  void pursue_goals(RecordEntry& entry) {
    const std::vector<Goal>& goals = options_.goals;
    std::size_t due = next_goal_;
    const bool begun = arming_.at_once() || arming_.was_armed();
    while (begun && due < goals.size() && goals[due].time_s <= task_s()) ++due;
    if (due > next_goal_) pursue(goals[due - 1], entry);
    next_goal_ = due;
    Goal told;
    if (options_.lcm_goals && options_.lcm_goals->poll(told)) pursue(told, entry);
    std::copy(config_.cost.target, config_.cost.target + config_.model->state_count, entry.target);
    std::copy(output_target_, output_target_ + config_.cost.output_count, entry.output_target);
  }

  void note_tick(RecordEntry& entry) {
    const LogState log = recorder_.state();
    link_.tell(info_, command_.stamp_us, log);
    safe_ticks_ = info_.state == tiller_state_safe ? safe_ticks_ + 1 : 0;
    if (safe_ticks_ == 1) tell_safe();
    const bool alarm = info_.adequacy == tiller_adequacy_inadequate && !told_inadequate_;
    if (alarm) tell_inadequate();
    tell_log(log);
    if (const std::string news = link_.news(); !news.empty()) announce(news, true);
    const TickView view = look();
    count(view);
    if (options_.keep_rows && sensed_.fresh)
      result_.rows.add(static_cast<int>(info_.ticks), sensed_.measurement, command_);
    hand_over(view, entry, alarm);
    progress_.show(view);
  }

  void hand_over(const TickView& view, const RecordEntry& entry, bool alarm) {
    if (config_.planner.predict_spread != 0) foresight_.look(host_.get(), info_);
    if (!recorder_.wanted()) return;
    logged_.entry = entry;
    if (tiller_get_record(host_.get(), info_.ticks - 1, &logged_.entry.record) != tiller_status_ok) return;
    take_forces(info_, logged_.entry);
    logged_.info = info_;
    logged_.log = log_;
    logged_.time_s = view.time_s;
    logged_.tick_us = view.tick_us;
    logged_.status = view.status;
    logged_.alarm = alarm && !options_.alarm_log.empty();
    logged_.has_truth = view.true_state != nullptr;
    if (config_.cost.outputs) (void)tiller_get_outputs(host_.get(), logged_.outputs);
    logged_.was_foreseen = foresight_.recall(info_, logged_.foreseen_mean, logged_.foreseen_sd);
    take_innovations();
    std::copy(std::begin(q05_), std::end(q05_), logged_.q05);
    std::copy(std::begin(q95_), std::end(q95_), logged_.q95);
    std::copy(std::begin(true_state_), std::end(true_state_), logged_.true_state);
    recorder_.push(logged_);
  }

  /// A tick without a measurement has none, and neither has one that tests nothing.
  void take_innovations() {
    const AdequacyTest* test = sensed_.fresh ? host_.get()->executive->posterior().adequacy() : nullptr;
    for (std::uint32_t k = 0; k < config_.measurement_count; ++k)
      logged_.innovation[k] = test ? test->residual(k) : NAN;
  }

  void count(const TickView& view) {
    if (info_.state == tiller_state_standby) return;
    double x[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i) {
      const bool known = view.true_state && std::isfinite(view.true_state[i]);
      x[i] = known ? view.true_state[i] : info_.state_mean[i];
    }
    const std::uint64_t step = task_.step(info_.ticks - 1, static_cast<tiller_state_t>(info_.state)).value_or(0);
    const double cost = stage_cost(config_, step, x, command_.value, info_.param_mean, output_target_);
    result_.cost += (cost - result_.cost) / static_cast<double>(++costed_);
    if (sensed_.fresh && costed_ > 1) ++result_.transitions;
  }

  void take_particles() {
    const std::uint32_t np = config_.param_count;
    double params[TILLER_MAX_PARAMS], weight = 0.0;
    for (std::uint32_t k = 0; k < config_.posterior.particles; ++k) {
      if (tiller_get_particle(host_.get(), k, params, nullptr, &weight) != tiller_status_ok) return;
      result_.particles.params.insert(result_.particles.params.end(), params, params + np);
      result_.particles.weight.push_back(weight);
    }
  }

  TickView look() {
    TickView view;
    view.time_s = time_s();
    view.measurement = sensed_.fresh ? &sensed_.measurement : nullptr;
    view.command = &command_;
    view.info = &info_;
    view.status = status_;
    view.tick_us = tick_us_;
    view.log_status = log_.status;
    for (std::uint32_t i = 0; i < config_.param_count; ++i) {
      if (config_.priors[i].kind == tiller_prior_fixed) continue;
      (void)tiller_get_quantile(host_.get(), i, 0.05, &q05_[i]);
      (void)tiller_get_quantile(host_.get(), i, 0.95, &q95_[i]);
    }
    view.q05 = q05_;
    view.q95 = q95_;
    view.true_state = link_.truth(true_state_) ? true_state_ : nullptr;
    return view;
  }

  /// A sentence on the screen; one that must not be missed goes to stderr where the screen is silent.
  void say(const std::string& text, bool must) {
    if (must && options_.quiet) std::fprintf(stderr, "tiller: %s\n", text.c_str());
    progress_.say(text);
  }

  /// The same, below the last tick.
  void announce(const std::string& text, bool must) {
    progress_.finish(look());
    say(text, must);
  }

  void tell_safe() {
    const auto why = static_cast<tiller_status_t>(info_.first_fault);
    announce("SAFE at " + format("%.2f s", time_s()) + ": " + tiller_status_name(why) + ": " + tiller_status_text(why) +
                 "; the safe command is being sent",
             true);
  }

  /// Which file, and why, the recorder tells; here, that the run goes on, and when it is over.
  void tell_log(const LogState& log) {
    const bool changed = log.status != log_.status;
    log_ = log;
    if (changed) announce(format("at %.2f s: ", time_s()) + log_news(log), true);
  }

  void tell_realtime() {
    const std::string text = realtime_text(robot_, realtime_.report());
    if (text.empty()) return;
    progress_.say(text);
    if (options_.quiet && !realtime_.report().complete()) std::fprintf(stderr, "tiller: %s\n", text.c_str());
  }

  void tell_inadequate() {
    told_inadequate_ = true;
    result_.inadequate_at_s = time_s();
    std::string text = format("at %.2f s: ", time_s()) + inadequacy(robot_, info_);
    if (!options_.alarm_log.empty())
      text += format("\nthe %g s about it go to ", options_.alarm_log_s) + options_.alarm_log;
    announce(text, false);
  }

  /// The safe command goes out more than once: a datagram may be lost.
  void end() {
    const bool safe = info_.state == tiller_state_safe;
    if (!safe) (void)tiller_disarm(host_.get());
    link_.prepare(false);
    progress_.finish(look());
    if (!arming_.was_armed() && !arming_.at_once()) say("never armed: nothing was moved", true);
    tiller_command_t last{};
    for (int i = 0; i < 3; ++i) {
      (void)tiller_tick(host_.get(), sensed_.now_us, nullptr, &last);
      (void)link_.send(last);
    }
    close_files();
    fill_result(safe);
  }

  void close_files() {
    const RecorderReport report = recorder_.stop();
    for (const std::string& message : report.messages) std::fprintf(stderr, "tiller: %s\n", message.c_str());
    result_.readable_log = report.readable_log;
    result_.alarm_log = report.alarm_log;
    result_.alarm_log_s = report.alarm_log_s;
    result_.log = recorder_.state();
    if (!report.complete) result_.exit_code = kExitLogIncomplete;
  }

  void fill_result(bool safe) {
    if (safe) result_.exit_code = kExitSafe;
    take_particles();
    result_.interrupted = stop_.flag() != 0;
    result_.ticks = info_.ticks;
    result_.time_s = time_s();
    result_.info = info_;
    result_.contraction_ratio.resize(TILLER_MAX_PARAMS);
    result_.contraction_direction.resize(TILLER_MAX_PARAMS * std::size_t{TILLER_MAX_PARAMS});
    std::uint32_t d = 0;
    (void)tiller_get_contraction(host_.get(), &d, result_.contraction_ratio.data(),
                                 result_.contraction_direction.data());
    result_.contraction_ratio.resize(d);
    result_.q05.assign(q05_, q05_ + config_.param_count);
    result_.q95.assign(q95_, q95_ + config_.param_count);
    if (link_.truth(true_state_)) result_.last_true_state.assign(true_state_, true_state_ + config_.model->state_count);
    result_.pace.realtime = realtime_.report();
    const PeriodicTimer* timer = link_.timer();
    if (!timer) return;
    result_.pace.wake_up = timer->lateness();
    result_.pace.skipped_periods = timer->skipped();
  }

  static constexpr double kSafeFor_s = 0.5;  // the safe command is repeated that long before the run ends

  const RobotFile& robot_;
  Config config_;
  Link& link_;
  const RunOptions& options_;
  StopFlag stop_;
  RealtimeGuard realtime_;  // before the threads that a tick uses
  HostController host_;
  Arming arming_;
  Recorder recorder_;
  LoggedTick logged_;
  Foresight foresight_;
  Progress progress_;
  Sensed sensed_;
  tiller_command_t command_{};
  tiller_info_t info_{};
  tiller_status_t status_ = tiller_status_ok;
  LogState log_;
  std::int64_t start_us_ = 0, since_us_ = 0;
  std::uint64_t safe_ticks_ = 0;
  bool told_inadequate_ = false;
  std::uint64_t costed_ = 0;
  std::size_t next_goal_ = 0;
  double output_target_[TILLER_MAX_OUTPUTS] = {};  // in force
  TaskClock task_;
  double q05_[TILLER_MAX_PARAMS] = {};
  double q95_[TILLER_MAX_PARAMS] = {};
  double true_state_[TILLER_MAX_STATES] = {};
  double tick_us_ = 0;
  RunResult result_;
};

}  // namespace

RunResult run_robot(const RobotFile& robot, Link& link, const RunOptions& options) {
  return Runner(robot, link, options).run();
}

}  // namespace tiller::tools
