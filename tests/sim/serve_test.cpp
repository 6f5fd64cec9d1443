#include "sim/servers/serve.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "plants.hpp"
#include "sim/servers/plan_watch.hpp"

// The loop of the servers over a link without a network. Nothing here waits for the wall clock to pass a
// bound: lockstep is exact, and of real time only what cannot depend on scheduling is asked.

namespace tiller::sim {
namespace {

/// Answers each measurement by a function; keeps all that was published.
class ScriptedLink final : public PlantLink {
 public:
  using Answer = std::function<std::deque<PlantCommand>(const PlantMeasurement&)>;
  explicit ScriptedLink(Answer answer) : answer_(std::move(answer)) {}

  bool publish(const PlantMeasurement& m) override {
    published.push_back(m);
    for (PlantCommand& c : answer_(m)) queue_.push_back(std::move(c));
    return fail_after < 0 || static_cast<int>(published.size()) <= fail_after;
  }
  bool receive(PlantCommand& command, std::int64_t) override {
    if (queue_.empty()) return false;
    command = queue_.front();
    queue_.pop_front();
    return true;
  }
  std::string error() const override {
    return fail_after >= 0 && static_cast<int>(published.size()) > fail_after ? "the cable is cut" : "";
  }

  std::vector<PlantMeasurement> published;
  int fail_after = -1;

 private:
  Answer answer_;
  std::deque<PlantCommand> queue_;
};

double push_N(std::uint32_t sequence) { return 3 * std::sin(0.2 * sequence); }

std::deque<PlantCommand> obedient(const PlantMeasurement& m) { return {{m.sequence, {push_N(m.sequence)}}}; }

ServeOptions lockstep(double duration_s) {
  ServeOptions o;
  o.period_s = 0.01;
  o.duration_s = duration_s;
  o.answer_timeout_s = 0.001;
  o.repeat_s = 0.001;
  return o;
}

TEST(Serve, LockstepIsTheSameAsDrivingThePlantByHand) {
  auto served = make(cart_pole()), by_hand = make(cart_pole());
  ScriptedLink link(obedient);
  ServeReport report;
  ASSERT_EQ(serve(*served, link, lockstep(1.0), report), 0) << report.error;
  for (std::uint32_t k = 0; k < 100; ++k) {
    ASSERT_EQ(link.published[k].sequence, k);
    ASSERT_EQ(link.published[k].stamp_us, 1'000'000 + by_hand->time_us());
    ASSERT_EQ(link.published[k].value, reading(*by_hand));
    command(*by_hand, push_N(k));
    by_hand->advance(0.01);
  }
  EXPECT_EQ(truth(*served), truth(*by_hand));
  EXPECT_EQ(report.periods, 100u);
  EXPECT_EQ(report.commands, 100u);
  EXPECT_EQ(report.missing_answers + report.stale_commands + report.bad_commands, 0u);
}

TEST(Serve, TimeStandsStillUntilTheFirstAnswer) {
  auto plant = make(cart_pole());
  int deaf = 5;
  ScriptedLink link([&](const PlantMeasurement& m) {
    if (deaf-- > 0) return std::deque<PlantCommand>{};
    return obedient(m);
  });
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, lockstep(0.1), report), 0);
  for (int i = 0; i <= 5; ++i) {
    EXPECT_EQ(link.published[static_cast<std::size_t>(i)].sequence, 0u);
    EXPECT_EQ(link.published[static_cast<std::size_t>(i)].stamp_us, 1'000'000);
  }
  EXPECT_EQ(report.periods, 10u);
  EXPECT_EQ(report.missing_answers, 0u);
}

