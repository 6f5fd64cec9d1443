#include "tools/run_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "io/monotonic_clock.hpp"
#include "tools/exit_codes.hpp"
#include "tools/progress.hpp"
#include "tools/recorder/recorder.hpp"
#include "tools/thread_pool.hpp"

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

volatile std::sig_atomic_t stop_requested = 0;

void on_signal(int signal) {
  if (stop_requested != 0) std::signal(signal, SIG_DFL);  // asked twice: the next one ends the process
  stop_requested = 1;
}

std::int64_t now_ns(void*) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

void parallel_for(void* pool, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  static_cast<ThreadPool*>(pool)->run(n, work, arg);
}

struct FreeBlock {
  void operator()(void* block) const { std::free(block); }
};

using Block = std::unique_ptr<void, FreeBlock>;

const char* feature_text(tiller_feature_t feature) {
  switch (feature) {
    case tiller_feature_bias: return "nothing: it is a constant";
    case tiller_feature_velocity: return "the velocity";
    case tiller_feature_velocity_sign: return "the direction of motion";
    case tiller_feature_input: return "the input";
    case tiller_feature_input_change: return "the input's change";
    case tiller_feature_previous: return "what it left before";
    case tiller_feature_size: return "nothing, but it is larger than the noise";
    default: return "nothing";
  }
}

class Runner {
 public:
  Runner(const RobotFile& robot, Link& link, const RunOptions& options)
      : robot_(robot),
        config_(robot.config),
        link_(link),
        options_(options),
        realtime_(robot, options.real_time),
        pool_(options.threads),
        recorder_(robot, recorder_options()),
        progress_(robot, Progress::style_for_stdout(options.quiet), options.seconds, options.true_params) {
    if (recorder_.wanted()) config_.record_ticks = std::max(config_.record_ticks, 1u);
  }

  RunResult run() {
    if (!init()) return result_;
    if (!wait_for_first()) return result_;
    if (options_.await_start && !wait_for_start()) return result_;
    recorder_.start(config_);
    tell_realtime();
    link_.prepare();
    bool armed = false;
    while (!is_over()) {
      const auto begin = Clock::now();
      // drives that follow, and then commands: one that enables late would meet a command that has moved on
      if (!armed && link_.is_ready()) armed = tiller_arm(controller_) == tiller_status_ok;
      tick();
      if (Clock::now() - begin > std::chrono::duration<double>(config_.period_s)) ++result_.pace.overruns;
      if (!is_over()) sensed_ = link_.wait(stop_.flag());
    }
    end();
    return result_;
  }

