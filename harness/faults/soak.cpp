#include "harness/faults/soak.hpp"

#include <link.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <new>

#include "harness/faults/fault_world.hpp"
#include "io/memory_transport.hpp"
#include "tiller/config.hpp"

namespace tiller::faults {
namespace {

constexpr double kPi = 3.14159265358979323846, kPeriod_s = 0.01;

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

/// A bob on a massless rod, angle 0 hangs.
struct Bob {
  double mass_kg = 0.45, length_m = 0.5, damping_Nms = 0.05, push_Nm = 0.0;
  double x[2] = {kPi, 0.0};

  void derivative(const double* s, double torque_Nm, double* dxdt) const {
    dxdt[0] = s[1];
    dxdt[1] =
        (torque_Nm + push_Nm - damping_Nms * s[1]) / (mass_kg * length_m * length_m) - 9.81 / length_m * std::sin(s[0]);
  }
  void step(double torque_Nm, double h) {
    double k[4][2], at[2];
    derivative(x, torque_Nm, k[0]);
    for (int i = 1; i < 4; ++i) {
      const double reach = i == 3 ? h : 0.5 * h;
      at[0] = x[0] + reach * k[i - 1][0];
      at[1] = x[1] + reach * k[i - 1][1];
      derivative(at, torque_Nm, k[i]);
    }
    for (int i = 0; i < 2; ++i) x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
  }
};

tiller::Config upright(bool eventful) {
  Setup s = setup_of(Robot::kPendulum, 1);
  tiller::Config& c = s.config;
  c.period_s = kPeriod_s;
  c.initial_state[0] = kPi;
  c.posterior.particles = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.kind = tiller_planner_mppi;
  c.planner.horizon = 20;
  c.planner.knots = 5;
  c.planner.rollouts = 32;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  c.cost.terminal = tiller_terminal_lqr;
  c.record_ticks = 16;
  c.posterior.relearn = c.posterior.disturbance = eventful ? 1 : 0;
  return c;
}

struct Resident {
  std::int64_t all = 0, of_files = 0;  // bytes; the rest is the process's own: heap, stacks, written data
};

Resident resident() {
  char text[256] = {};
  std::FILE* file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr) return {};
  const char* read = std::fgets(text, sizeof text, file);
  std::fclose(file);
  if (read == nullptr) return {};
  char* at = text;
  (void)std::strtoll(at, &at, 10);  // of the address space
  const std::int64_t all = std::strtoll(at, &at, 10), of_files = std::strtoll(at, &at, 10);
  const std::int64_t page = sysconf(_SC_PAGESIZE);
  return {all * page, of_files * page};
}

/// Reads a byte of every page of the program and its libraries. The kernel maps a file's pages when they are first
/// touched, 16 around each (fault_around_bytes), so a branch that runs for the first time after hours would be counted
/// as 64 KiB of growth; a robot that calls mlockall has them all from the start. Between the variables as well, which
/// AddressSanitizer takes for a mistake elsewhere.
__attribute__((no_sanitize_address)) int touch_segments(dl_phdr_info* object, std::size_t, void* sum) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (int i = 0; i < object->dlpi_phnum; ++i) {
    const ElfW(Phdr)& segment = object->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_R) == 0) continue;
    const auto* bytes = reinterpret_cast<const volatile unsigned char*>(object->dlpi_addr + segment.p_vaddr);
    for (std::size_t at = 0; at < segment.p_filesz; at += page) *static_cast<unsigned*>(sum) += bytes[at];
  }
  return 0;
}
void touch_program() {
  unsigned sum = 0;
  dl_iterate_phdr(touch_segments, &sum);
}
std::int64_t heap_bytes() { return static_cast<std::int64_t>(mallinfo2().uordblks); }

/// FNV-1a.
void hash_bits(std::uint64_t& hash, double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  for (int i = 0; i < 8; ++i) hash = (hash ^ (bits >> (8 * i) & 0xff)) * 1099511628211ull;
}

/// The stamp and the value of a reading on its way, whether there is one, and the tick's clock.
struct Reading {
  std::int64_t now_us = 0, stamp_us = 0;
  double angle_rad = 0.0;
  bool sent = true;
};

/// What happens to robot and readings, one event after the other.
class Events {
 public:
  Events(tiller_t* controller, const tiller::Config& config, Bob& bob, SoakOutcome& out)
      : controller_(controller), config_(config), bob_(bob), out_(out), random_(12) {}

