#include "ros2/ros2_goal_reader.hpp"

#include <cstring>

#include "ros2/ros2_wire.hpp"
#include "ros2_messages.h"

namespace tiller {
namespace {

constexpr int kTrajectory = 0, kPose = 1;
constexpr Ros2Type kTypes[] = {Ros2Type::kJointTrajectory, Ros2Type::kPoseStamped};

bool take_valid(std::int32_t reader, void* sample) {
  dds_sample_info_t info;
  while (reader > 0 && dds_take(reader, &sample, &info, 1, 1) == 1)
    if (info.valid_data) return true;
  return false;
}

}  // namespace

tiller_status_t Ros2GoalReader::open_one(int which, const char* name, OpenError* error) {
  if (*name == '\0') return tiller_status_ok;
  char topic[kRos2Topic];
  if (!ros2_topic(name, topic)) {
    set_open_error(error, "ros2: '%.100s' is no name of a topic of goals", name);
    return tiller_status_bad_message;
  }
  sample_[which] = dds_alloc(ros2_type(kTypes[which]).descriptor->m_size);
  reader_[which] = ros2_reader(participant_, kTypes[which], topic, Ros2Qos::kReliable, nullptr);
  if (reader_[which] > 0) return tiller_status_ok;
  set_open_error(error, "ros2: cannot read '%.100s': %s", topic, dds_strretcode(reader_[which]));
  return tiller_status_io_error;
}

tiller_status_t Ros2GoalReader::open(const char* trajectory, const char* pose, const char* node, OpenError* error) {
  participant_ = ros2_participant();
  if (participant_ < 0) {
    set_open_error(error, "ros2: cannot join the domain: %s; is CYCLONEDDS_URI right?", dds_strretcode(participant_));
    return tiller_status_io_error;
  }
  const char* const names[] = {trajectory, pose};
  for (int which = 0; which < 2; ++which) {
    const tiller_status_t status = open_one(which, names[which], error);
    if (status != tiller_status_ok) return status;
  }
  dds_entity_t readers[2];
  std::size_t count = 0;
  for (const std::int32_t reader : reader_)
    if (reader > 0) readers[count++] = reader;
  const dds_return_t told = ros2_announce(participant_, {node, readers, count, nullptr, 0});
  if (told >= 0) return tiller_status_ok;
  set_open_error(error, "ros2: cannot announce the node '%.100s': %s", node, dds_strretcode(told));
  return tiller_status_io_error;
}

void Ros2GoalReader::close() {
  if (participant_ > 0) (void)dds_delete(participant_);
  participant_ = 0;
  for (int i = 0; i < 2; ++i) {
    if (sample_[i] != nullptr) dds_sample_free(sample_[i], ros2_type(kTypes[i]).descriptor, DDS_FREE_ALL);
    sample_[i] = nullptr;
    reader_[i] = 0;
  }
}

bool Ros2GoalReader::take(Ros2JointGoal* goal) {
  if (!take_valid(reader_[kTrajectory], sample_[kTrajectory])) return false;
  const auto& message = *static_cast<const trajectory_msgs_msg_dds__JointTrajectory_*>(sample_[kTrajectory]);
  *goal = Ros2JointGoal();
  if (message.points._length == 0) return true;
  const auto& last = message.points._buffer[message.points._length - 1];
  goal->joint = message.joint_names._buffer;
  goal->joints = message.joint_names._length;
  goal->position = last.positions._buffer;
  goal->positions = last.positions._length;
  goal->velocity = last.velocities._buffer;
  goal->velocities = last.velocities._length;
  return true;
}

bool Ros2GoalReader::take(double (&pose)[kRos2PoseNumbers]) {
  if (!take_valid(reader_[kPose], sample_[kPose])) return false;
  const auto& message = *static_cast<const geometry_msgs_msg_dds__PoseStamped_*>(sample_[kPose]);
  const auto& p = message.pose.position;
  const auto& q = message.pose.orientation;
  double angles[3];
  ros2_angles({q.x, q.y, q.z, q.w}, angles);
  const double numbers[] = {p.x, p.y, p.z, q.x, q.y, q.z, q.w, angles[0], angles[1], angles[2]};
  std::memcpy(pose, numbers, sizeof numbers);
  return true;
}

}  // namespace tiller
