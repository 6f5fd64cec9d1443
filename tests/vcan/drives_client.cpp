// The SocketCAN transport as a process, with three motors of three protocols; the motors are drives.py, another
// process. Both know the numbers of every step: command(motor, step) from here, position, velocity and torque from
// there. The drives compare every frame with that of another encoder; here every value must be the one that was
// encoded. Usage: drives_client INTERFACE STEPS
#include <poll.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "io/socketcan_transport.hpp"

namespace {

using namespace tiller;

constexpr double kTurn = 6.283185307179586;
constexpr std::uint32_t kMotors = 3;
constexpr MitRange kRange;

double command(std::uint32_t motor, int step) { return (1.5 + motor) * std::sin(0.1 * step + motor); }
double position(std::uint32_t motor, int step) { return (0.5 + 0.25 * motor) * std::sin(0.05 * step + motor); }
double velocity(std::uint32_t motor, int step) { return (0.5 + 0.25 * motor) * std::cos(0.05 * step + motor); }
double torque(std::uint32_t motor, int step) { return 0.25 * command(motor, step); }

/// What drives.py does with the same name.
struct Variant {
  const char* name;
  ActuatorMode mode;
  MoteusResolution resolution;
  double position_step, velocity_step, torque_step;  ///< of the moteus' integers; 0: floats
  MitReply reply;
  std::uint32_t fails;  ///< the motor that reports a fault in the end
  const char* fault;    ///< and what is said of it
};

constexpr Variant kVariants[] = {
    {"torque", ActuatorMode::torque, MoteusResolution::int16, 1e-4, 0.00025, 0.01, MitReply::damiao, 2,
     "mit: the watchdog has expired"},
    {"velocity", ActuatorMode::velocity, MoteusResolution::f32, 0, 0, 0, MitReply::ak, 1, "moteus: motor driver fault"},
    {"position", ActuatorMode::position, MoteusResolution::int32, 1e-5, 1e-5, 1e-3, MitReply::plain, 0,
     "odrive: the watchdog has expired"},
};

// ---- what is left of a number that has travelled ----

double as_float(double value) { return static_cast<double>(static_cast<float>(value)); }
double as_integer(double value, double step) { return step > 0 ? std::trunc(value / step) * step : as_float(value); }
double as_bits(double value, double limit, int bits) {
  const double top = static_cast<double>((1 << bits) - 1);
  return std::ceil((value + limit) * top / (2 * limit) - 0.5) * 2 * limit / top - limit;
}

struct Motion {
  double position_rad, velocity_rad_s, torque_Nm;
};

Motion told(const Variant& variant, std::uint32_t motor, int step) {
  const double p = position(motor, step), v = velocity(motor, step), t = torque(motor, step);
  switch (motor) {
    case 0: return {as_float(p / kTurn) * kTurn, as_float(v / kTurn) * kTurn, as_float(t)};
    case 1:
      return {as_integer(p / kTurn, variant.position_step) * kTurn,
              as_integer(v / kTurn, variant.velocity_step) * kTurn, as_integer(t, variant.torque_step)};
    default:
      return {as_bits(p, kRange.position_rad, 16), as_bits(v, kRange.velocity_rad_s, 12),
              as_bits(t, kRange.torque_Nm, 12)};
  }
}

// ---- the robot ----

SocketCanOptions robot(const char* interface, const Variant& variant) {
  SocketCanOptions options;
  options.interface = interface;
  options.confirm_timeout_us = 0;  // an emulated machine may stand still for longer
  CanLayout& layout = options.layout;
  layout.motor_count = kMotors;
  layout.sensor_node = CanLayout::kNoBoard;
  const ActuatorKind kinds[] = {ActuatorKind::odrive, ActuatorKind::moteus, ActuatorKind::mit};
  for (std::uint8_t i = 0; i < kMotors; ++i) {
    CanMotor& motor = layout.motors[i];
    motor.node = 3u + i;
    motor.wheel_radius_m = 1.0;
    motor.entry_rate_per_s = 1e9;  // the first command after the drive's consent is the whole one
    motor.drive.kind = kinds[i];
    motor.drive.mode = variant.mode;
    layout.channels[layout.channel_count++] = {CanSource::kMotorPosition, i};
    layout.channels[layout.channel_count++] = {CanSource::kMotorVelocity, i};
  }
  layout.motors[1].drive.resolution = variant.resolution;
  layout.motors[2].drive.reply = variant.reply;
  layout.motors[2].drive.kp_Nm_rad = 20.0;
  layout.motors[2].drive.kd_Nms_rad = 0.5;
  layout.heartbeat_timeout_us = 0;
  return options;
}

class Client {
 public:
  Client(const char* interface, const Variant& variant, int steps) : variant_(variant), steps_(steps) {
    OpenError error;
    if (socketcan_open(&transport_, robot(interface, variant), &error) != tiller_status_ok) fail(error.text);
  }
  ~Client() { kSocketCanTransport.close(&transport_); }

