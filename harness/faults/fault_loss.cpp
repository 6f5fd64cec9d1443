#include "harness/faults/fault_loss.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <new>

#include "harness/faults/fault_bus.hpp"
#include "tiller/config.hpp"

namespace tiller::faults {
namespace {

constexpr std::int64_t kEpoch_us = 1000000, kStep_us = 1000;
constexpr double kPi = 3.14159265358979323846, kUp_rad = 0.3;

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

/// Large enough to swing up, with timeouts for a bus that loses.
Setup lossy_setup(std::uint64_t seed) {
  Setup s = setup_of(Robot::kPendulum, seed);
  tiller::Config& c = s.config;
  c.planner.kind = tiller_planner_cem;
  c.planner.horizon = 60;  // with 50 steps of 128 rollouts one swing-up in ten ends beside gravity, on any bus
  c.planner.knots = 12;
  c.planner.rollouts = 256;
  c.planner.iterations = 3;
  c.safety.sensor_timeout_s = s.plant.watchdog_timeout_s = 0.2;
  s.heartbeat_timeout_us = 200000;
  return s;
}

/// Frames on their way, by when they arrive.
class Wire {
 public:
  Wire(const LossCase& loss, Random& random) : loss_(loss), random_(random) {}
  void put(const CanFrame& frame, std::int64_t now_us) {
    if (random_.chance(loss_.loss)) return;
    const double late_us = random_.uniform(0.0, static_cast<double>(loss_.jitter_us));
    frames_.emplace(now_us + static_cast<std::int64_t>(late_us), frame);
  }
  template <class Take>
  void arrive(std::int64_t now_us, const Take& take) {
    for (; !frames_.empty() && frames_.begin()->first <= now_us; frames_.erase(frames_.begin()))
      take(frames_.begin()->second);
  }

 private:
  const LossCase& loss_;
  Random& random_;
  std::multimap<std::int64_t, CanFrame> frames_;
};

class LossRun {
 public:
  LossRun(const LossCase& loss, std::uint64_t seed)
      : loss_(loss),
        setup_(lossy_setup(seed)),
        random_(seed * 31 + 7),
        plant_(sim::Plant::make(setup_.plant, error_)),
        device_(*plant_, setup_.plan_timeout_s),
        bus_(setup_, device_),
        to_controller_(loss, random_),
        to_plant_(loss, random_) {
    robot_.reset(bus_layout(setup_));
    const std::size_t size = tiller_size(&setup_.config);
    block_.reset(::operator new (size, std::align_val_t{TILLER_ALIGNMENT}));
    (void)tiller_init(&controller_, &setup_.config, nullptr, block_.get(), size);
    (void)tiller_arm(controller_);
    period_us_ = std::llround(setup_.config.period_s * 1e6);
  }

  LossOutcome go() {
    const auto end_us = static_cast<std::int64_t>(loss_.seconds * 1e6);
    for (std::int64_t t_us = 0; t_us < end_us; t_us += kStep_us) {
      now_us_ = kEpoch_us + t_us;
      if (t_us % period_us_ == 0) publish();
      to_controller_.arrive(now_us_, [&](const CanFrame& f) { (void)robot_.receive(f, now_us_); });
      control();
      to_plant_.arrive(now_us_, [&](const CanFrame& f) { bus_.deliver(f); });
      plant_->advance(1e-6 * kStep_us);
      bus_.watch();
      judge(t_us > end_us / 2);
    }
    out_.up = out_.up && judged_;
    return out_;
  }

 private:
  void publish() {
    tiller_measurement_t m{};
    m.stamp_us = now_us_;
    m.sequence = ++sequence_;
    plant_->measure(m.value);
    for (const CanFrame& f : bus_.frames(m)) to_controller_.put(f, now_us_);
  }

  void control() {
    tiller_measurement_t m{};
    const bool fresh = robot_.take(&m);
    const std::int64_t since_us = now_us_ - ticked_us_;
    if (!fresh && since_us < (missed_ ? period_us_ : period_us_ * 3 / 2)) return;
    missed_ = !fresh;
    if (fresh) {
      newest_us_ = m.stamp_us;
      m.command_latency_us = static_cast<std::uint32_t>(now_us_ - m.stamp_us + loss_.jitter_us / 2);
    } else {
      ++out_.missed;
    }
    ticked_us_ = now_us_;
    if (robot_.fault() != tiller_status_ok) (void)tiller_stop(controller_, robot_.fault());
    tiller_command_t command{};
    (void)tiller_tick(controller_, now_us_, fresh ? &m : nullptr, &command);
    note(command);
    CanFrame frames[CanRobot::kMaxFrames];
    const std::uint32_t count = robot_.command(command, frames);
    for (std::uint32_t i = 0; i < count; ++i) to_plant_.put(frames[i], now_us_);
  }

  void note(const tiller_command_t& command) {
    out_.safe = out_.safe || command.state == tiller_state_safe;
    const bool moving = command.state == tiller_state_active || command.state == tiller_state_hold;
    if (!moving || command.value[0] == 0.0) return;
    const double age_s = 1e-6 * static_cast<double>(now_us_ - newest_us_);
    out_.worst_age_s = std::max(out_.worst_age_s, age_s);
    if (age_s > setup_.config.safety.sensor_timeout_s + 1e-9) ++out_.stale;
  }

  void judge(bool second_half) {
    double state[2], force[1];
    plant_->true_state(state);
    plant_->motor(force);
    if (force[0] != 0.0)
      out_.worst_motor_age_s = std::max(out_.worst_motor_age_s, 1e-6 * static_cast<double>(now_us_ - newest_us_));
    if (!second_half) return;
    if (!judged_) out_.up = true;
    judged_ = true;
    const double off_rad = std::fabs(std::remainder(state[0] - kPi, 2.0 * kPi));
    out_.most_off_rad = std::max(out_.most_off_rad, off_rad);
    if (off_rad > kUp_rad) out_.up = false;
  }

  const LossCase& loss_;
  Setup setup_;
  Random random_;
  std::string error_;
  std::unique_ptr<sim::Plant> plant_;
  Device device_;
  BusPlant bus_;
  CanRobot robot_;
  Wire to_controller_, to_plant_;
  std::unique_ptr<void, AlignedFree> block_;
  tiller_t* controller_ = nullptr;
  LossOutcome out_;
  std::int64_t now_us_ = 0, period_us_ = 0, ticked_us_ = kEpoch_us, newest_us_ = kEpoch_us;
  std::uint32_t sequence_ = 0;
  bool missed_ = false, judged_ = false;
};

}  // namespace

LossOutcome run_loss(const LossCase& loss, std::uint64_t seed) { return LossRun(loss, seed).go(); }

}  // namespace tiller::faults
