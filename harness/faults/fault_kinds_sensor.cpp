// Faults of what is measured and of time, at the controller's own door.

#include <cmath>
#include <cstring>
#include <limits>

#include "harness/faults/fault.hpp"

namespace tiller::faults {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

constexpr std::uint32_t kSwingSteps = 500;
constexpr const char *kValues = "sensor values", *kTime = "time";

/// Rows of a task that never rests: a robot at rest may rightly repeat itself.
const double* swing(Robot robot) {
  static double rows[2][kSwingSteps * 4] = {};
  double* row = rows[static_cast<int>(robot)];
  const std::uint32_t nx = robot == Robot::kPendulum ? 2 : 4, angle = robot == Robot::kPendulum ? 0 : 1;
  for (std::uint32_t k = 0; k < kSwingSteps; ++k) {
    const double phase = 2.0 * 3.14159265358979 * 0.8 * 0.02 * k;
    row[k * nx + angle] = (robot == Robot::kPendulum ? 0.0 : 3.14159265358979) + 0.8 * std::sin(phase);
  }
  return row;
}

bool rejected(const World&, const tiller_info_t& info) { return info.rejected_measurements > 0; }

/// A jump that no true motion makes good within bad_ticks_to_safe: beyond what the rate limit allows by then.
double jump_rad(World& world) {
  if (world.amount == 0.0) world.amount = world.random.sign() * world.random.uniform(world.reach_rad(), 3.0);
  return world.amount;
}

void values_not_finite(std::vector<Fault>& list) {
  list.push_back({"one_value_nan", kValues, "one value is NaN from now on", Route::kMemory, End::kStops,
                  Timeout::kSensor, "skipped; SAFE once that value by itself is older than the timeout"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] = kNan;
    return true;
  };
  list.push_back({"all_values_nan", kValues, "all values are NaN", Route::kMemory, End::kStops, Timeout::kBadTicks,
                  "`sensor_not_finite`, SAFE"});
  list.back().measure = [](World&, tiller_measurement_t& m) {
    for (double& v : m.value) v = kNan;
    return true;
  };
  list.push_back({"some_values_nan", kValues, "one of five measurements has a NaN", Route::kMemory, End::kRides,
                  Timeout::kSensor, "skipped and counted"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    // three whole measurements in a row would be bad_ticks_to_safe
    const bool spoils = w.amount < 2.0 && w.random.chance(0.2);
    w.amount = spoils ? w.amount + 1.0 : 0.0;
    if (spoils) m.value[w.random.below(w.setup.config.measurement_count)] = kNan;
    return true;
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.missing_values + i.rejected_measurements > 0;
  };
  list.push_back({"infinite", kValues, "a value is infinite", Route::kMemory, End::kStops, Timeout::kBadTicks,
                  "`sensor_not_finite`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] = w.random.sign() * kInf;
    return true;
  };
}

void values_far_off(std::vector<Fault>& list) {
  list.push_back({"out_of_range", kValues, "a value beyond measurement_low..high", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`sensor_out_of_range`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[0] = w.random.sign() * w.random.uniform(61.0, 1e6);
    return true;
  };
  list.push_back({"denormal_and_huge", kValues, "values of 1e-310 and 1e308 by turns", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`sensor_jump` or `sensor_out_of_range`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[0] = w.ticks % 2 == 0 ? 1e308 : -1e308;
    m.value[1] = 1e-310;
    return true;
  };
  list.push_back({"jump_once", kValues, "one reading is off by 1.5 to 3 rad", Route::kMemory, End::kRides,
                  Timeout::kSensor, "`sensor_jump`: rejected, the plan goes on"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] += jump_rad(w);
    return true;
  };
  list.back().noticed = rejected;
  list.back().lasts_ticks = 1;
  list.push_back({"jump_that_stays", kValues, "an encoder slips by 1.5 to 3 rad", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`sensor_jump`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] += jump_rad(w);
    return true;
  };
}

void values_damaged(std::vector<Fault>& list) {
  list.push_back({"bit_flips", kValues, "a random bit of every fifth value flips", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "what is rejected is not used; SAFE if it goes on"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    for (double& v : m.value) {
      if (!w.random.chance(0.2)) continue;
      std::uint64_t bits = 0;
      std::memcpy(&bits, &v, sizeof bits);
      bits ^= std::uint64_t{1} << w.random.below(64);
      std::memcpy(&v, &bits, sizeof bits);
    }
    return true;
  };
  list.push_back({"frozen", kValues, "values repeat to the last bit, stamps go on, while it swings", Route::kMemory,
                  End::kStops, Timeout::kFrozen, "`sensor_frozen`, SAFE"});
  list.back().prepare = [](Setup& s) {
    s.config.cost.reference = swing(s.robot);
    s.config.cost.reference_steps = kSwingSteps;
  };
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.ticks == 0) w.kept = m;
    std::memcpy(m.value, w.kept.value, sizeof m.value);
    return true;
  };
}

void arrival(std::vector<Fault>& list) {
  const char* group = "arrival";
  list.push_back({"silent", group, "no measurement comes", Route::kMemory, End::kStops, Timeout::kSensor,
                  "the rest of the plan, then `sensor_stale`, SAFE"});
  list.back().measure = [](World&, tiller_measurement_t&) { return false; };
  list.push_back({"silent_for_three_ticks", group, "three measurements are lost", Route::kMemory, End::kRides,
                  Timeout::kSensor, "the next steps of the plan"});
  list.back().measure = [](World&, tiller_measurement_t&) { return false; };
  list.back().lasts_ticks = 3;
  list.push_back({"every_third", group, "two of three measurements are lost", Route::kMemory, End::kRides,
                  Timeout::kSensor, "the next steps of the plan"});
  list.back().measure = [](World& w, tiller_measurement_t&) { return w.ticks % 3 == 2; };
  list.push_back({"repeated", group, "the same measurement again and again", Route::kMemory, End::kStops,
                  Timeout::kSensor, "nothing new: `sensor_stale`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.ticks == 0) w.kept = w.past[w.past.size() - 2];
    m = w.kept;
    return true;
  };
  list.push_back({"late", group, "every measurement comes three ticks late", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "counts as an old state"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m = w.past[w.past.size() - 4];
    return true;
  };
  list.push_back({"too_late", group, "every measurement comes 0.2 s late", Route::kMemory, End::kStops,
                  Timeout::kSensor, "`sensor_stale`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m = w.past[w.past.size() - 11];
    return true;
  };
  list.push_back({"swapped", group, "pairs of measurements come in the wrong order", Route::kMemory, End::kRides,
                  Timeout::kSensor, "`time_backwards`: the older one is rejected"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.ticks % 2 == 1) m = w.past[w.past.size() - 3];
    return true;
  };
  list.back().noticed = rejected;
  list.push_back({"absurd_latency", group, "command_latency_us is 2^32 - 1", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "bounded to four periods"});
  list.back().measure = [](World&, tiller_measurement_t& m) {
    m.command_latency_us = 0xffffffffu;
    return true;
  };
}

void stamps(std::vector<Fault>& list) {
  list.push_back({"stamp_stands", kTime, "the sensors' stamps stand still", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`time_backwards`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.ticks == 0) w.kept = w.past[w.past.size() - 2];
    m.stamp_us = w.kept.stamp_us;
    return true;
  };
  list.push_back({"stamp_backwards", kTime, "the sensors' stamps run backwards", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`time_backwards`, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.ticks == 0) w.kept = w.past[w.past.size() - 2];
    m.stamp_us = w.kept.stamp_us - 3000 * w.ticks;
    return true;
  };
  list.push_back({"stamp_ahead", kTime, "the sensors' stamps are up to an hour ahead", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`sensor_stale`: their age is unknown, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    if (w.amount == 0.0) w.amount = std::pow(10.0, w.random.uniform(5.0, 9.5));
    m.stamp_us += static_cast<std::int64_t>(w.amount);
    return true;
  };
  list.push_back({"stamp_extreme", kTime, "a stamp at the end of the numbers", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "differences saturate; rejected, SAFE"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.stamp_us =
        w.random.below(2) == 0 ? std::numeric_limits<std::int64_t>::min() : std::numeric_limits<std::int64_t>::max();
    return true;
  };
}

void clocks(std::vector<Fault>& list) {
  list.push_back({"clock_steps_back", kTime, "the caller's clock and the stamps step back by up to an hour",
                  Route::kMemory, End::kStops, Timeout::kNow, "`time_backwards`, SAFE"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) w.clock_offset_us = -static_cast<std::int64_t>(w.random.uniform(1e6, 3.6e9));
  };
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.stamp_us += w.clock_offset_us;
    return true;
  };
  list.push_back({"clock_steps_ahead", kTime, "the caller's clock and the stamps step ahead by up to an hour",
                  Route::kMemory, End::kStops, Timeout::kNow, "`sensor_stale`, SAFE"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) w.clock_offset_us = static_cast<std::int64_t>(w.random.uniform(1e6, 3.6e9));
  };
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.stamp_us += w.clock_offset_us;
    return true;
  };
  list.push_back({"callers_clock_ahead", kTime, "the caller's clock alone steps ahead", Route::kMemory, End::kStops,
                  Timeout::kBadTicks, "`sensor_stale`, SAFE"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) w.clock_offset_us = static_cast<std::int64_t>(w.random.uniform(2e5, 3.6e9));
  };
  list.push_back({"clocks_stand", kTime, "the caller's clock stands still, nothing is measured", Route::kMemory,
                  End::kStops, Timeout::kSensor, "each such tick counts for a period: `sensor_stale`, SAFE"});
  list.back().step = [](World& w) { w.clock_stands = true; };
  list.back().measure = [](World&, tiller_measurement_t&) { return false; };
}

void everything_at_once(std::vector<Fault>& list) {
  list.push_back({"everything_at_once", kTime, "values, stamps and losses at random", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "what is rejected is not used"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    const double strange[] = {kNan, kInf, -kInf, 1e300, -1e-310, 59.0, 0.0};
    if (w.random.chance(0.3)) m.value[w.random.below(2)] = strange[w.random.below(7)];
    if (w.random.chance(0.2)) m.stamp_us += static_cast<std::int64_t>(w.random.uniform(-4e5, 4e5));
    if (w.random.chance(0.05)) m.stamp_us = std::numeric_limits<std::int64_t>::min();
    w.command_lost = w.random.chance(0.1);
    return !w.random.chance(0.2);
  };
}

}  // namespace

std::vector<Fault> sensor_faults() {
  std::vector<Fault> list;
  values_not_finite(list);
  values_far_off(list);
  values_damaged(list);
  arrival(list);
  stamps(list);
  clocks(list);
  everything_at_once(list);
  return list;
}

}  // namespace tiller::faults
