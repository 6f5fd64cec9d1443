// The input that costs a tick of a planner the most instructions: looked for, or run again as found.
//   tiller 4 200 7            planner 4 (ilqr): 200 inputs by the seed 7, a half of them random, the rest near the best
//   tiller 4 0 g0 g1 ...      this input alone
// An input is a row of numbers 0..65535, see Entry: where the pendulum starts, what its plant is like, pushes, goals,
// and what its sensor does. With -icount instructions are counted, the same in every run.

#include <cmath>
#include <cstring>

#include "board.hpp"
#include "swing_up.hpp"
#include "tiller/config.hpp"

namespace {

alignas(TILLER_ALIGNMENT) unsigned char block[TILLER_WORST_TICK_BLOCK];

constexpr std::uint32_t kTicks = 24;  // the window of the filter (16) fills, and is left
constexpr std::uint32_t kRoom = 4096;
constexpr double kPi = 3.141592653589793;

enum Entry : std::uint32_t {
  kStart,
  kRate,
  kMass,
  kDamping,
  kFriction,  // the plant
  kGoal,
  kNextGoal,
  kGoalTick,  // the goal, and the one it is replaced by
  kPushTick,
  kPush,
  kPushAgainTick,
  kPushAgain,  // two jumps of the rate
  kNoise,
  kNoiseSeed,  // of the encoder
  kOutlierTick,
  kOutlier,  // one reading beside the truth
  kSilenceTick,
  kSilence,  // ticks without a reading
  kEntries
};
using Input = std::uint32_t[kEntries];

struct Random {
  std::uint64_t state;
  std::uint64_t next() {  // splitmix64
    std::uint64_t z = state += 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
  }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((next() >> 32) * n >> 32); }
};

double within(std::uint32_t value, double low, double high) { return low + (high - low) * value / 65535.0; }
std::uint32_t tick_of(std::uint32_t value) { return value * kTicks / 65536u; }

/// Instructions of one tick; the timer counts every 40 ns, and with -icount shift=7 an instruction takes 128 ns.
std::uint32_t since(std::uint32_t before) {
  return static_cast<std::uint32_t>(std::uint64_t{static_cast<std::uint32_t>(before - board::timer())} * 40 / 128);
}

struct Outcome {
  std::uint32_t most = 0, at_tick = 0;
};

std::uint32_t seen[kRoom], seen_count = 0;

const char* refused = nullptr;

Outcome run(std::uint32_t planner, const Input& g) {
  static tiller::Config config;
  const bool policy = planner == tiller_planner_policy;
  const bool samples = planner < tiller_planner_ilqr || planner == tiller_planner_hybrid;
  swing_up::Task task = {"worst", static_cast<tiller_planner_kind_t>(planner), within(g[kStart], -kPi, kPi), 0.0,
                         policy ? 0.0 : 0.02};
  config = swing_up::config(task);
  config.planner.particles = samples ? 2 : 1;
  config.initial_state[1] = within(g[kRate], -12.0, 12.0);
  config.cost.target[0] = policy ? kPi : within(g[kGoal], -kPi, kPi);
  swing_up::Plant plant;
  plant.angle_rad = config.initial_state[0];
  plant.rate_rad_s = config.initial_state[1];
  plant.mass_kg = within(g[kMass], 0.15, 0.9);
  plant.damping_Nms = within(g[kDamping], 0.0, 0.15);
  plant.friction_Nm = within(g[kFriction], 0.0, 0.08);
  Outcome outcome;
  tiller_t* t = nullptr;
  const char* field = nullptr;
  tiller_status_t status = tiller_config_check(&config, &field);
  if (status == tiller_status_ok) status = tiller_init(&t, &config, nullptr, block, sizeof block);
  if (status != tiller_status_ok) {
    refused = field != nullptr ? field : tiller_status_name(status);
    return outcome;
  }
  (void)tiller_arm(t);
  Random noise{g[kNoiseSeed]};
  for (std::uint32_t tick = 0; tick < kTicks; ++tick) {
    const std::int64_t now_us = 1000000 + tick * static_cast<std::int64_t>(config.period_s * 1e6 + 0.5);
    if (tick == tick_of(g[kGoalTick])) {
      const double goal[2] = {within(g[kNextGoal], -kPi, kPi), 0.0};
      (void)tiller_set_target(t, goal);
    }
    tiller_measurement_t measurement = {};
    measurement.stamp_us = now_us;
    measurement.sequence = tick + 1;
    measurement.value[0] = plant.angle_rad + within(g[kNoise], 0.0, 0.05) * within(noise.below(65536), -1.0, 1.0);
    if (tick == tick_of(g[kOutlierTick])) measurement.value[0] += within(g[kOutlier], -1.0, 1.0);
    const std::uint32_t from = tick_of(g[kSilenceTick]), silent = g[kSilence] / 13108u;  // 0..4: more is SAFE
    const bool reads = tick < from || tick >= from + silent;
    tiller_command_t command;
    const std::uint32_t before = board::timer();
    (void)tiller_tick(t, now_us, reads ? &measurement : nullptr, &command);
    const std::uint32_t spent = since(before);
    if (seen_count < kRoom && command.state == tiller_state_active) seen[seen_count++] = spent;
    if (spent > outcome.most) outcome = {spent, tick};
    plant.step(command.value[0], config.period_s);
    if (tick == tick_of(g[kPushTick])) plant.rate_rad_s += within(g[kPush], -12.0, 12.0);
    if (tick == tick_of(g[kPushAgainTick])) plant.rate_rad_s += within(g[kPushAgain], -12.0, 12.0);
  }
  return outcome;
}

