// `pace = "clock"` with drives that speak only when spoken to, over virtual CAN: a tick begins by the clock, with the
// question, and has the answer to that question or none.
//
// By the wall clock, on whatever machine, an emulated one too: nothing here asserts how long something took. Every
// answer tells another position, so that a measurement names the question that it answers.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "io/monotonic_clock.hpp"
#include "sim/devices/can_socket.hpp"
#include "sim/devices/moteus_axis.hpp"
#include "tools/links/link.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

constexpr double kPeriod_s = 0.1;
constexpr double kStep_rad = 0.01;  // from one answer to the next

constexpr const char* kRobot = R"([model]
name = "pendulum"
period_s = 0.1
[parameters]
mass_kg = 0.5
length_m = 0.4
damping_Nms = 0.01
[measurement]
angle_rad = { sd = 0.002 }
rate_rad_s = { sd = 0.02 }
[planner]
kind = "mppi"
horizon = 20
knots = 5
rollouts = 32
particles = 2
iterations = 1
noise_sd = { torque_Nm = 0.3 }
[posterior]
enabled = false
[cost]
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -1, high = 1 }
[transport]
kind = "socketcan"
interface = "vcan0"
actuator = "moteus"
nodes = { torque_Nm = 3 }
heartbeat_timeout_s = 0
channels = { angle_rad = "position:torque_Nm", rate_rad_s = "velocity:torque_Nm" }
[realtime]
pace = "clock"
)";

/// A moteus on the bus, in a thread of its own. Its shaft moves a step with every frame that it takes.
class Drive {
 public:
  enum class Manner { kAnswers, kIsSilent, kAnswersLate };

  Drive() {
    EXPECT_TRUE(socket_.open("vcan0", {axis_.listens()}, true)) << socket_.error();
    thread_ = std::thread([this] { serve(); });
  }
  ~Drive() {
    ending_ = true;
    thread_.join();
  }
  Drive(const Drive&) = delete;
  Drive& operator=(const Drive&) = delete;

  std::atomic<Manner> manner{Manner::kAnswers};

  struct Taken {
    std::int64_t at_us;
    bool question;
  };
  std::vector<Taken> taken() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return taken_;
  }

 private:
  void serve() {
    sim::CanFrames held;
    while (!ending_) {
      sim::CanFrame frame;
      if (!socket_.receive(frame, 20000)) continue;
      sim::CanFrames replies;
      const std::int64_t at_us = monotonic_us();
      std::size_t number = 0;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        number = taken_.size();
      }
      const auto event = axis_.take(frame, {kStep_rad * static_cast<double>(number), 0}, replies);
      const bool question = event == sim::DriveAxis::Event::kNone;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        taken_.push_back({at_us, question});
      }
      for (const sim::CanFrame& late : held) socket_.send(late);  // behind the command that went out without it
      held.clear();
      if (manner == Manner::kIsSilent) continue;
      if (manner == Manner::kAnswersLate && question)
        held = replies;
      else
        for (const sim::CanFrame& reply : replies) socket_.send(reply);
    }
  }

  sim::CanSocket socket_;
  sim::MoteusAxis axis_{3};
  std::thread thread_;
  std::atomic<bool> ending_{false};
  std::mutex mutex_;
  std::vector<Taken> taken_;
};

class ClockAsks : public ::testing::Test {
 protected:
  ClockAsks() {
    std::string errors;
    robot_ = parse_robot_file(kRobot, "arm.toml", errors);
    EXPECT_TRUE(robot_) << errors;
    TransportLinkOptions options;
    options.kind = "socketcan";
    options.by_clock = robot_->realtime.by_clock;
    link_ = make_transport_link(*robot_, options, errors);
    EXPECT_TRUE(link_) << errors;
  }

  /// A tick and its command. Returns the number of the frame that the measurement answers; below zero: nothing fresh.
  int tick() {
    const Sensed sensed = link_->wait(stop_);
    EXPECT_EQ(tiller_status_ok, sensed.fault);
    due_us_ = link_->timer()->due_ns() / 1000;
    EXPECT_EQ(0, (link_->timer()->due_ns() - first_ns()) % std::llround(1e9 * kPeriod_s)) << "on the grid, always";
    EXPECT_GE(sensed.now_us, due_us_);
    tiller_command_t command{};
    command.stamp_us = sensed.now_us;
    command.state = tiller_state_active;
    command.sequence = sensed.measurement.sequence;
    (void)link_->send(command);
    now_us_ = sensed.now_us;
    if (!sensed.fresh) return -1;
    // whatever it answers, it came in this tick; two clocks are read one after the other, on a machine that may stand
    // still between
    ++answers_;
    strays_ += sensed.measurement.stamp_us < due_us_ - 20000;
    EXPECT_LE(sensed.measurement.stamp_us, sensed.now_us);
    EXPECT_GE(sensed.measurement.command_latency_us, sensed.now_us - sensed.measurement.stamp_us);
    return static_cast<int>(std::lround(sensed.measurement.value[0] / kStep_rad));
  }