  /// Before a tick.
  void disturb(Reading& reading, std::uint32_t state) {
    if (wait_ == 0) begin();
    --wait_;
    host(state);
    if (age_ < kLongest) act(age_++, reading);
    reading.now_us += clock_us_;
    reading.stamp_us += clock_us_;
  }
  void judge(const tiller_command_t& command) {
    const double u = command.value[0];
    const tiller_safety_config_t& limits = config_.safety;
    const bool within = std::isfinite(u) && u >= limits.input_low[0] && u <= limits.input_high[0];
    const bool safe = command.state != tiller_state_safe || u == limits.safe_command[0];
    if (!within || !safe) ++out_.unsafe;
    tiller_info_t info;
    tiller_get_info(controller_, &info);
    const double* const believed[] = {info.param_mean, info.param_sd, info.state_mean};
    for (const double* values : believed)
      if (!std::isfinite(values[0]) || !std::isfinite(values[1])) ++out_.not_finite;
    out_.relearned = info.relearned;
    const double off = std::remainder(bob_.x[0] - kPi, 2.0 * kPi);
    calm_ = command.state == tiller_state_active && std::fabs(off) < kNear_rad;
  }

 private:
  static constexpr std::uint32_t kLongest = 200;  // ticks of an event
  static constexpr std::uint32_t kPause = 600;    // and at least until the next: to be reset and to swing into place
  static constexpr double kNear_rad = 0.3;

  void begin() {
    if (begun_ > 0 && !calm_) ++out_.unrecovered;
    constexpr auto kKinds = static_cast<std::uint32_t>(SoakEvent::count);
    event_ = static_cast<SoakEvent>(begun_ < kKinds ? begun_ : random_.below(kKinds));  // each once, then by chance
    ++begun_;
    ++out_.events[static_cast<int>(event_)];
    wait_ = kLongest + kPause + random_.below(200);
    age_ = 0;
  }

  /// Whoever looks after the robot: after SAFE or a disarming it puts the bob upright, resets and arms.
  void host(std::uint32_t state) {
    const bool stands = state == tiller_state_safe || (state == tiller_state_standby && age_ > 100);
    still_ = stands ? still_ + 1 : 0;
    if (still_ < 50) return;
    still_ = 0;
    bob_.x[0] = kPi;
    bob_.x[1] = 0.0;
    if (state == tiller_state_safe) {
      ++out_.resets;
      (void)tiller_reset(controller_);
    }
    (void)tiller_arm(controller_);
  }

  void act(std::uint32_t age, Reading& reading) {
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    switch (event_) {
      case SoakEvent::drifting_clock: reading.stamp_us -= 70 * static_cast<std::int64_t>(age); break;
      case SoakEvent::stamps_back:
        if (age < 2) reading.stamp_us -= 5000000;
        break;
      case SoakEvent::clocks_ahead:
        if (age == 0) clock_us_ += 3600000000;
        break;
      case SoakEvent::clocks_back:
        if (age == 0) clock_us_ -= 60000000;
        break;
      case SoakEvent::short_silence: reading.sent = age >= 5; break;
      case SoakEvent::long_silence: reading.sent = age >= 50; break;
      case SoakEvent::other_mass:
        if (age == 0) bob_.mass_kg = random_.uniform(0.35, 0.6);
        break;
      case SoakEvent::push:
        if (age == 0) bob_.push_Nm = random_.sign() * random_.uniform(0.05, 0.4);
        if (age == kLongest - 1) bob_.push_Nm = 0.0;
        break;
      case SoakEvent::not_a_number:
        if (age == 0) reading.angle_rad = kNaN;
        if (age == 1) reading.angle_rad = std::numeric_limits<double>::infinity();
        break;
      case SoakEvent::spike:
        if (age == 0) reading.angle_rad += 1.0;
        break;
      case SoakEvent::disarmed:
        if (age == 0) (void)tiller_disarm(controller_);
        break;
      case SoakEvent::stopped:
        if (age == 0) (void)tiller_stop(controller_, tiller_status_actuator_fault);
        break;
      case SoakEvent::other_goal: aim(age == kLongest - 1 ? kPi : kPi + 0.1); break;
      case SoakEvent::bad_calls: call_badly(); break;
      case SoakEvent::count: break;
    }
  }

  void aim(double angle_rad) {
    const double target[2] = {angle_rad, 0.0};
    (void)tiller_set_target(controller_, target);
  }
  void call_badly() {
    const double bad[2] = {std::numeric_limits<double>::quiet_NaN(), 0.0};
    double value = 0.0;
    const bool refused = tiller_set_target(controller_, bad) != tiller_status_ok &&
                         tiller_set_target(controller_, nullptr) != tiller_status_ok &&
                         tiller_get_quantile(controller_, 99, 0.5, &value) != tiller_status_ok &&
                         tiller_set_reference(controller_, nullptr, nullptr, 0) != tiller_status_ok;
    if (!refused) ++out_.taken;
  }

