// Run by in_network_namespace.sh. The heap calls of ten thousand ticks over the wire, once everything is warm: of the
// thread that ticks, and of Cyclone DDS's own. The robot is another process. It takes malloc's place.
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>

#include "heap_trap.hpp"
#include "io/monotonic_clock.hpp"
#include "ros2/ros2_transport.hpp"
#include "ros2/ros2_wire.hpp"
#include "ros2_messages.h"

namespace tiller {
namespace {

constexpr int kWarm = 2000, kTicks = 10000;

/// Publishes a stamp, waits for its command, and so on; every eleventh message is for another robot.
int be_the_robot() {
  const dds_entity_t participant = ros2_participant();
  const dds_entity_t states = ros2_writer(participant, Ros2Type::kJointState, "rt/joint_states");
  const dds_entity_t efforts =
      ros2_reader(participant, Ros2Type::kEffort, "rt/arm/commands", Ros2Qos::kReliable, nullptr);
  char first[] = "shoulder", second[] = "elbow", other[] = "wrist", frame[] = "base";
  char* names[] = {first, second};
  double values[] = {0.5, 1};
  for (int k = 1;; ++k) {
    sensor_msgs_msg_dds__JointState_ message{};
    message.header.stamp.sec = k;
    message.header.frame_id = frame;
    names[1] = k % 11 == 0 ? other : second;
    message.name._buffer = names;
    message.name._length = message.position._length = 2;
    message.position._buffer = values;
    if (dds_write(states, &message) != DDS_RETCODE_OK) return 1;
    for (int tries = 0; tries < 2000; ++tries) {
      void* sample = nullptr;
      dds_sample_info_t info;
      const dds_return_t count = dds_take(efforts, &sample, &info, 1, 1);
      if (count < 0) return 1;
      if (count == 1) (void)dds_return_loan(efforts, &sample, 1);
      if (count == 1 && info.source_timestamp == k * std::int64_t{1000000000}) break;
      if (k % 11 == 0 && tries > 0) break;
      dds_sleepfor(20000);
    }
  }
}

struct Bench {
  Ros2Transport transport;
  int ticks = 0, taken = 0, failures = 0;
};

void tick(void* arg) {
  Bench& bench = *static_cast<Bench*>(arg);
  for (int k = 0; k < bench.ticks;) {
    tiller_measurement_t measurement;
    const tiller_status_t status = kRos2Transport.poll(&bench.transport, &measurement);
    if (status == tiller_status_no_new_measurement) {
      pollfd wanted = {kRos2Transport.descriptor(&bench.transport), POLLIN, 0};
      if (::poll(&wanted, 1, 60000) <= 0) return;
      continue;
    }
    bench.failures += status != tiller_status_ok;
    tiller_command_t command{};
    command.value[0] = measurement.value[0];
    bench.failures += kRos2Transport.send(&bench.transport, &command) != tiller_status_ok;
    ++bench.taken;
    ++k;
  }
}

TEST(Ros2Heap, TheTickHasNoAllocationOfItsOwn) {
  const pid_t robot = fork();
  ASSERT_GE(robot, 0);
  if (robot == 0) _exit(be_the_robot());
  static Bench bench;
  Ros2Options options;
  options.measurement_count = options.input_count = 2;
  options.commands = "arm/commands";
  options.lockstep = true;
  ASSERT_TRUE(ros2_parse_source("position:shoulder", &options.source[0]));
  ASSERT_TRUE(ros2_parse_source("position:elbow", &options.source[1]));
  OpenError error;
  ASSERT_EQ(tiller_status_ok, ros2_transport_open(&bench.transport, options, &error)) << error.text;
  bench.ticks = kWarm;
  tick(&bench);
  bench.ticks = kTicks;
  const std::uint64_t before = tiller_test::heap_calls_here;
  const std::uint64_t calls = tiller_test::heap_calls_in(tick, &bench);
  const std::uint64_t own = tiller_test::heap_calls_here - before;
  (void)kill(robot, SIGKILL);
  (void)waitpid(robot, nullptr, 0);
  EXPECT_EQ(0, bench.failures);
  EXPECT_EQ(kWarm + kTicks, bench.taken);
  EXPECT_GT(bench.transport.counters.bad_messages, static_cast<std::uint64_t>(kTicks / 12));
  // What is left are Cyclone's pools of messages that are in use at once, which grow now and then (5 to 30 calls); a
  // call of tiller's own would come with every tick.
  EXPECT_LT(own, static_cast<std::uint64_t>(kTicks / 50));
  std::printf("%d ticks: %llu heap calls of the ticking thread, %llu of Cyclone DDS's threads\n", kTicks,
              static_cast<unsigned long long>(own), static_cast<unsigned long long>(calls - own));
  kRos2Transport.close(&bench.transport);
}

}  // namespace
}  // namespace tiller
