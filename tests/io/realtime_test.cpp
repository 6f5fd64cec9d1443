// Real time: what Linux gave is what is reported, with and without privileges; ticks stand on their grid and never come
// in bursts. No test looks at how long anything took.
#include "io/realtime.hpp"

#include <gtest/gtest.h>
#include <linux/capability.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace tiller {
namespace {

// ---- histogram ---------------------------------------------------------------------------------------------------

TEST(LatencyHistogram, BinsLeaveNoGap) {
  using H = LatencyHistogram;
  for (std::uint32_t bin = 0; bin + 1 < H::kBins; ++bin) {
    ASSERT_EQ(H::index(H::upper_edge(bin)), bin);
    ASSERT_EQ(H::index(H::upper_edge(bin) + 1), bin + 1);
  }
  EXPECT_EQ(H::index(~std::uint64_t{0}), H::kBins - 1);
  EXPECT_EQ(H::upper_edge(H::kBins - 1), static_cast<std::uint64_t>(H::kMostNs) - 1);
}

// Against the sorted list: a quantile is that of the list or above it, by at most the width of a bin, 1.6 %.
TEST(LatencyHistogram, QuantilesAreThoseOfTheList) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    std::mt19937_64 random(seed);
    std::lognormal_distribution<double> draw(10.0, 2.0);
    LatencyHistogram histogram;
    std::vector<std::int64_t> list;
    for (int i = 0; i < 20000; ++i) {
      list.push_back(static_cast<std::int64_t>(draw(random)));
      histogram.add(list.back());
    }
    std::sort(list.begin(), list.end());
    for (const double q : {0.01, 0.5, 0.9, 0.99, 0.9999}) {
      const double exact = static_cast<double>(list[static_cast<std::size_t>(q * 20000 - 0.5)]);
      const double got = 1000 * histogram.quantile_us(q);
      EXPECT_GE(got, exact - 1) << q;
      EXPECT_LE(got, exact * (1 + 1.0 / 64) + 1) << q;
    }
    EXPECT_EQ(histogram.count(), 20000u);
    EXPECT_EQ(histogram.most_us(), 1e-3 * static_cast<double>(list.back()));
    EXPECT_EQ(histogram.quantile_us(1.0), histogram.most_us());
  }
}

TEST(LatencyHistogram, TakesWhateverAClockSays) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.quantile_us(0.5), 0);
  for (const std::int64_t ns : {std::int64_t{-5}, std::int64_t{0}, INT64_MAX, INT64_MIN}) histogram.add(ns);
  EXPECT_EQ(histogram.count(), 4u);
  EXPECT_EQ(histogram.above(1000), 1u);
  EXPECT_EQ(histogram.most_us(), 1e-3 * LatencyHistogram::kMostNs);
}

// ---- ticks -------------------------------------------------------------------------------------------------------

std::int64_t monotonic_ns() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000000 + now.tv_nsec;
}

TEST(PeriodicTimer, OverrunsSkipWholePeriods) {
  EXPECT_EQ(periods_to_skip(-1, 10), 0);
  EXPECT_EQ(periods_to_skip(0, 10), 0);
  EXPECT_EQ(periods_to_skip(9, 10), 0);  // late, but it is the only one: it comes at once
  EXPECT_EQ(periods_to_skip(10, 10), 1);
  EXPECT_EQ(periods_to_skip(29, 10), 2);
}

// Whatever the machine does in between: due times stand on one grid, no tick comes before its time, and every period is
// either a tick or counted as skipped.
TEST(PeriodicTimer, StandsOnItsGridAndCountsWhatItSkips) {
  constexpr std::int64_t kPeriod = 2000000;
  PeriodicTimer timer(kPeriod);
  ASSERT_TRUE(timer.wait(nullptr));
  const std::int64_t start = timer.due_ns();
  std::int64_t before = start;
  std::uint64_t waits = 0, forced = 0;
  for (int i = 0; i < 40; ++i) {
    if (i % 10 == 5) {  // overrun by 5.5 periods: at least four are lost
      const timespec late = {0, 11 * kPeriod / 2};
      nanosleep(&late, nullptr);
      forced += 4;
    }
    ASSERT_TRUE(timer.wait(nullptr));
    ++waits;
    ASSERT_GE(monotonic_ns(), timer.due_ns());
    ASSERT_EQ((timer.due_ns() - start) % kPeriod, 0);
    ASSERT_GT(timer.due_ns(), before) << "one tick for one due time";
    before = timer.due_ns();
  }
  EXPECT_EQ(static_cast<std::uint64_t>((before - start) / kPeriod), waits + timer.skipped());
  EXPECT_GE(timer.skipped(), forced);
  EXPECT_EQ(timer.lateness().count(), waits + 1);
}