  tiller_t* controller_;
  const tiller::Config& config_;
  Bob& bob_;
  SoakOutcome& out_;
  Random random_;
  SoakEvent event_ = SoakEvent::count;
  std::uint32_t wait_ = 1000, age_ = kLongest, still_ = 0;  // the first event after ten seconds
  std::int64_t clock_us_ = 0;
  std::uint64_t begun_ = 0;
  bool calm_ = false;
};

class Soak {
 public:
  explicit Soak(const SoakCase& soak) : soak_(soak), config_(upright(soak.eventful)), random_(11) {
    const std::size_t size = tiller_size(&config_);
    block_.reset(::operator new (size, std::align_val_t{TILLER_ALIGNMENT}));
    (void)tiller_init(&controller_, &config_, nullptr, block_.get(), size);
    (void)tiller_arm(controller_);
    out_.hash = 14695981039346656037ull;
    if (soak.eventful) events_ = std::make_unique<Events>(controller_, config_, bob_, out_);
  }

  SoakOutcome go() {
    std::int64_t heap = 0;
    Resident before;
    for (std::uint64_t k = 0; k < soak_.ticks; ++k) {
      if (k == std::min<std::uint64_t>(1000, soak_.ticks / 2)) {
        touch_program();
        before = resident();
        heap = heap_bytes();  // after the other, whose file leaves a buffer in the allocator's cache
      }
      one(k);
    }
    const Resident after = resident();
    out_.resident_growth_bytes = after.all - before.all;
    out_.own_growth_bytes = out_.resident_growth_bytes - (after.of_files - before.of_files);
    out_.heap_growth_bytes = heap_bytes() - heap;
    return out_;
  }

 private:
  void one(std::uint64_t k) {
    Reading reading;
    reading.now_us = reading.stamp_us =
        soak_.first_stamp_us + static_cast<std::int64_t>(k) * std::llround(kPeriod_s * 1e6);
    reading.angle_rad = bob_.x[0] + 0.002 * noise();
    if (events_) events_->disturb(reading, state_);
    tiller_measurement_t m{}, read{};
    m.stamp_us = reading.stamp_us;
    m.sequence = soak_.first_sequence + static_cast<std::uint32_t>(k);
    m.value[0] = reading.angle_rad;
    if (reading.sent) (void)memory_put_measurement(&transport_, m);
    const bool fresh = kMemoryTransport.poll(&transport_, &read) == tiller_status_ok;
    tiller_command_t command{}, taken{};
    const tiller_status_t status = tiller_tick(controller_, reading.now_us, fresh ? &read : nullptr, &command);
    (void)kMemoryTransport.send(&transport_, &command);
    if (!memory_take_command(&transport_, taken) || (!events_ && taken.sequence != m.sequence)) ++out_.unanswered;
    judge(k, status, taken);
    for (int i = 0; i < 5; ++i) bob_.step(taken.value[0], kPeriod_s / 5);
  }

  void judge(std::uint64_t k, tiller_status_t status, const tiller_command_t& command) {
    ++out_.ticks;
    hash_bits(out_.hash, command.value[0]);
    if (events_) events_->judge(command);
    state_ = command.state;
    if (status >= 1 && status < 200) {
      ++out_.faults;
      if (out_.first_fault == tiller_status_ok) out_.first_fault = status;
    }
    if (command.state != tiller_state_active) ++out_.not_active;
    if (k > 100) out_.worst_angle_rad = std::max(out_.worst_angle_rad, std::fabs(bob_.x[0] - kPi));
  }

  /// Near enough to normal for a sensor: a sum of four uniforms.
  double noise() {
    double sum = 0.0;
    for (int i = 0; i < 4; ++i) sum += random_.uniform(-1.0, 1.0);
    return sum * 0.8660254037844386;
  }

  SoakCase soak_;
  tiller::Config config_;
  Random random_;
  Bob bob_;
  MemoryTransport transport_;
  std::unique_ptr<void, AlignedFree> block_;
  tiller_t* controller_ = nullptr;
  SoakOutcome out_;
  std::unique_ptr<Events> events_;  // null: nothing happens
  std::uint32_t state_ = tiller_state_init;
};

}  // namespace

const char* name_of(SoakEvent event) {
  static const char* const names[] = {"drifting clock", "stamps back", "clocks ahead", "clocks back",  "short silence",
                                      "long silence",   "other mass",  "push",         "not a number", "spike",
                                      "disarmed",       "stopped",     "other goal",   "bad calls"};
  static_assert(sizeof names / sizeof *names == static_cast<int>(SoakEvent::count));
  return names[static_cast<int>(event)];
}

SoakOutcome run_soak(const SoakCase& soak) { return std::make_unique<Soak>(soak)->go(); }

}  // namespace tiller::faults
