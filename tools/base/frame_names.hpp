#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace tiller::tools {

/// The outputs that tell where a frame stands in the base's axes: three of its origin, then nine of its rotation, row
/// by row ("tool0_rxz": the x of the frame's z axis). Models that name their outputs so have a frame.
inline std::array<std::string, 12> frame_output_names(const std::string& frame) {
  std::array<std::string, 12> names;
  const char axes[] = "xyz";
  std::size_t at = 0;
  for (int r = 0; r < 3; ++r) names[at++] = frame + "_" + axes[r] + "_m";
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) names[at++] = frame + "_r" + axes[r] + axes[c];
  return names;
}

/// The frame of which `output` is the position along an axis, "imu" of "imu_y_m", where `outputs` have all twelve of
/// it; else empty.
inline std::string frame_under(const std::vector<std::string>& outputs, const std::string& output) {
  const std::string frame = output.substr(0, output.size() - std::min<std::size_t>(output.size(), 4));
  const auto names = frame_output_names(frame);
  const auto has = [&](const std::string& name) {
    return std::find(outputs.begin(), outputs.end(), name) != outputs.end();
  };
  const bool is_position = std::find(names.begin(), names.begin() + 3, output) != names.begin() + 3;
  return is_position && std::all_of(names.begin(), names.end(), has) ? frame : "";
}

/// Roll, pitch and yaw about the fixed axes x, y, z, as a URDF has them: R = Rz(yaw) Ry(pitch) Rx(roll), row by row.
inline std::array<double, 9> rotation_of(const std::array<double, 3>& rpy_rad) {
  const double sr = std::sin(rpy_rad[0]), cr = std::cos(rpy_rad[0]);
  const double sp = std::sin(rpy_rad[1]), cp = std::cos(rpy_rad[1]);
  const double sy = std::sin(rpy_rad[2]), cy = std::cos(rpy_rad[2]);
  return {cy * cp,
          cy * sp * sr - sy * cr,
          cy * sp * cr + sy * sr,
          sy * cp,
          sy * sp * sr + cy * cr,
          sy * sp * cr - cy * sr,
          -sp,
          cp * sr,
          cp * cr};
}

}  // namespace tiller::tools
