#pragma once

#include <cstddef>
#include <cstdint>

namespace tiller {

/// The message that holds a measured value.
enum class Ros2Message : std::uint8_t { kJointState, kImu, kOdometry };
constexpr std::uint32_t kRos2Messages = 3;

/// Numbers of an Imu or an Odometry, by their place in kImuFields or kOdometryFields, the angles of its orientation
/// behind them.
constexpr const char* kImuFields[] = {"orientation.x",
                                      "orientation.y",
                                      "orientation.z",
                                      "orientation.w",
                                      "angular_velocity.x",
                                      "angular_velocity.y",
                                      "angular_velocity.z",
                                      "linear_acceleration.x",
                                      "linear_acceleration.y",
                                      "linear_acceleration.z",
                                      "roll",
                                      "pitch",
                                      "yaw"};
constexpr const char* kOdometryFields[] = {"position.x",    "position.y",    "position.z",    "orientation.x",
                                           "orientation.y", "orientation.z", "orientation.w", "linear.x",
                                           "linear.y",      "linear.z",      "angular.x",     "angular.y",
                                           "angular.z",     "roll",          "pitch",         "yaw"};
constexpr const char* kJointFields[] = {"position", "velocity", "effort"};
constexpr std::size_t kRos2Numbers = 16;

/// Where a measured value comes from: "position:shoulder", "velocity:shoulder", "effort:shoulder" of a JointState,
/// "imu:angular_velocity.z", "odometry:position.x".
struct Ros2Source {
  static constexpr std::size_t kJoint = 64;

  Ros2Message message = Ros2Message::kJointState;
  std::uint8_t field = 0;  ///< in the message's list of fields
  char joint[kJoint] = "";
};

/// Of a PoseStamped, which sets goals.
constexpr const char* kPoseFields[] = {"position.x",    "position.y",    "position.z", "orientation.x", "orientation.y",
                                       "orientation.z", "orientation.w", "roll",       "pitch",         "yaw"};
/// The place in kPoseFields; -1: there is none.
int ros2_pose_field(const char* text);

/// False: `text` is none.
bool ros2_parse_source(const char* text, Ros2Source* source);

/// What the unit at the end of a measurement's name says: "elbow_rad" and "slide_m" are positions of the joints elbow
/// and slide, "elbow_rad_s" and "slide_m_s" velocities. False: the name ends in another unit.
bool ros2_source_of_name(const char* measurement, Ros2Source* source);

/// Roll, pitch and yaw (rad) of a quaternion, as ROS has them: about x, then y, then z of the fixed axes.
void ros2_angles(const double (&xyzw)[4], double (&angles)[3]);

}  // namespace tiller
