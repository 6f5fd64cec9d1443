// commands [TICKS]: the closed loop of swing_up.hpp with each planner; prints what other targets must print too.
// Ends with 1 where the pendulum does not stand most of the time.

#include <cstdio>
#include <cstdlib>

#include "swing_up.hpp"
#include "tiller/config.hpp"

namespace {

alignas(TILLER_ALIGNMENT) unsigned char block[512u << 10];

bool run(const swing_up::Task& task, std::uint32_t ticks) {
  const tiller::Config config = swing_up::config(task);
  const swing_up::Result result = swing_up::run(task, config, block, sizeof block, ticks, nullptr, nullptr);
  char line[swing_up::kLine];
  swing_up::describe(task.name, result, line);
  std::printf("%s\n", line);
  std::fprintf(stderr, "%s block %zu bytes, %s\n", task.name, tiller_size(&config), tiller_instruction_set());
  return swing_up::good(result);
}

}  // namespace

int main(int count, char** arguments) {
  const std::uint32_t ticks = count > 1 ? static_cast<std::uint32_t>(std::atoi(arguments[1])) : 1000u;
  bool good = true;
  for (const swing_up::Task& task : swing_up::kTasks) good = run(task, ticks) && good;
  return good ? 0 : 1;
}
