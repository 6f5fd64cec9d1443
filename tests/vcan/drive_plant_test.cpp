// The plant of `tiller sim` behind emulated drives of each protocol on one thread, the SocketCAN transport on another,
// a virtual CAN bus in between. In lockstep, so the machine's speed does not matter.
#include <gtest/gtest.h>
#include <poll.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <thread>
#include <vector>

#include "io/socketcan_transport.hpp"
#include "sim/plant/plant.hpp"
#include "sim/servers/serve_can.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kPeriods = 100;
constexpr double kRange_Nm = 2.0;

struct Kind {
  ActuatorKind kind;
  MitReply reply;
  const char* protocol;
  const char* reply_name;
  double step_Nm;  ///< largest error of a torque on its way
};

/// Every protocol of actuators.def; of MIT's dialects the one that reports most.
std::vector<Kind> every_kind() {
  std::vector<Kind> kinds;
  for (int i = 0; i < static_cast<int>(ActuatorKind::count); ++i) {
    const auto kind = static_cast<ActuatorKind>(i);
    const bool range = (actuator_protocol(kind).capabilities & kEndsAtRange) != 0;
    kinds.push_back({kind, MitReply::damiao, actuator_name(kind).word, "damiao", range ? kRange_Nm / 4095 : 1e-6});
  }
  return kinds;
}

std::unique_ptr<sim::Plant> pendulum(double watchdog_s) {
  sim::PlantOptions options;
  options.kind = "pendulum";
  options.watchdog_timeout_s = watchdog_s;
  std::string error;
  auto plant = sim::Plant::make(options, error);
  EXPECT_NE(plant, nullptr) << error;
  return plant;
}

SocketCanOptions robot(const Kind& kind) {
  SocketCanOptions options;
  options.interface = "vcan0";
  options.confirm_timeout_us = 0;
  CanLayout& layout = options.layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = 3;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.motors[0].drive.kind = kind.kind;
  layout.motors[0].drive.reply = kind.reply;
  layout.motors[0].drive.range.torque_Nm = kRange_Nm;
  if ((actuator_protocol(kind.kind).capabilities & (kSpeaksUnasked | kAnswersQueries)) != 0)
    layout.channels[layout.channel_count++] = {CanSource::kMotorPosition, 0};
  return options;
}

double torque_Nm(std::uint32_t sequence) { return 1.5 * std::sin(0.2 * sequence); }

class Loop {
 public:
  explicit Loop(const Kind& kind) : plant_(pendulum(0.1)) {
    OpenError error;
    EXPECT_EQ(tiller_status_ok, socketcan_open(&transport, robot(kind), &error)) << error.text;
    sim::CanOptions can;
    can.drive.protocol = kind.protocol;
    can.drive.reply = kind.reply_name;
    can.drive.node = 3;
    can.drive.torque_Nm = kRange_Nm;
    sim::ServeOptions options;
    options.duration_s = 0.02 * kPeriods;
    options.answer_timeout_s = 60;
    options.stop = &stop_;
    std::thread server([&] {
      EXPECT_EQ(0, sim::serve_can(*plant_, can, options, report)) << report.error;
      done_ = true;
    });
    while (!done_) tick();
    server.join();
    compare();
  }
  ~Loop() { kSocketCanTransport.close(&transport); }

  SocketCanTransport transport;
  sim::ServeReport report;
  double worst_rad = 0.0, worst_shaft_rad = 0.0;
  tiller_status_t fault = tiller_status_ok;

 private:
  void tick() {
    pollfd wanted = {transport.socket, POLLIN, 0};
    (void)::poll(&wanted, 1, 20);
    tiller_measurement_t measurement;
    const tiller_status_t status = kSocketCanTransport.poll(&transport, &measurement);
    if (status != tiller_status_ok && status != tiller_status_no_new_measurement) {
      fault = status;
      stop_ = 1;
    }
    if (status != tiller_status_ok || measurement.sequence != next_) return;
    if (transport.robot.layout().channel_count > 1)
      worst_shaft_rad = std::fmax(worst_shaft_rad, std::fabs(measurement.value[1] - measurement.value[0]));
    tiller_command_t command{};
    command.stamp_us = measurement.stamp_us;
    command.sequence = command.plan_sequence = measurement.sequence;
    command.state = tiller_state_active;
    command.value[0] = torque_Nm(measurement.sequence);
    periods_.push_back({measurement.value[0], transport.robot.is_ready() ? command.value[0] : 0.0});
    EXPECT_EQ(tiller_status_ok, kSocketCanTransport.send(&transport, &command));
    ++next_;
  }

  /// The same torques on the same plant without a bus; afterwards, because ODE steps one world at a time.
  void compare() {
    const auto by_hand = pendulum(0);
    for (const Period& period : periods_) {
      double angle_rad = 0.0;
      by_hand->measure(&angle_rad);
      worst_rad = std::fmax(worst_rad, std::fabs(period.angle_rad - angle_rad));
      by_hand->apply(&period.torque_Nm);
      by_hand->advance(0.02);
    }
  }

  struct Period {
    double angle_rad, torque_Nm;  // as measured, and as the drive was told
  };
  std::unique_ptr<sim::Plant> plant_;
  std::vector<Period> periods_;
  std::atomic<bool> done_{false};
  volatile std::sig_atomic_t stop_ = 0;
  std::uint32_t next_ = 0;
};

TEST(DrivePlant, ThePlantMovesAsCommandedWhateverTheDriveSpeaks) {
  for (const Kind& kind : every_kind()) {
    Loop loop(kind);
    EXPECT_EQ(kPeriods, loop.report.periods) << kind.protocol;
    EXPECT_EQ(0u, loop.report.missing_answers) << kind.protocol;
    EXPECT_EQ(tiller_status_ok, loop.fault) << kind.protocol << ": " << socketcan_fault_text(&loop.transport);
    // a torque wrong by a step for 2 s turns 0.125 kg m^2 by step / 0.125 * t^2 / 2 at most; micro-radians travel
    EXPECT_LE(loop.worst_rad, kind.step_Nm / 0.125 * 2.0 * 2.0 / 2.0 + 2e-6) << kind.protocol;
    // the drive's own encoder is read at the board's time: the joint turns 1e-2 rad in a period, and none is seen of it
    EXPECT_LE(loop.worst_shaft_rad, 2e-6) << kind.protocol;
    std::printf("%s: angle off by %.2g rad at most, shaft by %.2g\n", kind.protocol, loop.worst_rad,
                loop.worst_shaft_rad);
  }
}

}  // namespace
}  // namespace tiller
