#pragma once

#include <atomic>
#include <cstdint>

#include "io/answer_memory.hpp"
#include "io/open_error.hpp"
#include "ros2/ros2_source.hpp"
#include "tiller/transport.h"

namespace tiller {

/// ROS 2's topics through Cyclone DDS: sensor_msgs/JointState (Imu, nav_msgs/Odometry) in, std_msgs/Float64MultiArray
/// out, as ros2_control's effort controllers read it. docs/guide/ros2.md is the robot's view.
struct Ros2Options {
  const char* joint_states = "joint_states";  ///< topics, of messages that a source names
  const char* imu = "imu";
  const char* odometry = "odom";
  const char* commands = "";    ///< topic
  const char* node = "tiller";  ///< name in ROS 2's graph: letters, digits and _
  std::uint32_t measurement_count = 0;
  std::uint32_t input_count = 0;
  Ros2Source source[TILLER_MAX_MEASUREMENTS];
  /// Of a measurement out of several messages: the first source's message makes it, and the others' last ones count
  /// where their stamps are no farther from it than this. Else their values are missing.
  std::int64_t together_us = 20000;
  /// A message that waited longer than this between its arrival and poll is refused (as over LCM). 0: never.
  std::int64_t max_wait_us = 500000;
  /// Take the time of arrival by this machine's monotonic clock: for publishers with a clock of their own. Else
  /// header.stamp is of this machine's system clock.
  bool stamp_on_arrival = false;
  /// The publisher waits for each answer, so the stamps are the time. A command's source timestamp is the header.stamp
  /// that it answers; a repeated message gets the same command again.
  bool lockstep = false;
};

/// The reader of one topic; `arrived` is written by a thread of Cyclone DDS.
struct Ros2Reader {
  std::int32_t entity = 0;
  void* sample = nullptr;  // of the message's C type, used again and again
  int event = -1;          // the transport's
  std::atomic<std::int64_t> arrived_us{0};
  bool has_numbers = false;
  std::int64_t time_us = 0;          // of the numbers: their stamp, or when they arrived
  double number[kRos2Numbers] = {};  // of an Imu or an Odometry
};

/// Owned by the caller, filled by ros2_transport_open; it must not move. One thread at a time.
struct Ros2Transport {
  static constexpr std::int64_t kQuietUs = 2000000;  ///< after it older stamps count again: see SequenceGate
  static constexpr std::size_t kSeen = 200;

  Ros2Options options;  // its names are not kept
  std::int32_t participant = 0, writer = 0, diagnostics = 0;
  int event = -1;  // an eventfd: something has arrived
  Ros2Reader reader[kRos2Messages];
  double joint_value[TILLER_MAX_MEASUREMENTS] = {};
  void* command = nullptr;
  std::int64_t gate_ns = INT64_MIN, accepted_us = 0;  // the newest stamp, and when it came
  std::int64_t answered_ns = 0;                       // in lockstep
  std::uint32_t sequence = 0;
  AnswerMemory answers;  // in lockstep
  std::uint64_t repeated_answers = 0;
  bool has_new = false;
  tiller_measurement_t newest{};
  tiller_transport_counters_t counters{};
  std::uint64_t undecodable = 0;  // of this process, when it was opened
  /// Why a message was last refused (a literal), for a tool's report; null if none was. `refused_source` is the value
  /// that was looked for and `seen` the names of the joints that the message had, where that is the reason.
  const char* refusal = nullptr;
  const Ros2Source* refused_source = nullptr;
  char seen[kSeen] = "";
};

extern const tiller_transport_t kRos2Transport;

/// Makes the participant, its readers and its writer. The only call that uses the heap on tiller's own account; Cyclone
/// DDS has threads and a heap of its own.
[[nodiscard]] tiller_status_t ros2_transport_open(Ros2Transport* transport, const Ros2Options& options,
                                                  OpenError* error);

/// One entry of diagnostic_msgs/DiagnosticArray on /diagnostics.
struct Ros2Diagnostics {
  static constexpr std::uint32_t kValues = 12;
  struct Value {
    const char* key;
    char text[48];
  };

  std::uint8_t level = 0;  ///< 0 OK, 1 WARN, 2 ERROR
  const char* name = "";
  const char* message = "";
  std::uint32_t count = 0;
  Value value[kValues];
};
/// Stamped by this machine's system clock.
tiller_status_t ros2_send_diagnostics(Ros2Transport* transport, const Ros2Diagnostics& diagnostics);

/// Why nothing has come, for a tool's report: nobody publishes, another type, another QoS. Empty where messages came.
/// Uses the heap.
void ros2_silence(const Ros2Transport* transport, char* text, std::size_t size);

}  // namespace tiller
