#include "sim/servers/serve_can.hpp"

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <thread>

#include "plants.hpp"
#include "sim/devices/can_socket.hpp"

// The plant on one thread, a controller that speaks the bytes of CANSimple on another, a (virtual) CAN bus in
// between: TILLER_CAN_INTERFACE, vcan0 if that is not set. In lockstep, so the machine's speed does not
// matter.

namespace tiller::sim {
namespace {

constexpr std::uint32_t axis_node = 3, board_node = 48;
constexpr double wheel_radius_m = 0.04;
constexpr std::uint32_t watchdog_error = 0x1000000, estop_error = 0x2000000;

CanOptions bus() {
  CanOptions o;
  const char* name = std::getenv("TILLER_CAN_INTERFACE");
  o.interface = name != nullptr ? name : "vcan0";
  o.drive.node = axis_node;
  o.sensor_node = board_node;
  o.wheel_radius_m = wheel_radius_m;
  o.protected_frames = false;  // the controller below reads the older layout
  return o;
}

std::uint32_t word(const CanFrame& f, int at) {
  std::uint32_t value;
  std::memcpy(&value, f.data.data() + at, 4);
  return value;
}

struct Reading {
  std::uint32_t time_us = 0, sequence = 0;
  std::int32_t value[2] = {};
  std::uint32_t axis_error = 0;
  int axis_state = 0;
};

/// Puts readings together and hands them to a script, which answers by the functions below.
class Controller {
 public:
  using Script = std::function<void(Controller&, const Reading&)>;
  explicit Controller(Script script) : script_(std::move(script)) {
    EXPECT_TRUE(socket_.open(bus().interface, {axis_node, board_node})) << socket_.error();
  }

  void run_until(const std::atomic<bool>& done) {
    CanFrame frame;
    while (!done && socket_.error().empty()) {
      if (socket_.receive(frame, 10'000)) take(frame);
    }
  }

  void send(std::uint32_t node, std::uint32_t command, const std::vector<std::uint8_t>& bytes) {
    CanFrame f;
    f.id = node << 5 | command;
    f.length = static_cast<std::uint8_t>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), f.data.begin());
    EXPECT_TRUE(socket_.send(f)) << socket_.error();
  }
  void arm() {
    send(axis_node, 0x0b, {1, 0, 0, 0, 1, 0, 0, 0});
    send(axis_node, 0x07, {8, 0, 0, 0});
  }
  void torque(float torque_Nm) {
    std::vector<std::uint8_t> bytes(4);
    std::memcpy(bytes.data(), &torque_Nm, 4);
    send(axis_node, 0x0e, bytes);
  }
  void answer(std::uint32_t sequence) {
    std::vector<std::uint8_t> bytes(8);
    std::memcpy(bytes.data(), &sequence, 4);
    bytes[4] = 2;
    bytes[5] = 1;
    bytes[6] = bytes[0];  // a plan for every measurement
    send(board_node, 0x01, bytes);
  }

