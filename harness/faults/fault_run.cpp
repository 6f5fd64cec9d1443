#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

#include "harness/faults/fault_link.hpp"

namespace tiller::faults {
namespace {

constexpr std::int64_t kEpoch_us = 1000000;  // no stamp is zero or negative

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

double broken_cost(const double*, const double*, const double*, double, void* context) {
  return static_cast<const World*>(context)->cost;
}

struct Clock {
  const World* world = nullptr;
  std::int64_t ns = 0;
};

std::int64_t turned_clock(void* context) {
  auto* clock = static_cast<Clock*>(context);
  clock->ns += clock->world->clock_step_ns;
  return clock->ns;
}

/// True values of the last while, without noise: a reading that agrees with none of it is not genuine.
class Truth {
 public:
  Truth(const tiller_config_t& config, std::size_t rows, double sd) : config_(config), rows_(rows), sd_(sd) {}

  void push(const double* clean) {
    history_.emplace_back(clean, clean + config_.measurement_count);
    if (history_.size() > rows_) history_.erase(history_.begin());
  }
  bool knows(const tiller_measurement_t& m) const {
    return std::any_of(history_.begin(), history_.end(),
                       [&](const std::vector<double>& row) { return agrees(m, row); });
  }

 private:
  bool agrees(const tiller_measurement_t& m, const std::vector<double>& row) const {
    for (std::size_t i = 0; i < row.size(); ++i)
      if (!(std::fabs(m.value[i] - row[i]) <= sd_ * config_.measurement_sd[i])) return false;
    return true;
  }
  const tiller_config_t& config_;
  std::size_t rows_;
  double sd_;
  std::vector<std::vector<double>> history_;
};

class Run {
 public:
  Run(const Fault& fault, Robot robot, std::uint64_t seed)
      : fault_(fault),
        world_(prepared(fault, robot, seed), seed * 7919 + 13),
        truth_(world_.setup.config, 6, fault.genuine_sd) {}

  Outcome go() {
    if (!begin()) return outcome_;
    const std::int64_t limit_us = timeout_us(fault_.timeout, world_.setup) + 2 * world_.period_us;
    // 0.5..2 s: while it swings up, or stands
    const auto onset = static_cast<int>(25 + world_.random.below(world_.setup.latest_onset_ticks - 24));
    const auto periods = static_cast<int>(limit_us / world_.period_us) + 50;
    for (int k = 0; k < onset; ++k) period(nullptr);
    // a kind that may stop by chance and is there from the start may have done so
    if (fault_.end != End::kBounded && command_.state != tiller_state_active)
      wrong("it was not in motion before the fault");
    for (int k = 0; k < periods; ++k) {
      world_.ticks = k;
      const bool on = k < fault_.lasts_ticks;
      if (on && fault_.step != nullptr) fault_.step(world_);
      period(on ? &fault_ : nullptr);
      judge_motor((k + 1) * world_.period_us, limit_us);
    }
    judge_end();
    return outcome_;
  }

 private:
  static Setup prepared(const Fault& fault, Robot robot, std::uint64_t seed) {
    Setup setup = setup_of(robot, seed);
    if (fault.prepare != nullptr) fault.prepare(setup);
    return setup;
  }

