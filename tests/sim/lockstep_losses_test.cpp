// Lockstep over a wire that loses, doubles and delays messages: the plant's server on one side, the runtime's transport
// on the other, liblcm's queue in memory between them, and simulated time. Nothing here waits for the wall clock.
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <deque>
#include <functional>
#include <map>

#include "io/lcm_transport.hpp"
#include "plants.hpp"
#include "sim/mechanisms/noise.hpp"
#include "sim/servers/serve.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"

/// The time of day is off by so much for everything in this process that asks for it.
static std::int64_t wall_clock_off_s = 0;

extern "C" int clock_gettime(clockid_t clock, timespec* now) {
  const long failed = syscall(SYS_clock_gettime, clock, now);
  if (clock == CLOCK_REALTIME) now->tv_sec += wall_clock_off_s;
  return static_cast<int>(failed);
}

namespace tiller {
namespace {

/// Fate of one message.
enum class Fate { kArrives, kIsLost, kArrivesTwice, kArrivesAfterTheNext };  // the next one that arrives

/// A third of all messages is lost, a tenth each is doubled and delayed.
class Fates {
 public:
  Fates(std::uint64_t seed, const char* direction) : noise_(seed, direction) {}
  Fate next() {
    const double u = noise_.uniform(count_++);
    if (u < 0.33) return Fate::kIsLost;
    if (u < 0.43) return Fate::kArrivesTwice;
    return u < 0.53 ? Fate::kArrivesAfterTheNext : Fate::kArrives;
  }

 private:
  sim::NoiseStream noise_;
  std::uint64_t count_ = 0;
};

/// Passes messages on as fate has it.
template <class Message>
class Lane {
 public:
  std::function<Fate()> fate = [] { return Fate::kArrives; };

  std::deque<Message> pass(const Message& message) {
    const Fate now = fate();
    std::deque<Message> out;
    if (now == Fate::kArrivesAfterTheNext) delayed_.push_back(message);
    if (now != Fate::kArrives && now != Fate::kArrivesTwice) return out;
    out.push_back(message);
    if (now == Fate::kArrivesTwice) out.push_back(message);
    for (Message& late : delayed_) out.push_back(std::move(late));
    delayed_.clear();
    return out;
  }

 private:
  std::deque<Message> delayed_;
};

using Bytes = std::vector<unsigned char>;

double push_N(std::uint32_t sequence) { return 3 * std::sin(0.2 * sequence); }

/// The runtime behind its transport, as a plant sees it.
class Wire final : public sim::PlantLink {
 public:
  explicit Wire(bool has_key = false) {
    const std::uint8_t key[MessageSeal::kKeyBytes] = {1, 2, 3}, secret[MessageSeal::kSecretBytes] = {4};
    LcmOptions options;
    if (has_key) options.key = key;
    if (has_key) seal_ = MessageSeal(key, secret, MessageSeal::kWindowUs);
    options.url = "memq://";  // within this process
    options.measurement_count = 2;
    options.input_count = 1;
    options.lockstep = true;
    OpenError error;
    EXPECT_EQ(lcm_transport_open(&transport, options, &error), tiller_status_ok) << error.text;
    lcm_subscribe(transport.lcm, "TILLER_COMMAND", &Wire::on_command, this);
  }
  ~Wire() override { kLcmTransport.close(&transport); }
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;

  bool publish(const sim::PlantMeasurement& m) override {
    ++published;
    tiller_lcm::measurement_t out{};
    out.stamp_us = m.stamp_us;
    out.sequence = m.sequence;
    out.count = 2;
    out.valid_mask = 3;
    std::copy(m.value.begin(), m.value.end(), out.value);
    Bytes bytes(static_cast<std::size_t>(out.getEncodedSize()));
    out.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    if (seal_.has_key()) {
      const auto size = static_cast<std::uint32_t>(bytes.size());
      bytes.resize(size + MessageSeal::kTrailerBytes);
      seal_.seal("TILLER_MEASUREMENT", bytes.data(), size, clock_us);
    }
    for (const Bytes& message : measurements.pass(bytes))
      lcm_publish(transport.lcm, "TILLER_MEASUREMENT", message.data(), static_cast<unsigned>(message.size()));
    return true;
  }

  bool receive(sim::PlantCommand& command, std::int64_t timeout_us) override {
    run_controller();
    if (arrived_.empty()) {
      clock_us += std::max<std::int64_t>(timeout_us, 1);
      return false;
    }
    clock_us += 100;
    command = arrived_.front();
    arrived_.pop_front();
    return true;
  }

  std::string error() const override { return clock_us < kAnHour_us ? "" : "nothing moves on"; }