 private:
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
    recorder.lossless = !options_.real_time;
    if (options_.real_time) recorder.epoch_us = wall_us() - monotonic_us();
    return recorder;
  }

  bool fail(const std::string& text) {
    std::fprintf(stderr, "tiller: %s\n", text.c_str());
    result_.exit_code = kExitBadInput;
    return false;
  }

  bool init() {
    const std::size_t size = tiller_size(&config_);
    hooks_.size = sizeof hooks_;
    hooks_.version = TILLER_CONFIG_VERSION;
    hooks_.context = &pool_;
    hooks_.now_ns = now_ns;
    hooks_.parallel_for = pool_.size() > 1 ? parallel_for : nullptr;
    Block spare;
    tiller_t* rehearsal = nullptr;
    if (!make_controller(size, spare, rehearsal) || !make_controller(size, block_, controller_)) return false;
    rehearse(rehearsal);
    return true;
  }

  bool make_controller(std::size_t size, Block& block, tiller_t*& controller) {
    constexpr std::size_t alignment = TILLER_ALIGNMENT;
    if (size > 0) block.reset(std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment));
    if (!block) {
      const char* field = "";
      const tiller_status_t status = tiller_config_check(&config_, &field);
      return fail(robot_.path + ": " + (field ? field : "") + ": " + tiller_status_text(status));
    }
    const tiller_status_t status = tiller_init(&controller, &config_, &hooks_, block.get(), size);
    if (options_.real_time) touch_pages(block.get(), size);
    return status == tiller_status_ok || fail(robot_.path + ": " + tiller_status_text(status));
  }

  /// A few ticks of a controller of its own, so that code, lanes and threads are warm when the robot's first tick
  /// comes: cold, it takes six times as long on a desk machine, and seconds where the processor is emulated.
  void rehearse(tiller_t* rehearsal) const {
    tiller_measurement_t m{};
    tiller_command_t command;
    for (std::uint32_t i = 0; i < config_.measurement_count; ++i) {
      m.value[i] = config_.initial_state[config_.measured_state[i]];
    }
    (void)tiller_arm(rehearsal);
    for (std::uint32_t tick = 1; tick <= 3; ++tick) {
      m.sequence = tick;
      m.stamp_us = static_cast<std::int64_t>(1e6 * config_.period_s * tick);
      (void)tiller_tick(rehearsal, m.stamp_us, &m, &command);
      (void)tiller_prepare(rehearsal);
    }
  }

  bool wait_for_first() {
    const auto until = Clock::now() + std::chrono::duration<double>(options_.first_wait_s);
    const auto tell = Clock::now() + std::chrono::seconds(1);
    bool told = false;
    do {
      sensed_ = link_.wait(stop_.flag());
      if (sensed_.fresh) {
        start_us_ = sensed_.now_us;
        return true;
      }
      if (!told && Clock::now() > tell) progress_.say("waiting for the first measurement ...");
      told = told || Clock::now() > tell;
    } while (stop_.flag() == 0 && Clock::now() < until);
    if (stop_.flag() != 0) return fail("interrupted before the first measurement");
    const std::string counted = link_.counters();
    const std::string why =
        sensed_.fault == tiller_status_ok ? "" : std::string(tiller_status_text(sensed_.fault)) + "; ";
    return fail(why + format("no measurement within %.0f s", options_.first_wait_s) +
                (counted.empty() ? "" : " (" + counted + ")") + "; start the robot first, e.g. `tiller sim " +
                robot_.path + " --serve lcm`, and compare [transport]");
  }

  bool stands_at_start() const {
    for (std::uint32_t i = 0; i < config_.measurement_count; ++i) {
      const std::uint32_t state = config_.measured_state[i];
      double off = sensed_.measurement.value[i] - config_.initial_state[state];
      if (config_.model->angle_mask >> state & 1u) off = std::remainder(off, 2 * M_PI);
      if (!(std::fabs(off) <= 4 * std::hypot(config_.initial_state_sd[state], config_.measurement_sd[i]))) return false;
    }
    return true;
  }

  /// For as long as it takes. The controller is not asked: it would learn from whoever moves the robot.
  bool wait_for_start() {
    tiller_command_t safe{};
    safe.state = tiller_state_standby;
    std::copy(std::begin(config_.safety.safe_command), std::end(config_.safety.safe_command), safe.value);
    std::int64_t since_us = -1;
    bool told = false;
    while (stop_.flag() == 0) {
      if (sensed_.fault != tiller_status_ok)
        return fail("waiting for the start: " + std::string(tiller_status_text(sensed_.fault)));
      if (sensed_.fresh) {
        if (!stands_at_start())
          since_us = -1;
        else if (since_us < 0)
          since_us = sensed_.now_us;
        if (since_us >= 0 && 1e-6 * static_cast<double>(sensed_.now_us - since_us) >= kStandsFor_s) {
          start_us_ = sensed_.now_us;
          return true;
        }
        if (since_us < 0 && !told) progress_.say("put the robot back to its start ([start] of the robot file) ...");
        told = told || since_us < 0;
      }
      safe.stamp_us = sensed_.now_us;
      safe.sequence = sensed_.measurement.sequence;
      (void)link_.send(safe);
      sensed_ = link_.wait(stop_.flag());
    }
    result_.interrupted = true;
    return fail("interrupted before the robot was back at its start");
  }

  bool is_over() const {
    if (stop_.flag() != 0) return true;
    if (static_cast<double>(safe_ticks_) * config_.period_s > kSafeFor_s) return true;
    return options_.seconds > 0 && time_s() >= options_.seconds;
  }

  double time_s() const { return 1e-6 * static_cast<double>(sensed_.now_us - start_us_); }

  void tick() {
    RecordEntry entry;
    if (sensed_.fault != tiller_status_ok && info_.state != tiller_state_safe) {
      (void)tiller_stop(controller_, sensed_.fault);
      entry.stop_status = static_cast<std::uint32_t>(sensed_.fault);
    }
    const auto begin = Clock::now();
    status_ = tiller_tick(controller_, sensed_.now_us, sensed_.fresh ? &sensed_.measurement : nullptr, &command_);
    const std::int64_t took_ns = std::chrono::nanoseconds(Clock::now() - begin).count();
    result_.pace.tick_time.add(took_ns);
    tick_us_ = 1e-3 * static_cast<double>(took_ns);
    const double deadline_us = config_.planner.deadline_us;
    if (deadline_us > 0 && tick_us_ > deadline_us) ++result_.late_ticks;
    (void)link_.send(command_);
    tiller_get_info(controller_, &info_);
    note_tick(entry);
    (void)tiller_prepare(controller_);  // the command is out: what waits for no measurement is done while none is due
  }

  void note_tick(RecordEntry& entry) {
    link_.tell(info_, command_.stamp_us);
    safe_ticks_ = info_.state == tiller_state_safe ? safe_ticks_ + 1 : 0;
    if (safe_ticks_ == 1) tell_safe();
    const bool alarm = info_.adequacy == tiller_adequacy_inadequate && !told_inadequate_;
    if (alarm) tell_inadequate();
    const TickView view = look();
    count(view);
    hand_over(view, entry, alarm);
    progress_.show(view);
  }

  void hand_over(const TickView& view, const RecordEntry& entry, bool alarm) {
    if (!recorder_.wanted()) return;
    logged_.entry = entry;
    if (tiller_get_record(controller_, info_.ticks - 1, &logged_.entry.record) != tiller_status_ok) return;
    logged_.info = info_;
    logged_.time_s = view.time_s;
    logged_.tick_us = view.tick_us;
    logged_.status = view.status;
    logged_.alarm = alarm && !options_.alarm_log.empty();
    logged_.has_truth = view.true_state != nullptr;
    std::copy(std::begin(q05_), std::end(q05_), logged_.q05);
    std::copy(std::begin(q95_), std::end(q95_), logged_.q95);
    std::copy(std::begin(true_state_), std::end(true_state_), logged_.true_state);
    recorder_.push(logged_);
  }

  void count(const TickView& view) {
    double x[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i) {
      const bool known = view.true_state && std::isfinite(view.true_state[i]);
      x[i] = known ? view.true_state[i] : info_.state_mean[i];
    }
    const double cost = stage_cost(config_, costed_, x, command_.value);
    result_.cost += (cost - result_.cost) / static_cast<double>(++costed_);
    if (sensed_.fresh && costed_ > 1) ++result_.transitions;
  }

  void take_particles() {
    const std::uint32_t np = config_.param_count;
    double params[TILLER_MAX_PARAMS], weight = 0.0;
    for (std::uint32_t k = 0; k < config_.posterior.particles; ++k) {
      if (tiller_get_particle(controller_, k, params, nullptr, &weight) != tiller_status_ok) return;
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
    for (std::uint32_t i = 0; i < config_.param_count; ++i) {
      if (config_.priors[i].kind == tiller_prior_fixed) continue;
      (void)tiller_get_quantile(controller_, i, 0.05, &q05_[i]);
      (void)tiller_get_quantile(controller_, i, 0.95, &q95_[i]);
    }
    view.q05 = q05_;
    view.q95 = q95_;
    view.true_state = link_.truth(true_state_) ? true_state_ : nullptr;
    return view;
  }

  void tell_safe() {
    const auto why = static_cast<tiller_status_t>(info_.first_fault);
    progress_.finish(look());
    const std::string text = "SAFE at " + format("%.2f s", time_s()) + ": " + tiller_status_name(why) + ": " +
                             tiller_status_text(why) + "; the safe command is being sent";
    if (options_.quiet) std::fprintf(stderr, "tiller: %s\n", text.c_str());
    progress_.say(text);
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
    progress_.finish(look());
    std::string text = format("at %.2f s: ", time_s()) + inadequacy(robot_, info_);
    if (!options_.alarm_log.empty())
      text += format("\nthe %g s about it go to ", options_.alarm_log_s) + options_.alarm_log;
    progress_.say(text);
  }

  /// The safe command goes out more than once: a datagram may be lost.
  void end() {
    const bool safe = info_.state == tiller_state_safe;
    if (!safe) (void)tiller_disarm(controller_);
    progress_.finish(look());
    tiller_command_t last{};
    for (int i = 0; i < 3; ++i) {
      (void)tiller_tick(controller_, sensed_.now_us, nullptr, &last);
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
    result_.dropped_ticks = report.dropped_ticks;
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
    (void)tiller_get_contraction(controller_, &d, result_.contraction_ratio.data(),
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
  static constexpr double kStandsFor_s = 0.5;

  const RobotFile& robot_;
  tiller_config_t config_;
  Link& link_;
  const RunOptions& options_;
  StopFlag stop_;
  RealtimeGuard realtime_;  // before the threads that a tick uses
  ThreadPool pool_;
  Recorder recorder_;
  LoggedTick logged_;
  Progress progress_;
  tiller_hooks_t hooks_{};
  Block block_;
  tiller_t* controller_ = nullptr;
  Sensed sensed_;
  tiller_command_t command_{};
  tiller_info_t info_{};
  tiller_status_t status_ = tiller_status_ok;
  std::int64_t start_us_ = 0;
  std::uint64_t safe_ticks_ = 0;
  bool told_inadequate_ = false;
  std::uint64_t costed_ = 0;
  double q05_[TILLER_MAX_PARAMS] = {};
  double q95_[TILLER_MAX_PARAMS] = {};
  double true_state_[TILLER_MAX_STATES] = {};
  double tick_us_ = 0;
  RunResult result_;
};

}  // namespace

StopFlag::StopFlag() {
  stop_requested = 0;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const auto before = std::signal(signal, on_signal);
    if (signal == SIGHUP && before == SIG_IGN) std::signal(signal, SIG_IGN);  // nohup: meant to outlive the terminal
  }
  // a reader of the progress that goes away (`| head`) must not end the process between two commands
  std::signal(SIGPIPE, SIG_IGN);
}
StopFlag::~StopFlag() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, SIG_DFL);
}
const volatile std::sig_atomic_t& StopFlag::flag() const { return stop_requested; }

