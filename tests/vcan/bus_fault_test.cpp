// Every kind of fault on real sockets: runtime and plant over virtual CAN interfaces, the kernel's own queues, gateway
// and error frames between them. In lockstep: a tick follows each period of the plant, however slow the machine is.
// What must hold is judged as for all other faults (tools/bench/fault_run.cpp), and on the wire (bus_fault_link.hpp).
//
//   bus_fault_test [--seeds N] [--kind NAME] [--quick 1]
//
// Prints a row for each kind; exit code 1 if one run was wrong. --quick: the kinds take turns on the two plants. Needs root of a guest that run_in_guest.sh makes.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "bus_fault_wires.hpp"
#include "io/monotonic_clock.hpp"

namespace tiller::faults {
namespace {

struct Result {
  int runs = 0, wrong = 0, stopped = 0;
  double worst_stop_s = 0.0;
};

struct Options {
  std::uint64_t seeds = 1;
  const char* kind = nullptr;
  bool quick = false;
};

void run_kind(const Fault& fault, std::size_t number, const Options& options, Result& r) {
  for (const Robot robot : kRobots) {
    if (options.quick && static_cast<std::size_t>(robot) != number % 2) continue;
    for (std::uint64_t seed = 1; seed <= options.seeds; ++seed) {
      const Outcome o = run_fault(fault, robot, seed);
      ++r.runs;
      r.stopped += o.stopped_s >= 0.0;
      r.worst_stop_s = std::max(r.worst_stop_s, o.stopped_s);
      if (o.wrong == nullptr) continue;
      ++r.wrong;
      std::printf("WRONG %s, %s, seed %d, %.2f s: %s (%s, %s)\n", fault.name, name_of(robot), static_cast<int>(seed),
                  o.wrong_s, o.wrong, tiller_state_name(o.state), tiller_status_name(o.status));
    }
  }
}

int run(const Options& options) {
  int wrong = 0, runs = 0;
  std::size_t number = 0;
  for (const Fault& fault : socket_faults()) {
    ++number;
    if (options.kind != nullptr && std::strcmp(options.kind, fault.name) != 0) continue;
    const std::int64_t begin_us = monotonic_us();
    Result r;
    run_kind(fault, number, options, r);
    runs += r.runs;
    wrong += r.wrong;
    std::printf("%-24s %2d runs %2d wrong, %2d stopped, after %.2f s at most; %.1f s\n", fault.name, r.runs, r.wrong,
                r.stopped, r.worst_stop_s, 1e-6 * static_cast<double>(monotonic_us() - begin_us));
    std::fflush(stdout);
  }
  std::printf("%d runs, %d wrong\n", runs, wrong);
  return wrong == 0 && runs > 0 ? 0 : 1;
}

}  // namespace
}  // namespace tiller::faults

int main(int argc, char** argv) {
  tiller::faults::Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (std::strcmp(argv[i], "--seeds") == 0) options.seeds = std::strtoull(argv[i + 1], nullptr, 10);
    if (std::strcmp(argv[i], "--kind") == 0) options.kind = argv[i + 1];
    if (std::strcmp(argv[i], "--quick") == 0) options.quick = true;
  }
  return tiller::faults::run(options);
}