  bool begin() {
    Setup& s = world_.setup;
    std::string error;
    plant_ = sim::Plant::make(s.plant, error);
    if (!plant_) return fail("the plant cannot be made");
    device_ = std::make_unique<Device>(*plant_, s.plan_timeout_s);
    switch (fault_.route) {
      case Route::kMemory: link_ = make_memory_link(s, *device_); break;
      case Route::kBus: link_ = make_bus_link(s, *device_); break;
      case Route::kLcm: link_ = make_lcm_link(s, *device_); break;
      case Route::kSocket: link_ = fault_.link(s, *device_); break;
    }
    own_ = {sizeof own_, TILLER_CONFIG_VERSION, broken_cost, nullptr, &world_};
    if (s.own_cost) {
      s.config.cost.own = &own_;
      s.config.cost.own_weight = 1.0;
    }
    clock_.world = &world_;
    hooks_.size = sizeof hooks_;
    hooks_.version = TILLER_CONFIG_VERSION;
    hooks_.context = &clock_;
    hooks_.now_ns = turned_clock;
    if (s.clock) s.config.planner.deadline_us = 5000;
    const std::size_t size = tiller_size(&s.config);
    if (size == 0) return fail("the configuration is refused");
    block_.reset(::operator new (size, std::align_val_t{TILLER_ALIGNMENT}));
    if (tiller_init(&world_.controller, &s.config, s.clock ? &hooks_ : nullptr, block_.get(), size) != tiller_status_ok)
      return fail("init fails");
    world_.period_us = std::llround(s.config.period_s * 1e6);
    (void)tiller_arm(world_.controller);
    return true;
  }
  bool fail(const char* why) {
    outcome_.wrong = why;
    return false;
  }
  void wrong(const char* why) {
    if (outcome_.wrong != nullptr) return;
    outcome_.wrong = why;
    outcome_.wrong_s = world_.ticks * world_.setup.config.period_s;
  }

  void period(const Fault* fault) {
    const tiller_measurement_t genuine = read();
    tiller_measurement_t m{};
    bool fresh = link_->sense(world_, fault, genuine, m);
    // nobody reads while the controller hangs, nor through a transport that has failed
    if (link_->fault(world_) != tiller_status_ok) fresh = false;
    if (!world_.hung) {
      tick(fresh ? &m : nullptr);
      if (!world_.command_lost) link_->send(world_, fault, command_);
    } else if (world_.repeater) {
      if (world_.repeater_answers) command_.sequence = genuine.sequence;
      link_->send(world_, fault, command_);
    }
    world_.command_lost = false;
    plant_->advance(world_.setup.config.period_s);
    link_->after_period();
    if (const char* why = link_->wrong()) wrong(why);
  }

  tiller_measurement_t read() {
    world_.now_us = kEpoch_us + plant_->time_us();
    tiller_measurement_t m{};
    m.stamp_us = kEpoch_us + plant_->measured_us();
    m.sequence = ++sequence_;
    plant_->measure(m.value);
    double clean[TILLER_MAX_MEASUREMENTS];
    plant_->measure_clean(clean);
    truth_.push(clean);
    world_.past.push_back(m);
    if (world_.past.size() > 32) world_.past.pop_front();
    return m;
  }

  void tick(const tiller_measurement_t* m) {
    const tiller_status_t transport = link_->fault(world_);
    if (transport != tiller_status_ok && command_.state != tiller_state_safe)
      (void)tiller_stop(world_.controller, transport);
    if (!world_.clock_stands) told_us_ = world_.now_us + world_.clock_offset_us;
    const tiller_command_t before = command_;
    (void)tiller_tick(world_.controller, told_us_, m, &command_);
    judge_command(before);
    if (m != nullptr && truth_.knows(*m)) good_us_ = world_.now_us;
  }

  bool moving() const { return command_.state == tiller_state_active || command_.state == tiller_state_hold; }

  /// Every command: finite, within its limits and, while in motion, within its rate; else the safe command itself.
  void judge_command(const tiller_command_t& before) {
    const tiller_safety_config_t& s = world_.setup.config.safety;
    for (std::uint32_t i = 0; i < world_.setup.config.model->input_count; ++i) {
      const double u = command_.value[i];
      if (!(u >= s.input_low[i] && u <= s.input_high[i])) wrong("a command beyond its limits");
      const double step = s.input_rate_per_s[i] * (world_.setup.config.period_s + 1e-6) + 1e-12;
      if (moving() && !(std::fabs(u - before.value[i]) <= step)) wrong("a command beyond its rate");
      if (!moving() && u != s.safe_command[i]) wrong("not in motion, and not the safe command");
    }
    if (before.state == tiller_state_safe && command_.state != tiller_state_safe)
      wrong("SAFE was left without a reset");
  }