  /// The measurement answers this tick's question. On a machine that stands still, a drive may take the command before
  /// so late that its answer comes behind the question: it cannot be told from the question's own, and is counted here.
  bool is_own_answer(int number) {
    const std::vector<Drive::Taken> taken = drive_.taken();
    if (static_cast<std::size_t>(number) >= taken.size()) return false;
    const Drive::Taken& frame = taken[static_cast<std::size_t>(number)];
    return frame.question && frame.at_us >= due_us_ && frame.at_us <= now_us_;
  }

  struct Count {
    int fresh = 0, own = 0;
  };
  Count ticks(int count) {
    Count found;
    for (int k = 0; k < count; ++k) {
      const int number = tick();
      found.fresh += number >= 0;
      found.own += number >= 0 && is_own_answer(number);
    }
    return found;
  }

  /// Ticks until a round of them is as good as asked for: a machine that others slow down stands still in one, not in
  /// six.
  Count good_round(int count, int fresh, int strange) {
    Count found;
    for (int round = 0; round < 6; ++round) {
      found = ticks(count);
      if (found.fresh >= fresh && found.own >= found.fresh - strange) break;
    }
    return found;
  }

  void TearDown() override { EXPECT_LE(strays_, answers_ / 5) << "answers with stamps of before their ticks"; }

  /// Frames that the drive has taken, once the tick's command is among them.
  std::size_t taken_with_command() {
    for (int i = 0; i < 6000 && (drive_.taken().empty() || drive_.taken().back().question); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return drive_.taken().size();
  }

  std::int64_t first_ns() {
    if (first_ns_ == 0) first_ns_ = link_->timer()->due_ns();
    return first_ns_;
  }

  std::unique_ptr<RobotFile> robot_;
  Drive drive_;
  std::unique_ptr<Link> link_;
  const volatile std::sig_atomic_t stop_ = 0;
  std::int64_t first_ns_ = 0, due_us_ = 0, now_us_ = 0;
  int answers_ = 0, strays_ = 0;
};

TEST_F(ClockAsks, EveryTickHasTheAnswerToItsOwnQuestion) {
  (void)tick();  // the drive may not be listening yet
  const Count found = good_round(20, 15, 3);
  // an emulated machine may stand still for half a period, and then there is no answer in time
  EXPECT_GE(found.fresh, 15);
  EXPECT_GE(found.own, found.fresh - 3);
  std::printf("%d of 20 ticks had an answer, %d that to their own question\n", found.fresh, found.own);
}

TEST_F(ClockAsks, ASilentDriveCostsHalfAPeriodAndNoTick) {
  (void)ticks(3);
  drive_.manner = Drive::Manner::kIsSilent;
  (void)tick();  // what is under way
  const std::size_t before = taken_with_command();
  for (int k = 0; k < 5; ++k) {
    EXPECT_LT(tick(), 0);
    EXPECT_GE(now_us_, due_us_ + std::llround(1e6 * kPeriod_s / 2)) << "it waits that long for the answer";
  }
  EXPECT_EQ(taken_with_command() - before, 10u) << "a question and a command a tick";
  drive_.manner = Drive::Manner::kAnswers;
  EXPECT_GE(good_round(10, 8, 3).own, 5);
}

TEST_F(ClockAsks, AnAnswerThatComesTooLateIsNoneToTheNextQuestion) {
  (void)ticks(3);
  drive_.manner = Drive::Manner::kAnswersLate;  // behind the command, when the tick is over
  (void)tick();
  const Count late = ticks(10);
  EXPECT_LE(late.fresh, 3) << "of the questions before, answers wait to be read";
  EXPECT_EQ(late.own, 0);
  drive_.manner = Drive::Manner::kAnswers;
  EXPECT_GE(good_round(10, 8, 3).own, 5);
}

}  // namespace
}  // namespace tiller::tools
