#include "sim/servers/serve_lcm.hpp"

#include <lcm/lcm.h>
#include <atomic>
#include <cmath>
#include <functional>

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
constexpr int give_up_ms = 60'000;

/// Answers until the server has ended. By liblcm's C interface, as any plant's peer may.
class Controller {
 public:
  using Answer = std::function<void(Controller&, const measurement_t&)>;
  explicit Controller(Answer answer) : lcm_(lcm_create(LcmOptions().url.c_str())), answer_(std::move(answer)) {
    EXPECT_NE(lcm_, nullptr);
    lcm_subscribe(lcm_, "TILLER_MEASUREMENT", &Controller::on_measurement, this);
  }
  ~Controller() { lcm_destroy(lcm_); }
  Controller(const Controller&) = delete;
  Controller& operator=(const Controller&) = delete;

  void run_until(const std::atomic<bool>& done) {
    for (int quiet_ms = 0; !done && quiet_ms < give_up_ms; quiet_ms += 10) {
      if (lcm_handle_timeout(lcm_, 10) > 0) quiet_ms = 0;
    }
  }
  void send(const void* bytes, int size) {
    EXPECT_EQ(lcm_publish(lcm_, "TILLER_COMMAND", bytes, static_cast<unsigned>(size)), 0);
  }
  void send(const command_t& command) {
    unsigned char bytes[256];
    send(bytes, command.encode(bytes, 0, sizeof bytes));
  }
  std::vector<measurement_t> received;

 private:
  static void on_measurement(const lcm_recv_buf_t* buffer, const char*, void* user) {
    auto* self = static_cast<Controller*>(user);
    measurement_t m{};
    ASSERT_GT(m.decode(buffer->data, 0, static_cast<int>(buffer->data_size)), 0);
    self->received.push_back(m);
    self->answer_(*self, m);
  }
  lcm_t* lcm_;
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

double push_N(std::int64_t sequence) { return 3 * std::sin(0.2 * static_cast<double>(sequence)); }

void obey(Controller& c, const measurement_t& m) { c.send(reply(m, push_N(m.sequence))); }

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
  o.answer_timeout_s = 60;  // an answer is on its way; only a lost one would cost this
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
  Controller controller([](Controller& c, const measurement_t& m) {
    if (m.sequence < 20) obey(c, m);
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
  Controller controller([](Controller& c, const measurement_t& m) {
    command_t wrong = reply(m, 50);
    for (const int count : {0, 2, 4, 7, -1}) {
      wrong.count = count;
      c.send(wrong);
    }
    wrong = reply(m, std::nan(""));
    c.send(wrong);
    const char garbage[] = "not a message";
    c.send(garbage, sizeof garbage);
    obey(c, m);
  });
  ServeOptions options = lockstep(0.2);
  options.on_period = [](const Plant& p, const PlantMeasurement& m) {
    EXPECT_EQ(motor(p), push_N(m.sequence - 1));  // the number has moved on by then
  };
  const ServeReport report = run(*plant, options, controller);
  EXPECT_EQ(report.commands, 20u);
  EXPECT_GE(report.bad_commands, 140u);
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