TEST(Serve, ADeadControllerTripsTheWatchdogInSimulatedTime) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = make(o);
  ScriptedLink link([](const PlantMeasurement& m) {
    return m.sequence < 10 ? std::deque<PlantCommand>{{m.sequence, {2.0}}} : std::deque<PlantCommand>{};
  });
  ServeOptions options = lockstep(0.3);
  std::vector<double> force;
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { force.push_back(motor(p)); };
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, options, report), 0);
  ASSERT_EQ(force.size(), 30u);
  // the last command is given at 90 ms and dies at 140 ms: the period that ends there is the last one with
  // force
  for (std::size_t k = 0; k < force.size(); ++k) EXPECT_EQ(force[k], k < 14 ? 2.0 : 0.0) << k;
  EXPECT_TRUE(plant->watchdog_tripped());
  EXPECT_EQ(report.missing_answers, 20u);
}

/// Two seconds of commands every 10 ms that differ in what is told of state and plan; the periods with force, and
/// whether the motor was off at the end.
std::pair<int, bool> served_with(const std::function<void(PlantCommand&)>& tell) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = make(o);
  ScriptedLink link([&](const PlantMeasurement& m) {
    PlantCommand c{m.sequence, {2.0}};
    tell(c);
    return std::deque<PlantCommand>{c};
  });
  ServeOptions options = lockstep(2.0);
  options.plan_timeout_s = 0.5;
  int driven = 0;
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { driven += motor(p) != 0.0; };
  ServeReport report;
  EXPECT_EQ(serve(*plant, link, options, report), 0);
  EXPECT_EQ(report.missing_answers, 0u);
  return {driven, plant->watchdog_tripped()};
}

TEST(PlanWatch, HungPlannerBehindALiveSenderTripsTheMotorsWatchdog) {
  const auto served = served_with([](PlantCommand& c) {
    c.state = 2;
    c.plan = std::min<std::int64_t>(c.sequence, 49);  // the last new plan comes at 490 ms
  });
  // heard until 990 ms, the watchdog's 50 ms from the command at 980 ms on
  EXPECT_EQ(served, std::make_pair(103, true));
}

TEST(PlanWatch, PlansThatGrowKeepTheMotorOnOverTheWrapOfAByte) {
  const auto served = served_with([](PlantCommand& c) {
    c.state = 2;
    c.plan = (c.sequence / 40 + 250) % 256;  // a new one every 400 ms
  });
  EXPECT_EQ(served, std::make_pair(200, false));
}

TEST(PlanWatch, InHoldTheAnsweredMeasurementMustGrow) {
  const auto held = served_with([](PlantCommand& c) {
    c.state = 3;
    c.plan = 7;
  });
  EXPECT_EQ(held, std::make_pair(200, false)) << "feedback on fresh measurements needs no plan";
  PlanWatch watch(500000);
  PlantCommand repeated{5, {2.0}};
  repeated.state = 3;
  repeated.plan = 7;
  for (std::int64_t us = 0; us < 500000; us += 10000) {
    watch.note(repeated, us);
    EXPECT_FALSE(watch.hung(us));
  }
  watch.note(repeated, 500000);
  EXPECT_TRUE(watch.hung(500000)) << "a repeater";
}

TEST(PlanWatch, SafeAndStandbyAndUncountedSendersAreNotWatched) {
  for (const int state : {0, 1, 4}) {
    const auto served = served_with([&](PlantCommand& c) {
      c.state = state;
      c.plan = 7;
    });
    EXPECT_EQ(served, std::make_pair(200, false)) << "the safe command needs no plan";
  }
  EXPECT_EQ(served_with([](PlantCommand&) {}), std::make_pair(200, false));
}

TEST(PlanWatch, NewPlanEndsIt) {
  PlanWatch watch(500000);
  PlantCommand c{5, {2.0}};
  c.state = 2;
  c.plan = 7;
  watch.note(c, 0);
  watch.note(c, 600000);
  EXPECT_TRUE(watch.hung(600000));
  c.plan = 8;
  watch.note(c, 700000);
  EXPECT_FALSE(watch.hung(700000));
  EXPECT_FALSE(PlanWatch(0).hung(10000000)) << "switched off";
}

