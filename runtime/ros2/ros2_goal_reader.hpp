#pragma once

#include <cstddef>
#include <cstdint>

#include "io/open_error.hpp"
#include "ros2/ros2_source.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The last point of a trajectory_msgs/JointTrajectory, as long as the next one has not been taken.
struct Ros2JointGoal {
  const char* const* joint = nullptr;  // (joints)
  std::uint32_t joints = 0;
  const double* position = nullptr;  // (positions): as many as there are joints, or none
  std::uint32_t positions = 0;
  const double* velocity = nullptr;
  std::uint32_t velocities = 0;
};

constexpr std::size_t kRos2PoseNumbers = sizeof kPoseFields / sizeof *kPoseFields;

/// Goals of ROS 2: JointTrajectory and geometry_msgs/PoseStamped. One thread at a time; it must not move.
class Ros2GoalReader {
 public:
  Ros2GoalReader() = default;
  ~Ros2GoalReader() { close(); }
  Ros2GoalReader(const Ros2GoalReader&) = delete;
  Ros2GoalReader& operator=(const Ros2GoalReader&) = delete;

  /// Topics; an empty one is not read. `node` is the name in ROS 2's graph. Uses the heap.
  [[nodiscard]] tiller_status_t open(const char* trajectory, const char* pose, const char* node, OpenError* error);
  void close();

  /// The next one that has come; false: there is none. A trajectory without points is one without joints.
  bool take(Ros2JointGoal* goal);
  /// (kPoseFields)
  bool take(double (&pose)[kRos2PoseNumbers]);

 private:
  tiller_status_t open_one(int which, const char* name, OpenError* error);

  std::int32_t participant_ = 0;
  std::int32_t reader_[2] = {};
  void* sample_[2] = {};
};

}  // namespace tiller
