#include "sim/serve_lcm.hpp"

#include <atomic>
#include <cmath>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <thread>
#include <tiller_lcm/command_t.hpp>
#include <tiller_lcm/measurement_t.hpp>

#include "plants.hpp"

// The plant on one thread, a controller of few lines on another, UDP multicast in between.

namespace tiller::sim {
namespace {

using tiller_lcm::command_t;
using tiller_lcm::measurement_t;

// nothing is gated by this: it only ends a test that hangs
constexpr int give_up_ms = 20'000;

/// Answers until the server has ended.
class Controller {
 public:
  using Answer = std::function<void(lcm::LCM&, const measurement_t&)>;
  explicit Controller(Answer answer) : lcm_(LcmOptions().url), answer_(std::move(answer)) {
    EXPECT_TRUE(lcm_.good());
    lcm_.subscribe("TILLER_MEASUREMENT", &Controller::on_measurement, this);
  }
  void run_until(const std::atomic<bool>& done) {
    for (int quiet_ms = 0; !done && quiet_ms < give_up_ms; quiet_ms += 10) {
      if (lcm_.handleTimeout(10) > 0) quiet_ms = 0;
    }
  }
  std::vector<measurement_t> received;

 private:
  void on_measurement(const lcm::ReceiveBuffer*, const std::string&, const measurement_t* m) {
    received.push_back(*m);
    answer_(lcm_, *m);
  }
  lcm::LCM lcm_;
  Answer answer_;
};

command_t reply(const measurement_t& m, double value) {
  command_t c{};
  c.stamp_us = m.stamp_us;
  c.sequence = m.sequence;
  c.state = 2;
  c.count = 1;
  c.value[0] = value;
  return c;
}

double push_N(std::int64_t sequence) {
  return 3 * std::sin(0.2 * static_cast<double>(sequence));
}

void obey(lcm::LCM& lcm, const measurement_t& m) {
  const command_t c = reply(m, push_N(m.sequence));
  lcm.publish("TILLER_COMMAND", &c);
}

ServeReport run(Plant& plant, const ServeOptions& options, Controller& controller) {
  ServeReport report;
  std::atomic<bool> done{false};
  std::thread server([&] {
    EXPECT_EQ(serve_lcm(plant, LcmOptions{}, options, report), 0) << report.error;
    done = true;
  });
  controller.run_until(done);
  server.join();
  return report;
}

ServeOptions lockstep(double duration_s) {
  ServeOptions o;
  o.period_s = 0.01;
  o.duration_s = duration_s;
  o.answer_timeout_s = 5;  // an answer is on its way; only a lost one would cost this
  return o;
}

TEST(ServeLcm, LockstepOverTheWireIsTheSameAsByHand) {
  PlantOptions o = cart_pole();
  o.encoder_noise_sd["angle_rad"] = 0.002;
  o.command_latency_s = 0.003;
  auto served = make(o), by_hand = make(o);
  Controller controller(obey);
  const ServeReport report = run(*served, lockstep(3.0), controller);
  EXPECT_EQ(report.periods, 300u);
  EXPECT_EQ(report.missing_answers, 0u);
  std::int64_t k = 0;
  for (const measurement_t& m : controller.received) {
    if (m.sequence < k) continue;  // the first one may have been repeated while the controller started
    ASSERT_EQ(m.sequence, k);
    ASSERT_EQ(m.stamp_us, 1'000'000 + by_hand->time_us());
    ASSERT_EQ(m.count, 2);
    ASSERT_EQ(m.valid_mask, 3);
    ASSERT_EQ(m.command_latency_us, 3000);
    ASSERT_EQ(m.value[0], reading(*by_hand)[0]);
    ASSERT_EQ(m.value[1], reading(*by_hand)[1]);
    command(*by_hand, push_N(k++));
    by_hand->advance(0.01);
  }
  EXPECT_EQ(k, 300);
  EXPECT_EQ(truth(*served), truth(*by_hand));
}

TEST(ServeLcm, SilentControllerTripsTheWatchdog) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = make(o);
  Controller controller([](lcm::LCM& lcm, const measurement_t& m) {
    if (m.sequence < 20) obey(lcm, m);
  });
  ServeOptions options = lockstep(0.4);
  options.answer_timeout_s = 0.2;
  const ServeReport report = run(*plant, options, controller);
  EXPECT_EQ(report.periods, 40u);
  EXPECT_GE(report.missing_answers, 20u);
  EXPECT_TRUE(plant->watchdog_tripped());
  EXPECT_EQ(motor(*plant), 0);
}

TEST(ServeLcm, MalformedCommandsAreIgnored) {
  auto plant = make(cart_pole());
  Controller controller([](lcm::LCM& lcm, const measurement_t& m) {
    command_t wrong = reply(m, 50);
    for (const int count : {0, 2, 4, 7, -1}) {
      wrong.count = count;
      lcm.publish("TILLER_COMMAND", &wrong);
    }
    wrong = reply(m, std::nan(""));
    lcm.publish("TILLER_COMMAND", &wrong);
    const char garbage[] = "not a message";
    lcm.publish("TILLER_COMMAND", garbage, sizeof garbage);
    obey(lcm, m);
  });
  ServeOptions options = lockstep(0.2);
  options.on_period = [](const Plant& p, const PlantMeasurement& m) {
    EXPECT_EQ(motor(p), push_N(m.sequence - 1));  // the number has moved on by then
  };
  const ServeReport report = run(*plant, options, controller);
  EXPECT_EQ(report.commands, 20u);
  EXPECT_GE(report.bad_commands, 100u);
}

TEST(ServeLcm, RealTimeNumbersEveryReading) {
  auto plant = make(cart_pole());
  Controller controller(obey);
  ServeOptions options = lockstep(0.4);
  options.lockstep = false;
  const ServeReport report = run(*plant, options, controller);
  ASSERT_GE(controller.received.size(), 2u);
  for (std::size_t i = 1; i < controller.received.size(); ++i) {
    ASSERT_GT(controller.received[i].sequence, controller.received[i - 1].sequence);
    ASSERT_GT(controller.received[i].stamp_us, controller.received[i - 1].stamp_us);
  }
  EXPECT_GE(report.commands, 1u);
}

TEST(ServeLcm, AUrlThatCannotBeOpenedIsNamed) {
  auto plant = make(cart_pole());
  LcmOptions lcm;
  lcm.url = "pigeon://loft";
  ServeReport report;
  EXPECT_EQ(serve_lcm(*plant, lcm, lockstep(1), report), 1);
  EXPECT_NE(report.error.find("pigeon://loft"), std::string::npos) << report.error;
}

}  // namespace
}  // namespace tiller::sim