  void judge_motor(std::int64_t since_us, std::int64_t limit_us) {
    double force[TILLER_MAX_INPUTS] = {};
    plant_->motor(force);
    const bool drives = force[0] != world_.setup.config.safety.safe_command[0];
    if (drives) last_force_us_ = since_us;
    if (drives && fault_.end == End::kStops && since_us > limit_us)
      wrong("the motor was still driven after the timeout");
    // whatever the kind: nothing drives the motor for long that no genuine reading has confirmed
    if (drives && world_.now_us - good_us_ > limit_us) wrong("driven without a genuine reading for too long");
  }

  void judge_end() {
    const tiller_info_t info = world_.info();
    outcome_.state = static_cast<tiller_state_t>(info.state);
    outcome_.status = static_cast<tiller_status_t>(info.first_fault);
    double force[TILLER_MAX_INPUTS] = {};
    plant_->motor(force);
    if (force[0] == world_.setup.config.safety.safe_command[0])
      outcome_.stopped_s = static_cast<double>(last_force_us_) * 1e-6;
    if (fault_.end == End::kRides && outcome_.state != tiller_state_active) wrong("it did not stay in motion");
    if (fault_.noticed != nullptr && !fault_.noticed(world_, info) && link_->refused() == 0) wrong("it went unnoticed");
  }

  const Fault& fault_;
  World world_;
  Truth truth_;
  Outcome outcome_;
  std::unique_ptr<sim::Plant> plant_;
  std::unique_ptr<Device> device_;
  std::unique_ptr<Link> link_;
  std::unique_ptr<void, AlignedFree> block_;
  tiller_own_cost_t own_{};
  tiller_hooks_t hooks_{};
  Clock clock_;
  tiller_command_t command_{};
  std::uint32_t sequence_ = 0;
  std::int64_t told_us_ = 0, good_us_ = kEpoch_us, last_force_us_ = 0;
};

}  // namespace

std::int64_t timeout_us(Timeout timeout, const Setup& setup) {
  const tiller_config_t& c = setup.config;
  const auto us = [](double seconds) { return static_cast<std::int64_t>(std::llround(seconds * 1e6)); };
  const std::uint32_t half_horizon = c.planner.horizon / 2;
  switch (timeout) {
    case Timeout::kNow: return 0;
    case Timeout::kSensor: return us(c.safety.sensor_timeout_s);
    case Timeout::kBadTicks: return us(c.safety.bad_ticks_to_safe * c.period_s);
    case Timeout::kUntaken: return us(2.0 * c.safety.bad_ticks_to_safe * c.period_s);
    case Timeout::kFrozen: return us(2.0 * c.safety.frozen_ticks * c.period_s);
    case Timeout::kHold: return us(c.safety.hold_ticks_to_safe * c.period_s);
    case Timeout::kLatePlans: return us((half_horizon + c.safety.hold_ticks_to_safe) * c.period_s);
    case Timeout::kHeartbeat: return setup.heartbeat_timeout_us;
    case Timeout::kWatchdog: return us(setup.plant.watchdog_timeout_s);
    case Timeout::kPlanWatch: return us(setup.plan_timeout_s + setup.plant.watchdog_timeout_s);
  }
  return 0;
}

const char* name_of(Timeout timeout) {
  static constexpr const char* kNames[] = {"at once",
                                           "sensor_timeout_s",
                                           "bad_ticks_to_safe",
                                           "2 x bad_ticks_to_safe",
                                           "2 x frozen_ticks",
                                           "hold_ticks_to_safe",
                                           "horizon / 2 + hold_ticks_to_safe",
                                           "heartbeat_timeout_s",
                                           "the device's watchdog",
                                           "the device's plan timeout"};
  return kNames[static_cast<int>(timeout)];
}

const std::vector<Fault>& all_faults() {
  static const std::vector<Fault> all = [] {
    std::vector<Fault> list;
    for (const auto& part :
         {sensor_faults(), planner_faults(), device_faults(), bus_faults(), drive_faults(), lcm_faults()})
      list.insert(list.end(), part.begin(), part.end());
    return list;
  }();
  return all;
}

Outcome run_fault(const Fault& fault, Robot robot, std::uint64_t seed) { return Run(fault, robot, seed).go(); }

}  // namespace tiller::faults