  LcmTransport transport;
  Lane<Bytes> measurements;
  Lane<Bytes> commands;
  std::int64_t clock_us = 1000000;
  std::uint64_t published = 0;
  std::vector<std::uint32_t> ticks;                                ///< sequences in the order in which they were taken
  std::map<std::int64_t, std::vector<std::vector<double>>> heard;  ///< every answer that arrived, by its sequence

 private:
  static constexpr std::int64_t kAnHour_us = 3600000000;

  /// One command for each measurement that the transport hands out.
  void run_controller() {
    tiller_measurement_t m{};
    while (kLcmTransport.poll(&transport, &m) == tiller_status_ok) {
      ticks.push_back(m.sequence);
      tiller_command_t c{};
      c.stamp_us = m.stamp_us;
      c.sequence = m.sequence;
      c.state = tiller_state_active;
      c.plan_sequence = static_cast<std::uint32_t>(ticks.size());
      c.value[0] = push_N(m.sequence);
      EXPECT_EQ(kLcmTransport.send(&transport, &c), tiller_status_ok);
    }
    (void)kLcmTransport.poll(&transport, &m);  // the queue in memory brings back what was just sent
  }

  static void on_command(const lcm_recv_buf_t* buffer, const char*, void* user) {
    auto* self = static_cast<Wire*>(user);
    const auto* data = static_cast<const unsigned char*>(buffer->data);
    for (const Bytes& message : self->commands.pass(Bytes(data, data + buffer->data_size))) self->hear(message);
  }

  void hear(const Bytes& bytes) {
    const auto size = static_cast<std::uint32_t>(bytes.size());
    if (seal_.has_key() && seal_.check("TILLER_COMMAND", bytes.data(), size, clock_us) != SealState::kOk) return;
    if (seal_.has_key() && size == MessageSeal::kTrailerBytes) return;
    tiller_lcm::command_t in{};
    ASSERT_GT(in.decode(bytes.data(), 0, static_cast<int>(size)), 0);
    heard[in.sequence].push_back({in.value[0], static_cast<double>(in.plan_sequence)});
    sim::PlantCommand command;
    command.sequence = in.sequence;
    command.state = in.state;
    command.plan = in.plan_sequence;
    command.value.assign(in.value, in.value + in.count);
    arrived_.push_back(command);
  }

