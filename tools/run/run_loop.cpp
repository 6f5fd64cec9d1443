#include "tools/run/run_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "tools/base/exit_codes.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/robot/calibration.hpp"
#include "tools/run/arming.hpp"
#include "tools/run/calibration.hpp"
#include "tools/run/host_controller.hpp"
#include "tools/run/progress.hpp"
#include "tools/run/run_clock.hpp"
#include "tools/run/run_files.hpp"
#include "tools/run/run_start.hpp"
#include "tools/run/run_summary.hpp"
#include "tools/run/run_task.hpp"

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;

/// With room to spare, so that no tick waits for memory; an hour of them where the run has no end.
std::size_t expected_ticks(double period_s, double seconds) {
  return static_cast<std::size_t>(std::clamp((seconds > 0 ? 1.5 * seconds : 3600) / period_s + 64, 64.0, 1e6));
}

std::string safe_text(const LoggedTick& tick) {
  const auto why = static_cast<tiller_status_t>(tick.info.first_fault);
  return "SAFE at " + format("%.2f s", tick.time_s) + ": " + tiller_status_name(why) + ": " + tiller_status_text(why) +
         "; the safe command is being sent";
}

/// The particles and where the data have contracted them.
void take_posterior(const tiller_t* controller, const tiller_config_t& config, RunResult& result) {
  result.contraction_ratio.resize(TILLER_MAX_PARAMS);
  result.contraction_direction.resize(TILLER_MAX_PARAMS * std::size_t{TILLER_MAX_PARAMS});
  std::uint32_t d = 0;
  (void)tiller_get_contraction(controller, &d, result.contraction_ratio.data(), result.contraction_direction.data());
  result.contraction_ratio.resize(d);
  double params[TILLER_MAX_PARAMS], weight = 0.0;
  for (std::uint32_t k = 0; k < config.posterior.particles; ++k) {
    if (tiller_get_particle(controller, k, params, nullptr, &weight) != tiller_status_ok) return;
    result.particles.params.insert(result.particles.params.end(), params, params + config.param_count);
    result.particles.weight.push_back(weight);
  }
}

class Runner {
 public:
  Runner(const RobotFile& robot, Link& link, const RunOptions& options)
      : robot_(robot),
        link_(link),
        options_(options),
        config_(robot.config),
        host_(robot, options.real_time, options.threads),
        arming_(link, options.arm_at_once, options.arm_sources),
        task_(config_, options),
        files_(robot, options, link.truth(tick_.true_state), task_.goal_kinds()),
        progress_(robot, Progress::style_for_stdout(options.quiet), options.seconds, options.files.true_params),
        calibration_(robot),
        clock_(config_.period_s, options.seconds) {
    if (files_.wanted()) config_.record_ticks = std::max(config_.record_ticks, 1u);
    if (options.keep_rows) result_.rows.begin(robot, expected_ticks(config_.period_s, options.seconds));
  }

  RunResult run() {
    Sensed sensed;
    if (!begin(sensed)) return result_;
    files_.start(config_);
    if (const std::string text = realtime_text(robot_, host_.realtime()); !text.empty())
      progress_.say(text, !host_.realtime().complete());
    if (const std::string how = arming_.begin(); !how.empty()) progress_.say(how, true);
    while (!is_over()) {
      const auto begin = Clock::now();
      decide_arming();
      tick(sensed);
      if (Clock::now() - begin > std::chrono::duration<double>(config_.period_s)) ++result_.pace.overruns;
      if (is_over()) break;
      sensed = link_.wait(stop_.flag());
      clock_.set(sensed.now_us);
    }
    end();
    return result_;
  }

 private:
  bool begin(Sensed& sensed) {
    std::string error;
    RunStart start(robot_, link_, stop_, progress_);
    const bool ready = host_.make(config_, error) && calibrate(error);
    const bool begun = ready && start.wait_for_first(options_.first_wait_s, sensed, error) &&
                       (!options_.await_start || start.wait_for_start(sensed, error));
    clock_.start(sensed.now_us);
    if (begun) return true;
    std::fprintf(stderr, "tiller: %s\n", error.c_str());
    result_.exit_code = kExitBadInput;
    result_.interrupted = options_.await_start && stop_.flag() != 0;
    return false;
  }

  bool calibrate(std::string& error) {
    if (!options_.calibrate) return true;
    const tiller_status_t status = start_calibration(robot_, calibration_periods(robot_), host_.get());
    if (status != tiller_status_ok) error = robot_.path + ": --calibrate: " + tiller_status_text(status);
    return status == tiller_status_ok;
  }

  bool is_over() const { return stop_.flag() != 0 || clock_.is_over(); }

  /// Drives that follow, and then commands: one that enables late would meet a command that has moved on.
  void decide_arming() {
    const std::string news = arming_.step(host_.get(), tick_.info);
    if (!news.empty()) announce(format("at %.2f s: ", clock_.time_s()) + news, true);
    if (!arming_.begins_task()) return;
    clock_.begin_task();
    task_.begin();
    if (options_.seconds > 0) progress_.set_end(clock_.time_s() + options_.seconds);
  }