RunResult run_robot(const RobotFile& robot, Link& link, const RunOptions& options) {
  return Runner(robot, link, options).run();
}

std::string inadequacy(const RobotFile& robot, const tiller_info_t& info) {
  const auto feature = static_cast<tiller_feature_t>(info.inadequate_feature);
  return "the model does not explain " + robot.measurements[info.inadequate_channel] + ": what it leaves goes with " +
         feature_text(feature) + " (" + tiller_feature_name(feature) + "; docs/adequacy.md tells what to do)";
}

/// Directions of which the data say next to nothing: those that keep more than half of the prior's deviation.
static std::string not_learnt(const RobotFile& robot, const RunResult& result) {
  constexpr double kKept = 0.25;   // of the prior's variance
  constexpr double kNamed = 0.25;  // smaller entries of a direction are left out
  const std::size_t np = robot.params.size();
  std::string text;
  if (!robot.config.posterior.enabled) return text;
  for (std::size_t i = 0; i < result.contraction_ratio.size(); ++i) {
    if (result.contraction_ratio[i] < kKept) break;
    text += format("  not learnt: %.0f %% of the prior's deviation left along",
                   100 * std::sqrt(result.contraction_ratio[i]));
    for (std::size_t p = 0; p < np; ++p) {
      const double entry = result.contraction_direction[i * np + p];
      if (std::fabs(entry) < kNamed) continue;
      text += format(" %+.2f ", entry) + robot.params[p];
    }
    text += "\n";
  }
  return text;
}

