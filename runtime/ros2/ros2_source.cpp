#include "ros2/ros2_source.hpp"

#include <cmath>
#include <cstring>

namespace tiller {
namespace {

bool copy_name(const char* text, std::size_t length, char (&name)[Ros2Source::kJoint]) {
  if (length == 0 || length >= sizeof name) return false;
  std::memcpy(name, text, length);
  name[length] = '\0';
  return true;
}

template <std::size_t kCount>
bool find_field(const char* const (&fields)[kCount], const char* word, std::size_t length, std::uint8_t* field) {
  for (std::size_t i = 0; i < kCount; ++i) {
    if (std::strlen(fields[i]) != length || std::strncmp(fields[i], word, length) != 0) continue;
    *field = static_cast<std::uint8_t>(i);
    return true;
  }
  return false;
}

bool is_word(const char* word, const char* text, std::size_t length) {
  return std::strlen(word) == length && std::strncmp(word, text, length) == 0;
}

}  // namespace

bool ros2_parse_source(const char* text, Ros2Source* source) {
  *source = Ros2Source();
  const char* colon = std::strchr(text, ':');
  if (colon == nullptr) return false;
  const auto length = static_cast<std::size_t>(colon - text);
  const char* rest = colon + 1;
  if (is_word("imu", text, length)) {
    source->message = Ros2Message::kImu;
    return find_field(kImuFields, rest, std::strlen(rest), &source->field);
  }
  if (is_word("odometry", text, length)) {
    source->message = Ros2Message::kOdometry;
    return find_field(kOdometryFields, rest, std::strlen(rest), &source->field);
  }
  return find_field(kJointFields, text, length, &source->field) && copy_name(rest, std::strlen(rest), source->joint);
}

int ros2_pose_field(const char* text) {
  std::uint8_t field;
  return find_field(kPoseFields, text, std::strlen(text), &field) ? field : -1;
}

bool ros2_source_of_name(const char* measurement, Ros2Source* source) {
  struct Ending {
    const char* unit;
    std::uint8_t field;
  };
  constexpr Ending kEndings[] = {{"_rad_s", 1}, {"_m_s", 1}, {"_rad", 0}, {"_m", 0}};
  *source = Ros2Source();
  const std::size_t length = std::strlen(measurement);
  for (const Ending& ending : kEndings) {
    const std::size_t unit = std::strlen(ending.unit);
    if (length <= unit || std::strcmp(measurement + length - unit, ending.unit) != 0) continue;
    source->field = ending.field;
    return copy_name(measurement, length - unit, source->joint);
  }
  return false;
}

void ros2_angles(const double (&q)[4], double (&angles)[3]) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  const double sine = 2 * (w * y - z * x);
  angles[0] = std::atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  angles[1] = std::fabs(sine) >= 1 ? std::copysign(std::acos(0.0), sine) : std::asin(sine);
  angles[2] = std::atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

}  // namespace tiller