TEST(PeriodicTimer, AFlagThatIsUpEndsTheLoopAfterTheWait) {
  volatile int down = 0, up = 1;
  PeriodicTimer timer(1000000), stopped(1000000);
  EXPECT_TRUE(timer.wait(&down));
  EXPECT_TRUE(timer.wait(&down));
  EXPECT_FALSE(timer.wait(&up));
  EXPECT_FALSE(stopped.wait(&up)) << "before the first";
}

volatile int stop_flag = 0;
void on_alarm(int) { stop_flag = 1; }

TEST(PeriodicTimer, ASignalEndsTheWaitWhereItAsksFor) {
  struct sigaction action {};
  action.sa_handler = on_alarm;
  ASSERT_EQ(sigaction(SIGALRM, &action, nullptr), 0);
  itimerval again{};  // and again: one that falls between the look at the flag and the sleep ends nothing
  again.it_value.tv_usec = again.it_interval.tv_usec = 20000;
  PeriodicTimer timer(3600ll * 1000000000);
  ASSERT_TRUE(timer.wait(&stop_flag));
  ASSERT_EQ(setitimer(ITIMER_REAL, &again, nullptr), 0);
  EXPECT_FALSE(timer.wait(&stop_flag));  // an hour, but for the signal
  EXPECT_EQ(stop_flag, 1);
  PeriodicTimer through(100000000);  // signals that nobody asked about, or whose flag is down, end no wait
  volatile int down = 0;
  ASSERT_TRUE(through.wait(nullptr));
  EXPECT_TRUE(through.wait(nullptr));
  EXPECT_TRUE(through.wait(&down));
  EXPECT_GE(monotonic_ns(), through.due_ns());
  again = {};
  EXPECT_EQ(setitimer(ITIMER_REAL, &again, nullptr), 0);
}

// ---- privileges --------------------------------------------------------------------------------------------------

extern "C" int __llvm_profile_write_file() __attribute__((weak));  // where a build counts conditions (./dev coverage)

/// In a child, so that nothing of it stays. The child's failures are printed and counted as its exit code.
int in_child(const std::function<int()>& run) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    const int failures = run();
    std::fflush(stdout);
    if (__llvm_profile_write_file != nullptr) (void)__llvm_profile_write_file();
    _exit(failures);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

int expect(bool good, const char* what) {
  if (!good) std::printf("  wrong: %s\n", what);
  return good ? 0 : 1;
}

void drop_privileges() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct none[2] = {};
  (void)syscall(SYS_capset, &header, none);
  const rlimit nothing = {0, 0};
  (void)setrlimit(RLIMIT_RTPRIO, &nothing);
  (void)setrlimit(RLIMIT_MEMLOCK, &nothing);
}

std::uint64_t one_cpu() {
  cpu_set_t set;
  sched_getaffinity(0, sizeof set, &set);
  for (int i = 0; i < 64; ++i)
    if (CPU_ISSET(i, &set)) return std::uint64_t{1} << i;
  return 1;
}

RealtimeOptions everything() {
  RealtimeOptions options;
  options.priority = 20;
  options.lock_memory = true;
  options.cpus = one_cpu();
  options.stack_bytes = 256 * 1024;
  return options;
}

long locked_kB() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmLck:", 0) == 0) return std::atol(line.c_str() + 6);
  return -1;
}

bool is_fifo() {
  int policy = 0;
  sched_param param{};
  pthread_getschedparam(pthread_self(), &policy, &param);
  return policy == SCHED_FIFO && param.sched_priority == 20;
}

/// What the report says is what the kernel says.
int check_report(const RealtimeReport& report) {
  int wrong = 0;
  wrong += expect(report[RealtimePart::priority].given == is_fifo(), "the scheduler is not what was reported");
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they leave out mlockall and call it done
  wrong += expect(report[RealtimePart::memory].given == (locked_kB() > 0), "locked memory is not what was reported");
#endif
  cpu_set_t set;
  sched_getaffinity(0, sizeof set, &set);
  wrong += expect(report[RealtimePart::cpus].given == (CPU_COUNT(&set) == 1) || CPU_COUNT(&set) == 1, "processors");
  for (const RealtimeOutcome& part : report.part)
    wrong += expect(part.given ? part.error == 0 && part.remedy[0] == '\0' : part.error != 0 && part.remedy[0] != '\0',
                    "no reason or no remedy");
  return wrong;
}

