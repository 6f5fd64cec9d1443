#pragma once

#include <dds/dds.h>

#include <cstddef>
#include <cstdint>

namespace tiller {

/// What rmw_cyclonedds adds to DDS: names of topics and types, QoS, and what participants and endpoints announce of
/// themselves. docs/guide/ros2.md says what was compared. Without logic: plants use it as well.
enum class Ros2Type : std::uint8_t {
  kJointState,
  kImu,
  kOdometry,
  kEffort,
  kPoseStamped,
  kJointTrajectory,
  kDiagnostics,
  kParticipantEntities,
};

struct Ros2TypeInfo {
  const dds_topic_descriptor_t* descriptor;
  const char* hash;  ///< RIHS01 of the .msg file, as endpoints of ROS 2 Iron and newer announce it
};
const Ros2TypeInfo& ros2_type(Ros2Type type);

/// Reliable and a history of 10, or ROS 2's sensor data: best effort and a history of 5, which matches any publisher.
enum class Ros2Qos : std::uint8_t { kReliable, kSensorData };

constexpr std::size_t kRos2Topic = 128;

/// "joint_states" and "/joint_states" are "rt/joint_states" in DDS. False: it is no name of a ROS 2 topic, or too long.
bool ros2_topic(const char* name, char (&topic)[kRos2Topic]);

/// A participant of the domain ROS_DOMAIN_ID (0). CYCLONEDDS_URI says the rest, as for every program with Cyclone DDS;
/// ROS_LOCALHOST_ONLY=1 keeps to loopback. Negative: dds_strretcode() says why.
dds_entity_t ros2_participant();

/// Samples of this process that Cyclone DDS could not decode. It would print a line for each, from the thread that
/// receives: a flood of them on a slow terminal, or in a pipe that nobody reads, held up every topic.
std::uint64_t ros2_undecodable();

/// `topic` as ros2_topic() made it. Deleted with the participant. Negative: dds_strretcode() says why.
dds_entity_t ros2_reader(dds_entity_t participant, Ros2Type type, const char* topic, Ros2Qos qos,
                         const dds_listener_t* listener);
/// A write never waits: what a full history has no room for is refused with DDS_RETCODE_TIMEOUT.
dds_entity_t ros2_writer(dds_entity_t participant, Ros2Type type, const char* topic);

/// A node of ROS 2's graph: what `ros2 node list` and `ros2 node info` show of a participant.
struct Ros2Node {
  const char* name;  ///< without a namespace: letters, digits and _
  const dds_entity_t* readers;
  std::size_t reader_count;
  const dds_entity_t* writers;
  std::size_t writer_count;
};
/// Tells whoever is there or comes later that the participant is that node. Uses the heap. Negative: dds_strretcode()
/// says why.
dds_return_t ros2_announce(dds_entity_t participant, const Ros2Node& node);

/// Why nothing comes on this topic, from what participants announce: another type, another QoS, nobody. A literal, or
/// in `text`. Uses the heap.
void ros2_explain_silence(dds_entity_t participant, dds_entity_t reader, Ros2Type type, const char* topic, char* text,
                          std::size_t size);

}  // namespace tiller
