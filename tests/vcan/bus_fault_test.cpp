// Every kind of fault on real sockets: runtime and plant over virtual CAN interfaces, the kernel's own queues, gateway
// and error frames between them. In lockstep: a tick follows each period of the plant, however slow the machine is.
// What must hold is judged as for all other faults (harness/faults/fault_run.cpp), and on the wire
// (bus_fault_link.hpp).
//
//   bus_fault_test [--seeds N] [--kind NAME] [--quick] [--page]
//
// Prints a row for each kind; exit code 1 if one run was wrong. --quick: the kinds take turns on the two plants;
// --page: the rows of docs/evidence/faults.md too. Needs root of a guest that run_in_guest.sh makes.

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "bus_fault_process.hpp"
#include "bus_fault_wires.hpp"
#include "harness/faults/fault_report.hpp"

namespace tiller::faults {
namespace {

struct Options {
  std::uint64_t seeds = 1;
  const char* kind = nullptr;
  bool quick = false, page = false;
};

/// The judges must be able to say no: a controller whose torques are on the wire two ticks late.
bool judge_sees_stale_torques() {
  Fault late = on_cable("judge", "", End::kBounded, Timeout::kSensor, "");
  late.step = [](World& w) {
    if (w.ticks != 0) return;
    SocketLink::current().pace(true);
    netem("vx1", "delay " + wall_time(2.0));
  };
  const Outcome o = run_fault(late, Robot::kPendulum, 1);
  return o.wrong != nullptr && std::strcmp(o.wrong, "a stale torque on the wire") == 0;
}

/// And a fault of the wires that nobody answers, because it is none.
bool judge_sees_motion() {
  const Fault nothing = on_cable("judge", "", End::kStops, Timeout::kSensor, "");
  const Outcome o = run_fault(nothing, Robot::kPendulum, 1);
  return o.wrong != nullptr && std::strcmp(o.wrong, "the motor was still driven after the timeout") == 0;
}

/// Runs of all kinds that the options ask for, and what they came to.
class Matrix {
 public:
  explicit Matrix(const Options& options) : options_(options) {}

  int run() {
    for (const Fault& fault : socket_faults())
      kind(fault, [&](Robot robot, std::uint64_t seed) { return run_fault(fault, robot, seed); });
    for (const ProcessFault& fault : process_faults())
      kind(row_of(fault), [&](Robot robot, std::uint64_t seed) { return run_process_fault(fault, robot, seed); });
    const bool judged = judge_sees_stale_torques() && judge_sees_motion();
    if (!judged) std::printf("the judges see nothing\n");
    std::printf("%d kinds, %d runs, %d wrong\n", kinds_, runs_, wrong_);
    return wrong_ == 0 && runs_ > 0 && judged ? 0 : 1;
  }

 private:
  void kind(const Fault& fault, const std::function<Outcome(Robot, std::uint64_t)>& one) {
    const Robot turn = kRobots[kinds_++ % 2];
    if (options_.kind != nullptr && std::strcmp(options_.kind, fault.name) != 0) return;
    const std::vector<Robot> both = {Robot::kPendulum, Robot::kCartPole};
    const KindResult r = run_kind(options_.seeds, options_.quick ? std::vector<Robot>{turn} : both, one);
    runs_ += r.runs;
    wrong_ += r.wrong;
    print_line(fault, r);
    if (options_.page) std::printf("PAGE %s\n", page_row(fault, r).c_str());
  }

  const Options& options_;
  int kinds_ = 0, runs_ = 0, wrong_ = 0;
};

}  // namespace
}  // namespace tiller::faults

int main(int argc, char** argv) {
  tiller::faults::Options options;
  for (int i = 1; i < argc; ++i) {
    const bool more = i + 1 < argc;
    if (std::strcmp(argv[i], "--quick") == 0) options.quick = true;
    if (std::strcmp(argv[i], "--page") == 0) options.page = true;
    if (more && std::strcmp(argv[i], "--seeds") == 0) options.seeds = std::strtoull(argv[i + 1], nullptr, 10);
    if (more && std::strcmp(argv[i], "--kind") == 0) options.kind = argv[i + 1];
  }
  return tiller::faults::Matrix(options).run();
}
