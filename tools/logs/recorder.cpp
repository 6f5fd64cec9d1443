#include "tools/logs/recorder.hpp"

#include <pthread.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "io/realtime.hpp"

namespace tiller::tools {
namespace {

constexpr auto kLook = std::chrono::milliseconds(5);         // between two looks at the ring
constexpr auto kFlush = std::chrono::milliseconds(250);      // what a crash may cost
constexpr auto kWait = std::chrono::microseconds(200);       // lossless, with a full ring
constexpr double kHold_s = 2.0;                              // a disk may be busy that long
constexpr std::size_t kMostPlaces = 8;                       // that a message names
constexpr std::size_t kLeastTicks = 256, kMostTicks = 4096;  // 1 MB .. 16 MB

std::string ending_of(const std::string& path) { return std::filesystem::path(path).extension().string(); }

}  // namespace

std::size_t Recorder::ring_ticks(double period_s) {
  return std::clamp(static_cast<std::size_t>(kHold_s / period_s), kLeastTicks, kMostTicks);
}

Recorder::Recorder(const RobotFile& robot, const RecorderOptions& options)
    : robot_(robot),
      options_(options),
      wanted_(!options.log.empty() || !options.records.empty() || !options.alarm_log.empty()),
      ring_(wanted_ ? ring_ticks(robot.config.period_s) : 1),
      log_(robot, options.has_truth, options.true_params, options.goals),
      alarm_(robot) {
  if (!options.alarm_log.empty()) history_ticks_ = AlarmWindow::ring_ticks(robot, options.alarm_log_s);
}

Recorder::~Recorder() { (void)stop(); }

void Recorder::open(const tiller_config_t& config) {
  if (!options_.log.empty()) log_.open(options_.log);
  for (const std::string& path : options_.records) {
    const std::string ending = ending_of(path);
    if (ending == ".mcap") {
      mcaps_.emplace_back(robot_).open(path, config, options_.epoch_us);
    } else if (ending == ".lcm" || ending == ".lcmlog") {
      lcms_.emplace_back(robot_).open(path, options_.epoch_us);
    } else {
      natives_.emplace_back().file.open(path);
      write_record_header(natives_.back().file, config);
    }
  }
}

void Recorder::start(const tiller_config_t& config) {
  if (!wanted_) return;
  open(config);
  flush();  // the heads are on the disk before the first tick
  // Ctrl-C is the run loop's: it must end a wait there
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this] { serve(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void Recorder::push(const LoggedTick& tick) {
  if (!wanted_) return;
  ++pushed_;
  last_was_dropped_ = false;
  while (!ring_.push(tick)) {
    if (!options_.lossless) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      last_was_dropped_ = true;
      last_dropped_ = tick;
      return;
    }
    std::this_thread::sleep_for(kWait);
  }
}

void Recorder::serve() {
  realtime_leave();  // it may have been started by a real-time thread
  auto next_flush = std::chrono::steady_clock::now() + kFlush;
  while (true) {
    const bool last = ending_.load(std::memory_order_acquire);  // before the look: nothing is pushed after it
    while (const LoggedTick* tick = ring_.front()) {
      take(*tick);
      ring_.pop();
    }
    if (last) return;
    const auto now = std::chrono::steady_clock::now();
    if (now >= next_flush) {
      flush();
      next_flush = now + kFlush;
    }
    std::this_thread::sleep_for(kLook);
  }
}

/// Ticks are numbered, so the next one that arrives tells which were dropped before it.
void Recorder::note_hole(std::uint64_t tick) {
  if (tick > next_tick_) holes_.push_back({LogHole::What::kTicks, next_tick_, tick - 1, 0});
  next_tick_ = tick + 1;
}

/// The last tick is in every log: its number tells a reader that others are missing before it.
void Recorder::take_last() {
  if (!last_was_dropped_) return;
  take(last_dropped_);
  dropped_.fetch_sub(1, std::memory_order_relaxed);
}

void Recorder::take(const LoggedTick& tick) {
  note_hole(tick.entry.record.tick);
  if (!options_.log.empty()) log_.add(tick);
  for (McapRun& mcap : mcaps_) mcap.add(tick.entry);
  for (LcmLog& lcm : lcms_) lcm.add(tick.entry, tick.info, tick.log);
  for (NativeRecord& native : natives_) write_record(native.file, tick.entry);
  if (!options_.alarm_log.empty()) take_alarm(tick);
}

void Recorder::take_alarm(const LoggedTick& tick) {
  if (alarm_.open()) alarm_.add(tick.entry.record);
  history_.push_back(tick.entry.record);
  if (history_.size() > history_ticks_) history_.pop_front();
  if (!tick.alarm) return;
  alarm_.begin(options_.alarm_log, options_.alarm_log_s);
  for (const tiller_record_t& record : history_) alarm_.add(record);
}

void Recorder::flush() {
  log_.flush();
  alarm_.flush();
  for (McapRun& mcap : mcaps_) mcap.flush();
  for (LcmLog& lcm : lcms_) lcm.flush();
  for (NativeRecord& native : natives_) native.file.flush();
  publish();
}

template <class Visit>
void Recorder::each_file(const Visit& visit) const {
  visit(log_.file());
  visit(alarm_.file());
  for (const McapRun& mcap : mcaps_) visit(mcap.writer().file());
  for (const LcmLog& lcm : lcms_) visit(lcm.file());
  for (const NativeRecord& native : natives_) visit(native.file);
}

void Recorder::publish() {
  bool lags = false;
  std::uint64_t waiting = 0, lost = 0;
  each_file([&](const OutputFile& file) {
    lags = lags || file.lags();
    waiting += file.lags() ? file.waiting() : 0;
    lost += file.lost();
  });
  waiting_bytes_.store(waiting, std::memory_order_relaxed);
  lost_bytes_.store(lost, std::memory_order_relaxed);
  lags_.store(lags, std::memory_order_relaxed);
}

LogState Recorder::state() const {
  LogState state;
  state.dropped_ticks = dropped();
  state.waiting_bytes = waiting_bytes_.load(std::memory_order_relaxed);
  state.lost_bytes = lost_bytes_.load(std::memory_order_relaxed);
  if (state.dropped_ticks > 0) state.status = tiller_status_queue_full;
  if (lags_.load(std::memory_order_relaxed) || state.lost_bytes > 0) state.status = tiller_status_io_error;
  return state;
}

void Recorder::close(RecorderReport& report) {
  const auto note = [&](const OutputFile& file, bool complete) {
    report.lost_bytes += file.lost();
    report.disk_refused = report.disk_refused || !file.message().empty();
    report.complete = report.complete && complete;
    if (!file.message().empty()) report.messages.push_back(file.message());
  };
  if (!options_.log.empty()) {
    const bool complete = log_.close();
    note(log_.file(), complete);
  }
  const bool alarm_complete = alarm_.close();
  note(alarm_.file(), alarm_complete);
  for (McapRun& mcap : mcaps_) {
    const bool complete = mcap.close(pushed_, dropped(), holes_);
    report.lost_messages += mcap.writer().lost_messages();
    note(mcap.writer().file(), complete);
  }
  for (LcmLog& lcm : lcms_) {
    const bool complete = lcm.close();
    report.lost_messages += lcm.lost_messages();
    note(lcm.file(), complete);
  }
  for (NativeRecord& native : natives_) {
    const bool complete = native.file.close();
    note(native.file, complete);
  }
  publish();
  report.readable_log = log_.file().readable_path();
  report.alarm_log = alarm_.file().readable_path();
  report.alarm_log_s = alarm_.seconds();
}

RecorderReport Recorder::stop() {
  RecorderReport report;
  if (!thread_.joinable()) return report;
  ending_.store(true, std::memory_order_release);
  thread_.join();
  take_last();
  close(report);
  report.ticks = pushed_;
  report.dropped_ticks = dropped();
  if (report.dropped_ticks > 0) {
    report.complete = false;
    report.holes = holes_;
    report.messages.push_back(
        format("%llu of %llu ticks were not recorded (%s): the disk was busy for longer than %.1f s",
               static_cast<unsigned long long>(report.dropped_ticks), static_cast<unsigned long long>(report.ticks),
               ticks_text(holes_, kMostPlaces).c_str(), kHold_s));
  }
  return report;
}

}  // namespace tiller::tools
