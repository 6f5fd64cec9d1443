#include "io/realtime.hpp"

#include <errno.h>
#include <linux/capability.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

namespace tiller {
namespace {

std::int64_t now_ns() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000000 + now.tv_nsec;
}

void note(RealtimeOutcome& part, int error, const char* remedy) {
  part.asked = true;
  part.given = error == 0;
  part.error = error;
  part.remedy = error == 0 ? "" : remedy;
}

void take_priority(int priority, RealtimeOutcome& part) {
  sched_param param{};
  param.sched_priority = priority;
  note(part, pthread_setschedparam(pthread_self(), SCHED_FIFO, &param),
       "setcap cap_sys_nice,cap_ipc_lock+ep on the program, or 'USER - rtprio 99' in /etc/security/limits.conf");
}

bool may_lock_without_limit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY) return true;
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct held[2] = {};
  return syscall(SYS_capget, &header, held) == 0 && (held[0].effective >> CAP_IPC_LOCK & 1u) != 0;
}

/// Under a limit it is not tried at all: what fits today makes a later allocation fail, in the midst of a run.
void lock_memory(RealtimeOutcome& part) {
  int error = EPERM;
  if (may_lock_without_limit()) error = mlockall(MCL_CURRENT | MCL_FUTURE) == 0 ? 0 : errno;
  note(part, error,
       "setcap cap_sys_nice,cap_ipc_lock+ep on the program, or 'USER - memlock unlimited' in "
       "/etc/security/limits.conf");
}

void choose_cpus(std::uint64_t cpus, RealtimeOutcome& part) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (int i = 0; i < 64; ++i)
    if (cpus >> i & 1u) CPU_SET(i, &set);
  note(part, pthread_setaffinity_np(pthread_self(), sizeof set, &set),
       "name processors that this machine has and that the process may use (taskset -p, cgroups)");
}

/// Recursion, not one large array: a page at a time, so that the guard page is met by a check and not by a crash.
__attribute__((noinline)) void touch_stack(std::size_t bytes) {
  volatile char page[4096];
  __asm__ volatile("" : : "r"(page) : "memory");  // clang keeps no more of an array than what is used of it
  page[0] = 0;
  if (bytes > sizeof page) touch_stack(bytes - sizeof page);
  page[sizeof page - 1] = page[0];  // behind the call: no tail call may reuse the frame
}

void prefault_stack(std::size_t bytes, RealtimeOutcome& part) {
  pthread_attr_t attributes;
  void* base = nullptr;
  std::size_t size = 0;
  if (pthread_getattr_np(pthread_self(), &attributes) != 0) return note(part, EAGAIN, "nothing: it will be fetched");
  (void)pthread_attr_getstack(&attributes, &base, &size);
  (void)pthread_attr_destroy(&attributes);
  const char here = 0;
  const auto left = static_cast<std::size_t>(&here - static_cast<const char*>(base));
  constexpr std::size_t kReserve = 65536;  // for what the tick's own calls need beyond it
  if (bytes > RealtimeOptions::kMostStack || bytes + kReserve > left)
    return note(part, ENOMEM, "ask for less, or raise the limit (ulimit -s)");
  touch_stack(bytes);
  note(part, 0, "");
}

}  // namespace

const char* realtime_part_name(RealtimePart part) {
  switch (part) {
    case RealtimePart::priority: return "priority";
    case RealtimePart::memory: return "memory";
    case RealtimePart::cpus: return "processors";
    case RealtimePart::stack: return "stack";
  }
  return "";
}

RealtimeReport realtime_begin(const RealtimeOptions& options) {
  RealtimeReport report;
  const auto part = [&](RealtimePart which) -> RealtimeOutcome& { return report.part[static_cast<int>(which)]; };
  if (options.lock_memory) lock_memory(part(RealtimePart::memory));
  if (options.stack_bytes > 0) prefault_stack(options.stack_bytes, part(RealtimePart::stack));
  if (options.cpus != 0) choose_cpus(options.cpus, part(RealtimePart::cpus));
  if (options.priority > 0) take_priority(options.priority, part(RealtimePart::priority));
  return report;
}

void realtime_leave() {
  const sched_param ordinary{};
  (void)pthread_setschedparam(pthread_self(), SCHED_OTHER, &ordinary);
  cpu_set_t all;
  CPU_ZERO(&all);
  const long count = sysconf(_SC_NPROCESSORS_CONF);
  for (long i = 0; i < count && i < CPU_SETSIZE; ++i) CPU_SET(i, &all);
  (void)pthread_setaffinity_np(pthread_self(), sizeof all, &all);
}

void realtime_end(const RealtimeReport& report) {
  if (report[RealtimePart::priority].given || report[RealtimePart::cpus].given) realtime_leave();
  if (report[RealtimePart::memory].given) (void)munlockall();
}

void touch_pages(void* block, std::size_t bytes) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  auto* at = static_cast<volatile char*>(block);
  for (std::size_t i = 0; i < bytes; i += page) at[i] = at[i];
  if (bytes > 0) at[bytes - 1] = at[bytes - 1];
}

std::int64_t periods_to_skip(std::int64_t late_ns, std::int64_t period_ns) {
  return late_ns < period_ns ? 0 : late_ns / period_ns;
}

bool PeriodicTimer::wait(const volatile int* stop) {
  if (!begun_) {
    begun_ = true;
    due_ns_ = now_ns();
    lateness_.add(0);
    return stop == nullptr || *stop == 0;
  }
  due_ns_ += period_ns_;
  const std::int64_t skip = periods_to_skip(now_ns() - due_ns_, period_ns_);
  skipped_ += static_cast<std::uint64_t>(skip);
  due_ns_ += skip * period_ns_;
  timespec until;
  until.tv_sec = static_cast<time_t>(due_ns_ / 1000000000);
  until.tv_nsec = static_cast<long>(due_ns_ % 1000000000);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR)
    if (stop != nullptr && *stop != 0) return false;
  lateness_.add(now_ns() - due_ns_);
  return stop == nullptr || *stop == 0;
}

}  // namespace tiller
