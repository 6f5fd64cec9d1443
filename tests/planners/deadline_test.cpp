// Random deadlines by a clock that counts how often it is read. Whatever the deadline, and whatever the belief: a
// command that is finite, within its limits and within reach of the last one, and after the read that said "passed" no
// more than the reads of a planner that stops. ./dev bench deadline does the same a hundred thousand times.

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Deadlines = EveryPlanner;

// Work may be cut into up to eight pieces that notice the deadline one after the other, and the loop around them reads
// once more; a planner that goes on reads at least once an inner iteration and comes beyond this soon.
constexpr std::int64_t kReadsToStop = 9;
constexpr double kReach = 2.0;  // change of the command a period

std::int64_t reads = 0;

tiller_hooks_t reading_clock() {
  tiller_hooks_t h{};
  h.size = sizeof h;
  h.version = TILLER_CONFIG_VERSION;
  h.now_ns = [](void*) { return ++reads; };
  return h;
}

TEST_P(Deadlines, a_command_and_no_work_beyond) {
  const tiller_hooks_t hooks = reading_clock();
  tiller::Config c = line_config(GetParam());
  c.planner.rollouts = 128;
  c.planner.particles = 2;
  c.planner.horizon = 10;
  c.safety.input_rate_per_s[0] = kReach / c.period_s;
  Bench bench(c, &hooks);
  std::uint64_t dice = 20;
  const auto roll = [&dice](double low, double high) {
    dice = dice * 6364136223846793005ull + 1442695040888963407ull;
    return low + (high - low) * static_cast<double>(dice >> 40) / 16777216.0;
  };
  int in_time = 0, cut = 0;
  for (int k = 0; k < 500; ++k) {
    bench.set_state({roll(-2.0, 2.0), roll(-2.0, 2.0)});
    if (k % 50 == 49) bench.set_state({std::numeric_limits<double>::quiet_NaN(), 0.0});
    const double last = bench.last_command[0];
    reads = 0;
    bench.request.deadline.iterations = 20;
    bench.request.deadline.deadline_ns = 1 + static_cast<std::int64_t>(roll(0.0, 60.0));
    const tiller::PlanResult result = bench.plan();
    ASSERT_TRUE(std::isfinite(bench.command[0])) << k;
    ASSERT_LE(std::fabs(bench.command[0]), 5.0) << k;
    ASSERT_LE(std::fabs(bench.command[0] - last), kReach * (1.0 + 1e-6)) << k;
    ASSERT_LE(reads - bench.request.deadline.deadline_ns, kReadsToStop) << k;
    ASSERT_LE(static_cast<std::int64_t>(result.iterations), bench.request.deadline.deadline_ns) << k;
    in_time += result.status == tiller_status_ok;
    cut += result.status == tiller_status_iteration_capped;
  }
  std::printf("%s: %d plans cut, %d done in time\n", tiller::find_planner(GetParam())->name, cut, in_time);
  EXPECT_GT(cut, 0) << "the deadlines are too long to say anything";
}

TILLER_EVERY_PLANNER(Deadlines);

}  // namespace
}  // namespace tiller_test
