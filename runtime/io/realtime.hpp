#pragma once

#include <cstddef>
#include <cstdint>

#include "io/latency_histogram.hpp"

namespace tiller {

/// Real-time settings that a control loop asks of Linux. Every part is optional and works, or
/// fails, by itself: realtime_begin() tells what it got.
struct RealtimeOptions {
  int priority = 0;             ///< 1..99: SCHED_FIFO with it; 0: the scheduler is left alone
  bool lock_memory = false;     ///< mlockall: no page of the process is ever fetched again
  std::uint64_t cpus = 0;       ///< bit i: the thread may run on processor i; 0: on any
  std::size_t stack_bytes = 0;  ///< of the calling thread's stack, touched beforehand; at most kMostStack
  static constexpr std::size_t kMostStack = std::size_t{4} << 20;
};

enum class RealtimePart { priority, memory, cpus, stack };
constexpr int kRealtimeParts = 4;

/// One part of it: asked for, given, and if not, why and what would help.
struct RealtimeOutcome {
  bool asked = false;
  bool given = false;
  int error = 0;            ///< errno
  const char* remedy = "";  ///< a literal; empty where it was given
};

struct RealtimeReport {
  RealtimeOutcome part[kRealtimeParts];
  const RealtimeOutcome& operator[](RealtimePart which) const { return part[static_cast<int>(which)]; }
  bool complete() const {
    for (const RealtimeOutcome& p : part)
      if (p.asked && !p.given) return false;
    return true;
  }
};
/// "priority", "memory", "processors", "stack".
const char* realtime_part_name(RealtimePart part);

/// Applies the options to the calling thread (memory: to the process). Threads that it starts later have its priority
/// and processors; make those that must not have them before. Undone by realtime_end(), or with the process.
RealtimeReport realtime_begin(const RealtimeOptions& options);
/// Back to the ordinary scheduler, any processor, pages as they come.
void realtime_end(const RealtimeReport& report);
/// The calling thread alone goes back to the ordinary scheduler and to any processor: for one that was started by a
/// real-time thread and must not be one.
void realtime_leave();

/// Touches every page of a block, so that none is fetched later. Leaves the content as it is.
void touch_pages(void* block, std::size_t bytes);

/// A tick at absolute times of CLOCK_MONOTONIC: start, start + period, start + 2 period, ... What a tick takes does not
/// move those that follow, and errors do not add up.
///
/// Overrun: when a time has passed before it is waited for, the tick comes at once if it is the only one; of several,
/// one comes at once, for the latest, and the others are skipped and counted. Ticks never come in a burst: a controller
/// that has slept needs one answer to the present, not many to the past.
class PeriodicTimer {
 public:
  explicit PeriodicTimer(std::int64_t period_ns) : period_ns_(period_ns) {}

  /// Sleeps until the next time; the first call returns at once and sets the start. Signals do not end a wait early
  /// unless `*stop` is not zero then; null: they never do. False: stopped.
  bool wait(const volatile int* stop);

  /// When the tick that wait() returned for was due, CLOCK_MONOTONIC in nanoseconds.
  std::int64_t due_ns() const { return due_ns_; }
  std::uint64_t skipped() const { return skipped_; }
  /// How long after its due time each wait() returned; ticks that were late already are in it.
  const LatencyHistogram& lateness() const { return lateness_; }

 private:
  std::int64_t period_ns_;
  std::int64_t due_ns_ = 0;
  bool begun_ = false;
  std::uint64_t skipped_ = 0;
  LatencyHistogram lateness_;
};

/// Of `late_ns` after the due time, how many whole periods are skipped: the arithmetic of PeriodicTimer's overruns.
std::int64_t periods_to_skip(std::int64_t late_ns, std::int64_t period_ns);

}  // namespace tiller