  void tick(const Sensed& sensed) {
    RecordEntry& entry = tick_.entry;
    entry.stop_status = entry.goal = 0;
    if (sensed.fault != tiller_status_ok && tick_.info.state != tiller_state_safe) {
      (void)tiller_stop(host_.get(), sensed.fault);
      entry.stop_status = static_cast<std::uint32_t>(sensed.fault);
    }
    task_.pursue(host_.get(), arming_.at_once() || arming_.was_armed(), clock_.task_s(), entry);
    tiller_record_t& record = entry.record;
    record.measurement = sensed.measurement;
    record.has_measurement = sensed.fresh;
    const auto begin = Clock::now();
    tick_.status =
        tiller_tick(host_.get(), sensed.now_us, sensed.fresh ? &record.measurement : nullptr, &record.command);
    const std::int64_t took_ns = std::chrono::nanoseconds(Clock::now() - begin).count();
    result_.pace.tick_time.add(took_ns);
    tick_.tick_us = 1e-3 * static_cast<double>(took_ns);
    const double deadline_us = config_.planner.deadline_us;
    if (deadline_us > 0 && tick_.tick_us > deadline_us) ++result_.late_ticks;
    (void)link_.send(record.command);
    for (ArmSource* source : options_.arm_sources) source->note_sent(record.command);
    tiller_get_info(host_.get(), &tick_.info);
    note_tick();
    (void)tiller_prepare(host_.get());  // the command is out: what waits for no measurement is done while none is due
  }

  void note_tick() {
    const LogState log = files_.state();
    const tiller_record_t& record = tick_.entry.record;
    link_.tell(tick_.info, record.command.stamp_us, log);
    look();
    clock_.note(tick_.info.state);
    if (clock_.is_first_safe_tick()) announce(safe_text(tick_), true);
    tick_.alarm = tick_.info.adequacy == tiller_adequacy_inadequate && result_.inadequate_at_s < 0;
    if (tick_.alarm) tell_inadequate();
    if (const std::string news = calibration_.of(tick_.info); !news.empty())
      announce(format("at %.2f s: ", clock_.time_s()) + news, false);
    tell_log(log);
    if (const std::string news = link_.news(); !news.empty()) announce(news, true);
    task_.count(tick_);
    if (options_.keep_rows && record.has_measurement != 0)
      result_.rows.add(static_cast<int>(tick_.info.ticks), record.measurement, record.command);
    files_.take(host_.get(), tick_);
    if (options_.watch) options_.watch(host_.get(), tick_);
    progress_.show(tick_);
  }

  /// Where the parameters lie, and the truth.
  void look() {
    tick_.time_s = clock_.time_s();
    for (std::uint32_t i = 0; i < config_.param_count; ++i) {
      if (config_.priors[i].kind == tiller_prior_fixed) continue;
      (void)tiller_get_quantile(host_.get(), i, 0.05, &tick_.q05[i]);
      (void)tiller_get_quantile(host_.get(), i, 0.95, &tick_.q95[i]);
    }
    tick_.has_truth = link_.truth(tick_.true_state);
  }

  /// A sentence below the last tick.
  void announce(const std::string& text, bool must) {
    look();
    progress_.finish(tick_);
    progress_.say(text, must);
  }

  /// Which file, and why, the recorder tells; here, that the run goes on, and when it is over.
  void tell_log(const LogState& log) {
    const bool changed = log.status != tick_.log.status;
    tick_.log = log;
    if (changed) announce(format("at %.2f s: ", tick_.time_s) + log_news(log), true);
  }

  void tell_inadequate() {
    result_.inadequate_at_s = tick_.time_s;
    std::string text = format("at %.2f s: ", tick_.time_s) + inadequacy(robot_, tick_.info);
    if (!options_.files.alarm_log.empty())
      text += format("\nthe %g s about it go to ", options_.files.alarm_log_s) + options_.files.alarm_log;
    announce(text, false);
  }

  /// The safe command goes out more than once: a datagram may be lost.
  void end() {
    const bool safe = tick_.info.state == tiller_state_safe;
    if (!safe) (void)tiller_disarm(host_.get());
    link_.prepare(false);
    look();
    progress_.finish(tick_);
    if (!arming_.was_armed() && !arming_.at_once()) progress_.say("never armed: nothing was moved", true);
    tiller_command_t last{};
    for (int i = 0; i < 3; ++i) {
      (void)tiller_tick(host_.get(), clock_.now_us(), nullptr, &last);
      (void)link_.send(last);
    }
    files_.close(result_);
    if (safe) result_.exit_code = kExitSafe;
    fill_result();
  }

  void fill_result() {
    result_.cost = task_.mean_cost();
    result_.transitions = task_.transitions();
    take_posterior(host_.get(), config_, result_);
    result_.interrupted = stop_.flag() != 0;
    result_.ticks = tick_.info.ticks;
    result_.time_s = tick_.time_s;
    result_.info = tick_.info;
    result_.q05.assign(tick_.q05, tick_.q05 + config_.param_count);
    result_.q95.assign(tick_.q95, tick_.q95 + config_.param_count);
    if (tick_.has_truth)
      result_.last_true_state.assign(tick_.true_state, tick_.true_state + config_.model->state_count);
    result_.pace.realtime = host_.realtime();
    const PeriodicTimer* timer = link_.timer();
    if (!timer) return;
    result_.pace.wake_up = timer->lateness();
    result_.pace.skipped_periods = timer->skipped();
  }

  const RobotFile& robot_;
  Link& link_;
  const RunOptions& options_;
  Config config_;
  StopFlag stop_;
  HostController host_;
  Arming arming_;
  RunTask task_;
  LoggedTick tick_;
  RunFiles files_;
  Progress progress_;
  CalibrationNews calibration_;
  RunClock clock_;
  RunResult result_;
};

}  // namespace

RunResult run_robot(const RobotFile& robot, Link& link, const RunOptions& options) {
  return Runner(robot, link, options).run();
}

}  // namespace tiller::tools