  MessageSeal seal_;  // the plant's
  std::deque<sim::PlantCommand> arrived_;
};

sim::ServeOptions lockstep(Wire& wire, double duration_s) {
  sim::ServeOptions o;
  o.period_s = 0.01;
  o.duration_s = duration_s;
  o.repeat_s = 0.1;
  // fifty tries, each with less than half a chance: all are lost once in 10^14
  o.answer_timeout_s = 5;
  o.now_us = [&wire] { return wire.clock_us; };
  return o;
}

class Losses : public testing::TestWithParam<std::tuple<std::uint64_t, bool>> {};

TEST_P(Losses, EachMeasurementIsTakenOnceAndEachCommandAppliedOnce) {
  const auto [seed, has_key] = GetParam();
  Wire wire(has_key);
  Fates there(seed, "measurements"), back(seed, "commands");
  wire.measurements.fate = [&] { return there.next(); };
  wire.commands.fate = [&] { return back.next(); };
  auto served = sim::make(sim::cart_pole()), by_hand = sim::make(sim::cart_pole());
  sim::ServeOptions options = lockstep(wire, 3.0);
  // one reading of it an hour ahead, or behind, and later right again
  options.on_period = [](const sim::Plant&, const sim::PlantMeasurement& m) {
    wall_clock_off_s = m.sequence % 50 == 20 ? 3600 : m.sequence % 50 == 40 ? -3600 : 0;
  };
  sim::ServeReport report;
  ASSERT_EQ(serve(*served, wire, options, report), 0) << report.error;
  wall_clock_off_s = 0;
  ASSERT_EQ(wire.ticks.size(), 300u);
  for (std::uint32_t k = 0; k < 300; ++k) {
    ASSERT_EQ(wire.ticks[k], k);
    sim::command(*by_hand, push_N(k));
    by_hand->advance(0.01);
  }
  EXPECT_EQ(sim::truth(*served), sim::truth(*by_hand)) << "the run without losses, to the last bit";
  EXPECT_EQ(report.periods, 300u);
  EXPECT_EQ(report.commands, 300u);
  EXPECT_EQ(report.missing_answers, 0u);
  EXPECT_EQ(wire.published, 300 + report.repeats);
  EXPECT_EQ(wire.transport.counters.received, 300u);
  // a third of the measurements and a third of the answers: at least one of both is lost every second time
  EXPECT_GT(report.repeats, 150u);
  EXPECT_GT(wire.transport.repeated_answers, 50u);
  for (const auto& [sequence, answers] : wire.heard)
    for (const std::vector<double>& answer : answers)
      EXPECT_EQ(answer, answers.front()) << "measurement " << sequence << " was answered in two ways";
  std::printf("%llu measurements and %llu answers sent again\n", static_cast<unsigned long long>(report.repeats),
              static_cast<unsigned long long>(wire.transport.repeated_answers));
}

INSTANTIATE_TEST_SUITE_P(Seeds, Losses, testing::Combine(testing::Range<std::uint64_t>(1, 11), testing::Bool()),
                         [](const auto& test) {
                           return std::to_string(std::get<0>(test.param)) + (std::get<1>(test.param) ? "_signed" : "");
                         });

/// One reading of the time of day an hour ahead, on a link that loses nothing: nothing is asked twice for it.
TEST(Lockstep, AStepOfTheTimeOfDayMutesNoSignedLink) {
  Wire wire(true);
  auto plant = sim::make(sim::cart_pole());
  sim::ServeOptions options = lockstep(wire, 1.0);
  options.answer_timeout_s = 0.35;
  options.on_period = [](const sim::Plant&, const sim::PlantMeasurement& m) {
    wall_clock_off_s = m.sequence == 30 ? 3600 : m.sequence > 60 ? -3600 : 0;
  };
  sim::ServeReport report;
  ASSERT_EQ(serve(*plant, wire, options, report), 0);
  wall_clock_off_s = 0;
  EXPECT_EQ(report.commands, 100u);
  EXPECT_EQ(report.repeats, 1u) << "the first measurement, before the plant knows the challenge";
  EXPECT_EQ(report.missing_answers, 0u);
}

TEST(Lockstep, WithoutLossesNothingIsSentAgain) {
  Wire wire;
  auto plant = sim::make(sim::cart_pole());
  sim::ServeReport report;
  ASSERT_EQ(serve(*plant, wire, lockstep(wire, 1.0), report), 0);
  EXPECT_EQ(report.commands, 100u);
  EXPECT_EQ(report.repeats + report.missing_answers + report.stale_commands, 0u);
  EXPECT_EQ(wire.transport.repeated_answers, 0u);
}

TEST(Lockstep, ItKeepsThePaceThatIsAskedFor) {
  Wire wire;
  auto plant = sim::make(sim::cart_pole());
  sim::ServeOptions options = lockstep(wire, 1.0);
  std::vector<std::int64_t> began_us;
  options.pace = 0.5;  // a period of 10 ms in 20 ms
  options.on_period = [&](const sim::Plant&, const sim::PlantMeasurement&) {
    began_us.push_back(wire.clock_us);
    if (began_us.size() == 50) wire.clock_us += 1000000;  // the machine is busy elsewhere
  };
  sim::ServeReport report;
  ASSERT_EQ(serve(*plant, wire, options, report), 0);
  ASSERT_EQ(began_us.size(), 100u);
  for (std::size_t k = 1; k < 100; ++k)
    EXPECT_NEAR(static_cast<double>(began_us[k] - began_us[k - 1]), k == 50 ? 1000000 : 20000, 200) << k;
  EXPECT_EQ(report.commands, 100u);
}

TEST(Lockstep, AControllerThatIsGoneIsAskedForTheTimeoutAndNoLonger) {
  Wire wire;
  wire.measurements.fate = [&] { return wire.ticks.size() < 10 ? Fate::kArrives : Fate::kIsLost; };
  sim::PlantOptions o = sim::cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = sim::make(o);
  sim::ServeOptions options = lockstep(wire, 0.2);
  options.answer_timeout_s = 1.0;
  sim::ServeReport report;
  ASSERT_EQ(serve(*plant, wire, options, report), 0);
  EXPECT_EQ(report.missing_answers, 10u);
  EXPECT_EQ(report.repeats, 10 * 9u) << "ten times in a second, the first of which is no repetition";
  EXPECT_TRUE(plant->watchdog_tripped());
}

TEST(Lockstep, AnAnswerThatComesTooLateMovesNothing) {
  Wire wire;
  // the answers to number 5 arrive behind the one to number 6, when the plant has gone on
  wire.commands.fate = [&] { return wire.ticks.size() == 6 ? Fate::kArrivesAfterTheNext : Fate::kArrives; };
  auto served = sim::make(sim::cart_pole()), by_hand = sim::make(sim::cart_pole());
  sim::ServeReport report;
  ASSERT_EQ(serve(*served, wire, lockstep(wire, 0.1), report), 0);
  for (std::uint32_t k = 0; k < 10; ++k) {
    if (k != 5) sim::command(*by_hand, push_N(k));
    by_hand->advance(0.01);
  }
  EXPECT_EQ(report.missing_answers, 1u);
  EXPECT_EQ(report.commands, 9u);
  EXPECT_EQ(report.stale_commands, 50u) << "asked ten times a second for five seconds";
  EXPECT_EQ(sim::truth(*served), sim::truth(*by_hand));
}

}  // namespace
}  // namespace tiller