TEST(Realtime, WithoutPrivilegesItRunsAndSaysWhatItCouldNotGet) {
  EXPECT_EQ(in_child([] {
              drop_privileges();
              const RealtimeReport report = realtime_begin(everything());
              int wrong = check_report(report);
              wrong += expect(!report[RealtimePart::priority].given, "priority without privileges");
              wrong += expect(report[RealtimePart::priority].error == EPERM, "why: not permitted");
              wrong += expect(!report[RealtimePart::memory].given, "locked memory without privileges");
              wrong += expect(report[RealtimePart::cpus].given && report[RealtimePart::stack].given, "the rest");
              wrong += expect(!report.complete(), "complete");
              return wrong;
            }),
            0);
}

TEST(Realtime, WhatItGotIsWhatTheKernelSays) {
  EXPECT_EQ(in_child([] {
              const RealtimeReport report = realtime_begin(everything());
              int wrong = check_report(report);
              for (int i = 0; i < kRealtimeParts; ++i)
                std::printf("  %s: %s\n", realtime_part_name(static_cast<RealtimePart>(i)),
                            report.part[i].given ? "given" : std::strerror(report.part[i].error));
              bool same = false;  // planner threads that are made now run as the tick does
              std::thread([&] { same = is_fifo(); }).join();
              wrong += expect(same == report[RealtimePart::priority].given, "a thread made later");
              realtime_end(report);
              wrong += expect(!is_fifo() && locked_kB() == 0, "undone");
              return wrong;
            }),
            0);
}

TEST(Realtime, NothingAskedNothingDone) {
  const RealtimeReport report = realtime_begin(RealtimeOptions());
  EXPECT_TRUE(report.complete());
  for (const RealtimeOutcome& part : report.part) EXPECT_FALSE(part.asked || part.given);
  EXPECT_FALSE(is_fifo());
}

TEST(Realtime, WhatDoesNotExistIsRefused) {
  EXPECT_EQ(in_child([] {
              RealtimeOptions options;
              cpu_set_t set;
              sched_getaffinity(0, sizeof set, &set);
              options.cpus = std::uint64_t{1} << 63;
              if (CPU_ISSET(63, &set)) return 0;  // a machine of 64 processors
              options.stack_bytes = RealtimeOptions::kMostStack + 1;
              const RealtimeReport report = realtime_begin(options);
              return expect(report[RealtimePart::cpus].error == EINVAL, "a processor that is not there") +
                     expect(report[RealtimePart::stack].error == ENOMEM, "more stack than there is");
            }),
            0);
}

// ---- pages -------------------------------------------------------------------------------------------------------

long faults() {
  rusage usage;
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt;
}

__attribute__((noinline)) int use_stack(int depth) {
  volatile char page[4096];
  __asm__ volatile("" : : "r"(page) : "memory");
  page[0] = static_cast<char>(depth);
  if (depth > 0) page[0] = static_cast<char>(use_stack(depth - 1));
  return page[0];  // behind the call: no frame is used twice
}

TEST(Realtime, ATouchedStackFaultsNoMore) {
  long without = 0, with = 0;
  std::thread([&] {
    const long before = faults();
    (void)use_stack(50);
    without = faults() - before;
  }).join();
  std::thread([&] {
    RealtimeOptions options;
    options.stack_bytes = 256 * 1024;
    ASSERT_TRUE(realtime_begin(options)[RealtimePart::stack].given);
    const long before = faults();
    (void)use_stack(50);
    with = faults() - before;
  }).join();
  std::printf("200 kB of stack: %ld page faults untouched, %ld touched\n", without, with);
  EXPECT_GE(without, 40);
  EXPECT_LE(with, 2);
}

TEST(Realtime, ATouchedBlockFaultsNoMoreAndIsUnchanged) {
  constexpr std::size_t kBytes = 1 << 20;
  auto* block =
      static_cast<unsigned char*>(mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(block, MAP_FAILED);
  block[5000] = 77;
  touch_pages(block, kBytes);
  const long before = faults();
  for (std::size_t i = 0; i < kBytes; i += 512) block[i + 1] = 1;
  EXPECT_LE(faults() - before, 1);
  EXPECT_EQ(block[5000], 77);
  touch_pages(block, 0);
  munmap(block, kBytes);
}

}  // namespace
}  // namespace tiller