double stage_cost(const tiller_config_t& config, std::uint64_t step, const double* x, const double* u) {
  const tiller_cost_config_t& cost = config.cost;
  const std::uint32_t nx = config.model->state_count;
  const double* target = cost.target;
  if (cost.reference)
    target = cost.reference + nx * std::min<std::uint64_t>(step, cost.reference_steps - std::uint64_t{1});
  double sum = 0.0;
  for (std::uint32_t i = 0; i < nx; ++i) {
    double off = x[i] - target[i];
    if (config.model->angle_mask >> i & 1u) off = std::remainder(off, 2 * M_PI);
    sum += cost.state_weight[i] * off * off;
  }
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) sum += cost.input_weight[i] * u[i] * u[i];
  return sum;
}

std::string summary(const RobotFile& robot, const RunOptions& options, const RunResult& result) {
  std::string text = format(
      "%.2f s, %llu ticks, ended in %s%s\n", result.time_s, static_cast<unsigned long long>(result.ticks),
      tiller_state_name(static_cast<tiller_state_t>(result.info.state)), result.interrupted ? " (interrupted)" : "");
  for (std::size_t i = 0; i < robot.params.size(); ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    text += format("  %-24s %.4g +- %.2g   90 %% in [%.4g, %.4g]", robot.params[i].c_str(), result.info.param_mean[i],
                   result.info.param_sd[i], result.q05[i], result.q95[i]);
    if (i < options.true_params.size() && std::isfinite(options.true_params[i])) {
      text += format("   true %.4g", options.true_params[i]);
    }
    text += "\n";
  }
  text += not_learnt(robot, result);
  if (result.info.adequacy == tiller_adequacy_inadequate) text += "  " + inadequacy(robot, result.info) + "\n";
  const PaceResult& pace = result.pace;
  text += format("  tick %.2f ms median, %.2f ms 99 %%, %.2f ms max", pace.tick_time.quantile_us(0.5) / 1000,
                 pace.tick_time.quantile_us(0.99) / 1000, pace.tick_time.most_us() / 1000);
  if (robot.config.planner.deadline_us > 0) {
    text += format("; %llu over the deadline of %.1f ms", static_cast<unsigned long long>(result.late_ticks),
                   robot.config.planner.deadline_us / 1000.0);
  }
  text += "\n";
  if (!options.real_time) return text;
  if (pace.wake_up.count() > 0)
    text += format("  wake-up %.0f us late in the median, %.0f us 99 %%, %.0f us max; %llu periods skipped\n",
                   pace.wake_up.quantile_us(0.5), pace.wake_up.quantile_us(0.99), pace.wake_up.most_us(),
                   static_cast<unsigned long long>(pace.skipped_periods));
  text += format("  %llu ticks took longer than the period\n", static_cast<unsigned long long>(pace.overruns));
  const std::string realtime = realtime_text(robot, pace.realtime);
  return realtime.empty() ? text : text + "  " + realtime + "\n";
}

}  // namespace tiller::tools