TEST(Serve, CommandsThatCannotBeMeantAreCountedAndIgnored) {
  auto plant = make(cart_pole());
  ScriptedLink link([](const PlantMeasurement& m) {
    return std::deque<PlantCommand>{{m.sequence - 1, {100.0}},
                                    {m.sequence, {std::nan("")}},
                                    {m.sequence, {1.0, 2.0}},
                                    {m.sequence, {}},
                                    {m.sequence, {0.5}}};
  });
  ServeOptions options = lockstep(0.1);
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { ASSERT_EQ(motor(p), 0.5); };
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, options, report), 0);
  EXPECT_EQ(report.commands, 10u);
  EXPECT_EQ(report.stale_commands, 10u);
  EXPECT_EQ(report.bad_commands, 30u);
}

TEST(Serve, BareMotorCommandsActWhileTheAnswerIsAwaited) {
  auto plant = make(cart_pole());
  PlantCommand answer;
  ScriptedLink link([&](const PlantMeasurement& m) {
    answer.sequence = m.sequence;
    answer.has_value = false;
    // every third answer comes without a command of its own: the motor keeps the last one
    if (m.sequence % 3 == 2) return std::deque<PlantCommand>{answer};
    return std::deque<PlantCommand>{{PlantCommand::kUnnumbered, {0.1 * m.sequence}}, answer};
  });
  ServeOptions options = lockstep(0.3);
  std::vector<double> force;
  options.on_period = [&](const Plant& p, const PlantMeasurement&) { force.push_back(motor(p)); };
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, options, report), 0);
  for (std::size_t k = 0; k < force.size(); ++k) EXPECT_EQ(force[k], 0.1 * static_cast<double>(k % 3 == 2 ? k - 1 : k));
  EXPECT_EQ(report.commands, 20u);
  EXPECT_EQ(report.missing_answers + report.stale_commands, 0u);
}

TEST(Serve, ALinkThatDiesEndsItWithTheReason) {
  auto plant = make(cart_pole());
  ScriptedLink link(obedient);
  link.fail_after = 7;
  ServeReport report;
  EXPECT_EQ(serve(*plant, link, lockstep(1.0), report), 1);
  EXPECT_EQ(report.error, "the cable is cut");
  EXPECT_EQ(report.periods, 7u);
}

TEST(Serve, StopFlagEndsItInBothModes) {
  for (const bool in_lockstep : {true, false}) {
    volatile std::sig_atomic_t stop = 0;
    auto plant = make(cart_pole());
    ScriptedLink link([&](const PlantMeasurement& m) {
      if (m.sequence == 3) stop = 1;
      return obedient(m);
    });
    ServeOptions options = lockstep(0);
    options.period_s = 0.002;
    options.lockstep = in_lockstep;
    options.stop = &stop;
    ServeReport report;
    EXPECT_EQ(serve(*plant, link, options, report), 0);
    EXPECT_GE(report.periods, 3u);
    EXPECT_LE(report.periods, 4u);
  }
}

TEST(Serve, RealTimeNumbersStampsAndAppliesEverything) {
  auto plant = make(cart_pole());
  ScriptedLink link([](const PlantMeasurement& m) {
    return std::deque<PlantCommand>{{m.sequence, {1.0}}, {PlantCommand::kUnnumbered, {2.0}}};
  });
  ServeOptions options = lockstep(0.05);
  options.period_s = 0.002;
  options.lockstep = false;
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, options, report), 0);
  ASSERT_GE(link.published.size(), 2u);
  for (std::size_t k = 1; k < link.published.size(); ++k) {
    ASSERT_EQ(link.published[k].sequence, k);
    ASSERT_GT(link.published[k].stamp_us, link.published[k - 1].stamp_us);
  }
  EXPECT_GE(plant->time_us(), 50'000);
  EXPECT_GE(report.commands, 2u);
  EXPECT_EQ(motor(*plant), 2.0);  // the last one that came, whatever its number
}