  void run() {
    for (step_ = 0; step_ <= steps_; ++step_) {
      if (sense() != tiller_status_ok) fail(socketcan_fault_text(&transport_));
      check();
      const tiller_status_t told = send(tiller_state_active);
      // a fault is told by the poll that reads it, whoever reports it: the ODrive does so unasked, a step later
      const bool due = step_ == steps_ && variant_.fails != 0;
      if (told != (due ? tiller_status_actuator_fault : tiller_status_no_new_measurement)) fail("fault or no fault?");
    }
    if (sense() != tiller_status_actuator_fault) fail("no fault");
    const char* text = socketcan_fault_text(&transport_);
    if (text == nullptr || std::strstr(text, variant_.fault) != text) fail(text != nullptr ? text : "another fault");
    (void)send(tiller_state_safe);
    report(text);
  }

 private:
  [[noreturn]] void fail(const char* what) const {
    std::fprintf(stderr, "drives_client: %s, step %d: %s\n", variant_.name, step_, what);
    std::exit(1);
  }

  void wait() const {
    pollfd wanted = {transport_.socket, POLLIN, 0};
    (void)::poll(&wanted, 1, 100);
  }

  /// Asks, and waits for the measurement or a fault.
  tiller_status_t sense() {
    if (socketcan_ask(&transport_) != tiller_status_ok) fail("cannot ask");
    for (int i = 0; i < 600; ++i) {
      const tiller_status_t status = kSocketCanTransport.poll(&transport_, &measurement_);
      if (status != tiller_status_no_new_measurement && (status == tiller_status_ok || odrive_was_heard()))
        return status;
      wait();
    }
    fail("no measurement");
  }
  /// After a fault of the others the ODrive still speaks its part, which belongs to the step.
  bool odrive_was_heard() const { return transport_.counters.received >= answered_ + 5; }

  void check() {
    for (std::uint32_t i = 0; i < kMotors; ++i) {
      const Motion wanted = told(variant_, i, step_);
      equal(i, "position", measurement_.value[2 * i], wanted.position_rad);
      equal(i, "velocity", measurement_.value[2 * i + 1], wanted.velocity_rad_s);
      equal(i, "torque", transport_.robot.motor(i).torque_Nm, wanted.torque_Nm);
      values_ += 3;
    }
  }
  void equal(std::uint32_t motor, const char* what, double is, double wanted) const {
    if (std::fabs(is - wanted) <= 1e-13 * kRange.velocity_rad_s) return;  // the last bits of a double
    std::fprintf(stderr, "motor %u: %s %.17g instead of %.17g\n", motor, what, is, wanted);
    fail("a value is wrong");
  }

  /// Returns what the last poll said once the answers are here.
  tiller_status_t send(tiller_state_t state) {
    tiller_command_t out{};
    out.stamp_us = 20000 * (step_ + 1);
    out.sequence = static_cast<std::uint32_t>(step_);
    out.state = state;
    for (std::uint32_t i = 0; i < kMotors && state == tiller_state_active; ++i) out.value[i] = command(i, step_);
    // moteus and MIT answer each frame; a period later than this on a robot, here before the next question
    const bool enters =
        step_ == 0 || (variant_.reply != MitReply::damiao && step_ < static_cast<int>(ActuatorAxis::kBlindRequests));
    answered_ = transport_.counters.received + (enters ? 3 : 2);
    const tiller_status_t status = kSocketCanTransport.send(&transport_, &out);
    if (status != tiller_status_ok) fail(tiller_status_text(status));
    tiller_status_t told = tiller_status_no_new_measurement;
    for (int i = 0; i < 600 && state == tiller_state_active && transport_.counters.received < answered_; ++i) {
      wait();
      told = kSocketCanTransport.poll(&transport_, &measurement_);
    }
    return told;
  }

  void report(const char* text) const {
    const SocketCanCounters& bus = transport_.bus_counters;
    tiller_transport_counters_t counters;
    kSocketCanTransport.counters(&transport_, &counters);
    if (counters.bad_messages + counters.overflows + bus.foreign + bus.held_back != 0) fail("frames were lost");
    std::printf("drives_client: %s: %d steps, %d values as encoded, %llu set points confirmed, fault: %s\n",
                variant_.name, steps_, values_, static_cast<unsigned long long>(bus.confirmed), text);
  }

  Variant variant_;
  int steps_, step_ = -1, values_ = 0;
  std::uint64_t answered_ = 0;
  SocketCanTransport transport_;
  tiller_measurement_t measurement_{};
};

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) return 2;
  for (const Variant& variant : kVariants) Client(arguments[1], variant, std::atoi(arguments[2])).run();
  return 0;
}
