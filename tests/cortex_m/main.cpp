// The closed loop of tests/cross on a Cortex-M7: prints the lines that other targets print, and what it took.

#include "board.hpp"
#include "swing_up.hpp"
#include "tiller/config.hpp"

namespace {

// what the controllers need, and no more: the linker script has the rest of the RAM
alignas(TILLER_ALIGNMENT) unsigned char block[TILLER_CORTEX_M_BLOCK];

/// With -icount shift=7 an instruction takes 2^7 ns of virtual time, and the timer counts every 40 ns.
constexpr std::uint64_t kCounts = 25, kNanosecondsPerCount = 40, kNanosecondsPerInstruction = 128;
constexpr std::uint64_t kPolicyInstructions = 20000;  // that planning by a policy may take, a tick
static_assert(kCounts * kNanosecondsPerCount == 1000, "25 MHz");

struct Counts {
  std::uint32_t before = 0;
  std::uint64_t sum = 0, most = 0;
};

std::size_t deepest, deepest_tick;  // stack: of all, and of tiller_tick below who calls it

/// After each tick, called by who called the tick. The first time tiller_init was called, too.
void note_stack(std::uint32_t tick, const void* callers_stack) {
  const std::size_t used = board::stack_used(), of_tick = used - board::stack_above(callers_stack);
  if (used > deepest) deepest = used;
  if (tick > 0 && of_tick > deepest_tick) deepest_tick = of_tick;
  board::paint_stack();
}

void note(void* context, std::uint32_t tick) {
  Counts& counts = *static_cast<Counts*>(context);
  const std::uint32_t now = board::timer();
  const std::uint64_t spent = static_cast<std::uint32_t>(counts.before - now);  // counts down
  counts.sum += spent;
  if (spent > counts.most) counts.most = spent;
  note_stack(tick, __builtin_dwarf_cfa());
  counts.before = board::timer();
}

std::uint64_t instructions(std::uint64_t counts) { return counts * kNanosecondsPerCount / kNanosecondsPerInstruction; }

/// Nanoseconds of virtual time since the first call; asked more often than the timer wraps.
std::int64_t now_ns(void*) {
  static std::uint32_t last = board::timer();
  static std::int64_t sum = 0;
  const std::uint32_t now = board::timer();
  sum += std::int64_t{static_cast<std::uint32_t>(last - now)} * static_cast<std::int64_t>(kNanosecondsPerCount);
  last = now;
  return sum;
}

tiller_hooks_t clock_hooks() {
  tiller_hooks_t hooks = {};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.now_ns = now_ns;
  return hooks;
}

void row(const char* what, std::uint64_t value) {
  board::print("# ");
  board::print(what);
  board::print(" ");
  board::print_number(value);
  board::print("\n");
}

bool run(const swing_up::Task& task, std::uint32_t ticks) {
  static tiller::Config config;  // static: a kilobyte and more that the stack need not hold
  config = swing_up::config(task);
  Counts counts;
  counts.before = board::timer();
  const tiller_hooks_t hooks = clock_hooks();
  const swing_up::Result result = swing_up::run(task, config, block, sizeof block, ticks, &note, &counts, &hooks);
  char line[swing_up::kLine];
  swing_up::describe(task.name, result, line);
  board::print(line);
  board::print("\n");
  row("block_bytes", tiller_size(&config));
  row("instructions_per_tick_mean", instructions(counts.sum / (ticks ? ticks : 1)));
  row("instructions_per_tick_most", instructions(counts.most));
  const std::uint64_t planning = static_cast<std::uint64_t>(result.plan_ns) / kNanosecondsPerInstruction;
  const std::uint64_t longest = static_cast<std::uint64_t>(result.longest_plan_ns) / kNanosecondsPerInstruction;
  row("planning_instructions_mean", planning / (ticks ? ticks : 1));
  row("planning_instructions_most", longest);
  // a policy's promise; the other planners cost what they are set to
  return swing_up::good(result) && (task.kind != tiller_planner_policy || longest <= kPolicyInstructions);
}

}  // namespace

int main() {
  std::uint32_t ticks = 200;
  (void)board::arguments(&ticks, 1);
  board::start_timer();
  bool good = true;
  for (const swing_up::Task& task : swing_up::kTasks) good = run(task, ticks) && good;
  row("flash_bytes", board::flash_size());
  row("data_bytes", board::data_size());
  row("stack_bytes_used", deepest);
  row("tick_stack_bytes_used", deepest_tick);
  row("stack_bytes", board::stack_size());
  row("ram_bytes", board::data_size() + board::stack_size());
  return good ? 0 : 1;
}