/// Answers 7 ms after the measurement, by a clock that runs while somebody waits.
class SlowLink final : public PlantLink {
 public:
  bool publish(const PlantMeasurement& m) override {
    published.push_back(m);
    answer_ = {m.sequence, {1.0}};
    due_us_ = clock_us + 7000;
    return true;
  }
  bool receive(PlantCommand& command, std::int64_t timeout_us) override {
    const bool comes = due_us_ >= 0 && due_us_ <= clock_us + timeout_us;
    clock_us = comes ? std::max(clock_us, due_us_) : clock_us + std::max<std::int64_t>(timeout_us, 1);
    if (!comes) return false;
    due_us_ = -1;
    command = answer_;
    return true;
  }
  std::string error() const override { return ""; }

  std::int64_t clock_us = 1000000;
  std::vector<PlantMeasurement> published;

 private:
  PlantCommand answer_;
  std::int64_t due_us_ = -1;
};

TEST(Serve, RealTimeTellsHowLateItsCommandsCome) {
  PlantOptions o = cart_pole();
  for (const bool in_lockstep : {false, true}) {
    auto plant = make(o);
    SlowLink link;
    ServeOptions options = lockstep(0.5);
    options.lockstep = in_lockstep;
    options.answer_timeout_s = 1;
    options.repeat_s = 0.5;
    options.now_us = [&] { return link.clock_us; };
    ServeReport report;
    ASSERT_EQ(serve(*plant, link, options, report), 0) << report.error;
    ASSERT_GE(link.published.size(), 50u);
    EXPECT_EQ(link.published[0].answer_us, 0) << "not known yet";
    for (std::size_t k = 1; k < link.published.size(); ++k) {
      const auto told_us = static_cast<double>(link.published[k].answer_us);
      EXPECT_NEAR(told_us, in_lockstep ? 0 : 7000, in_lockstep ? 0 : 1e6 * o.step_s) << "whole steps of the physics";
    }
  }
}

/// A machine that stalls in publications: for so long that the periods begin anew between two steps of the physics, and
/// then until 30 us before a period is due, within one step.
class StallingLink final : public PlantLink {
 public:
  explicit StallingLink(std::int64_t period_us) : period_us_(period_us) {}
  bool publish(const PlantMeasurement& m) override {
    published.push_back(m);
    if (m.sequence % 4 == 1) clock_us += 3 * period_us_ + 70;
    if (m.sequence % 4 == 3) clock_us += 2 * period_us_ - 30;
    return true;
  }
  bool receive(PlantCommand&, std::int64_t timeout_us) override {
    clock_us += std::max<std::int64_t>(timeout_us, 1);
    return false;
  }
  std::string error() const override { return ""; }

  std::int64_t clock_us = 1000000;
  std::vector<PlantMeasurement> published;

 private:
  const std::int64_t period_us_;
};

TEST(Serve, AMachineThatStallsSendsNoReadingTwice) {
  auto plant = make(cart_pole());
  ServeOptions options = lockstep(0.5);
  options.lockstep = false;
  StallingLink link(std::llround(1e6 * options.period_s));
  options.now_us = [&] { return link.clock_us; };
  ServeReport report;
  ASSERT_EQ(serve(*plant, link, options, report), 0) << report.error;
  ASSERT_GE(link.published.size(), 8u);
  for (std::size_t k = 1; k < link.published.size(); ++k)
    EXPECT_GT(link.published[k].stamp_us, link.published[k - 1].stamp_us) << k;
}

TEST(Serve, PeriodBelowThePhysicsStepIsRefused) {
  auto plant = make(cart_pole());
  ScriptedLink link(obedient);
  ServeOptions options = lockstep(1);
  options.period_s = 0.0001;
  ServeReport report;
  EXPECT_EQ(serve(*plant, link, options, report), 1);
  EXPECT_NE(report.error.find("period_s"), std::string::npos);
}

}  // namespace
}  // namespace tiller::sim