 private:
  void take(const CanFrame& f) {
    if (f.id == (axis_node << 5 | 0x01)) {
      now_.axis_error = word(f, 0);
      now_.axis_state = f.data[4];
    } else if (f.id == board_node << 5) {
      now_.time_us = word(f, 0);
      now_.sequence = word(f, 4);
    } else if (f.id == (board_node << 5 | 0x10)) {
      now_.value[0] = static_cast<std::int32_t>(word(f, 0));
    } else if (f.id == (board_node << 5 | 0x11)) {
      now_.value[1] = static_cast<std::int32_t>(word(f, 0));
      // the first reading repeats while the two find each other
      if (now_.sequence == next_) {
        ++next_;
        script_(*this, now_);
      }
    }
  }
  CanSocket socket_;
  Script script_;
  Reading now_;
  std::uint32_t next_ = 0;
};

ServeReport run(Plant& plant, const ServeOptions& options, Controller& controller) {
  ServeReport report;
  std::atomic<bool> done{false};
  std::thread server([&] {
    EXPECT_EQ(serve_can(plant, bus(), options, report), 0) << report.error;
    done = true;
  });
  controller.run_until(done);
  server.join();
  return report;
}

ServeOptions lockstep(double duration_s) {
  ServeOptions o;
  o.period_s = 0.02;
  o.duration_s = duration_s;
  o.answer_timeout_s = 60;
  return o;
}

float push_Nm(std::uint32_t sequence) { return static_cast<float>(0.12 * std::sin(0.2 * sequence)); }

TEST(ServeCan, LockstepOverTheBusIsTheSameAsByHand) {
  PlantOptions o = cart_pole();
  o.encoder_noise_sd["position_m"] = 0.001;
  auto served = make(o), by_hand = make(o);
  std::vector<Reading> readings;
  Controller controller([&](Controller& c, const Reading& r) {
    readings.push_back(r);
    if (r.sequence == 0) c.arm();
    c.torque(push_Nm(r.sequence));
    c.answer(r.sequence);
  });
  const ServeReport report = run(*served, lockstep(2.0), controller);
  EXPECT_EQ(report.periods, 100u);
  EXPECT_EQ(report.missing_answers, 0u);
  ASSERT_EQ(readings.size(), 100u);
  for (const Reading& r : readings) {
    ASSERT_EQ(r.time_us, 1'000'000 + by_hand->time_us());
    ASSERT_EQ(r.value[0], std::llround(reading(*by_hand)[0] * 1e6));
    ASSERT_EQ(r.value[1], std::llround(reading(*by_hand)[1] * 1e6));
    ASSERT_EQ(r.axis_error, 0u);
    ASSERT_EQ(r.axis_state, r.sequence == 0 ? 1 : 8);
    command(*by_hand, push_Nm(r.sequence) / wheel_radius_m);
    by_hand->advance(0.02);
  }
  EXPECT_EQ(truth(*served), truth(*by_hand));
}

TEST(ServeCan, AnIdleAxisMakesNoForce) {
  auto plant = make(cart_pole());
  Controller controller([](Controller& c, const Reading& r) {
    c.torque(0.5f);
    c.answer(r.sequence);
  });
  ServeOptions options = lockstep(0.4);
  options.on_period = [](const Plant& p, const PlantMeasurement&) { EXPECT_EQ(motor(p), 0); };
  EXPECT_EQ(run(*plant, options, controller).commands, 0u);
}

TEST(ServeCan, LostTorquesTripTheWatchdogAndTheAxisSaysSo) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = make(o);
  std::vector<Reading> readings;
  Controller controller([&](Controller& c, const Reading& r) {
    readings.push_back(r);
    if (r.sequence == 0) c.arm();
    if (r.sequence == 30) c.send(axis_node, 0x18, {0});  // clear errors, then arm again
    if (r.sequence == 31) c.arm();
    // ticks 10 to 32 answer, but feed no torque
    if (r.sequence < 10 || r.sequence > 32) c.torque(0.04f);
    c.answer(r.sequence);
  });
  ServeOptions options = lockstep(0.8);
  std::vector<double> force;
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { force.push_back(motor(p)); };
  run(*plant, options, controller);
  ASSERT_EQ(readings.size(), 40u);
  ASSERT_EQ(force.size(), 40u);
  for (std::size_t k = 0; k < 40; ++k) {
    // the last torque is at 180 ms and dies at 230 ms, within period 11; the axis says so from tick 12 on
    const bool failed = k >= 12 && k <= 30;
    EXPECT_EQ(readings[k].axis_error, failed ? watchdog_error : 0u) << k;
    EXPECT_EQ(readings[k].axis_state, k == 0 || (k >= 12 && k <= 31) ? 1 : 8) << k;
    EXPECT_EQ(force[k] != 0, k < 11 || k > 32) << k;
  }
}

TEST(ServeCan, EstopStopsTheMotorAtOnce) {
  auto plant = make(cart_pole());
  std::vector<Reading> readings;
  Controller controller([&](Controller& c, const Reading& r) {
    readings.push_back(r);
    if (r.sequence == 0) c.arm();
    c.torque(0.04f);
    if (r.sequence == 5) c.send(axis_node, 0x02, {});
    c.answer(r.sequence);
  });
  ServeOptions options = lockstep(0.2);
  std::vector<double> force;
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { force.push_back(motor(p)); };
  run(*plant, options, controller);
  ASSERT_EQ(force.size(), 10u);
  for (std::size_t k = 0; k < 10; ++k) EXPECT_EQ(force[k] != 0, k < 5) << k;
  EXPECT_EQ(readings[5].axis_error, 0u);
  EXPECT_EQ(readings[6].axis_error, estop_error);
}

TEST(ServeCan, WhatCannotBeOpenedIsNamedWithTheRemedy) {
  auto plant = make(cart_pole());
  ServeReport report;
  CanOptions o = bus();
  o.interface = "can_of_worms";
  EXPECT_EQ(serve_can(*plant, o, lockstep(1), report), 1);
  EXPECT_NE(report.error.find("can_of_worms"), std::string::npos) << report.error;
  EXPECT_NE(report.error.find("ip link add"), std::string::npos) << report.error;
  o = bus();
  o.sensor_node = o.drive.node;
  EXPECT_EQ(serve_can(*plant, o, lockstep(1), report), 1);
  EXPECT_NE(report.error.find("sensor_node"), std::string::npos) << report.error;
  o = bus();
  o.wheel_radius_m = 0;
  EXPECT_EQ(serve_can(*plant, o, lockstep(1), report), 1);
  EXPECT_NE(report.error.find("wheel_radius_m"), std::string::npos) << report.error;
}

}  // namespace
}  // namespace tiller::sim