void number(const char* what, std::uint64_t value) {
  board::print(what);
  board::print_number(value);
}

void print_row(std::uint32_t planner, std::uint32_t evaluation, const Outcome& outcome, const Input& g) {
  number("planner ", planner);
  number(" input ", evaluation);
  number(" most ", outcome.most);
  number(" tick ", outcome.at_tick);
  board::print(" values");
  for (const std::uint32_t value : g) number(" ", value);
  board::print("\n");
}

std::uint32_t median() {
  for (std::uint32_t gap = seen_count / 2; gap > 0; gap /= 2)  // Shell's sort: no heap, no recursion
    for (std::uint32_t i = gap; i < seen_count; ++i)
      for (std::uint32_t j = i; j >= gap && seen[j - gap] > seen[j]; j -= gap) {
        const std::uint32_t swapped = seen[j];
        seen[j] = seen[j - gap];
        seen[j - gap] = swapped;
      }
  return seen_count > 0 ? seen[seen_count / 2] : 0;
}

/// A few values drawn anew, or moved a little.
void change(Input& g, Random& random) {
  for (std::uint32_t times = 1 + random.below(3); times > 0; --times) {
    std::uint32_t& value = g[random.below(kEntries)];
    if (random.below(2) == 0)
      value = random.below(65536);
    else
      value = (value + 65536u + random.below(4097) - 2048u) & 0xffffu;
  }
}

void search(std::uint32_t planner, std::uint32_t inputs, std::uint64_t seed) {
  Random random{seed};
  Input best = {}, tried;
  Outcome most;
  std::uint32_t ordinary = 0, of_random = 0;
  for (std::uint32_t i = 0; i < inputs && refused == nullptr; ++i) {
    if (i < inputs / 2) {
      for (std::uint32_t& value : tried) value = random.below(65536);
    } else {
      if (i == inputs / 2) ordinary = median(), of_random = most.most;
      std::memcpy(tried, best, sizeof best);
      change(tried, random);
    }
    const Outcome outcome = run(planner, tried);
    if (outcome.most < most.most) continue;
    if (outcome.most > most.most) print_row(planner, i, outcome, tried);
    most = outcome;
    std::memcpy(best, tried, sizeof best);
  }
  number("planner ", planner);
  number(" median ", ordinary);
  number(" random ", of_random);
  number(" most ", most.most);
  board::print("\n");
}

}  // namespace

int main() {
  static std::uint32_t given[3 + kEntries];
  const std::size_t count = board::arguments(given, 3 + kEntries);
  board::start_timer();
  if (count == 3 && given[1] > 0) {
    search(given[0], given[1], given[2]);
  } else if (count == 2 + kEntries) {
    Input g;
    std::memcpy(g, given + 2, sizeof g);
    print_row(given[0], 0, run(given[0], g), g);
  } else {
    board::print("worst_tick: PLANNER INPUTS SEED, or PLANNER 0 and the values of one input\n");
    return 1;
  }
  if (refused == nullptr) return 0;
  board::print("refused: ");
  board::print(refused);
  board::print("\n");
  return 1;
}
