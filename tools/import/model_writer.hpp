#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/import/sphere_outputs.hpp"
#include "tools/import/unknowns.hpp"

namespace tiller::tools {

/// Names of the emitted model, in its own order.
struct ModelNames {
  std::string type;         ///< the struct: "Ur5"
  std::vector<int> bodies;  ///< of the joints that have states
  std::vector<std::string> joints, positions, velocities, inputs, forces;
  std::vector<int> input_of;  ///< (joints) index into `inputs`; -1: none drives it
};
ModelNames name_model(const Mechanism& mechanism);

struct WrittenModel {
  std::string text;  ///< the header
  ModelNames names;
  int operations = 0;           ///< arithmetic of one call of the dynamics
  int response_operations = 0;  ///< of the inverse inertia
  int output_operations = 0;    ///< of the frames' poses and the spheres' distances
  int slope_operations = 0;     ///< of the accelerations with their slopes and the inverse inertia
};

/// How a point of a body moves: three outputs, along the axes of a frame or of the base.
struct MotionOutput {
  enum class Kind { turning, moving, turning_in_base };
  Kind kind = Kind::turning;
  int body = -1;
  Pose pose;  ///< of the point's frame in the body's
  std::array<std::string, 3> names;
};

/// The equations as a header for [model] file: forward dynamics and the inverse inertia, unrolled, for any scalar. The
/// payload of `body` hangs at `payload_frame` (an index of mechanism.frames; -1: nowhere). `told`: frames whose poses
/// are the model's outputs (tools/base/frame_names.hpp); the distances of `spheres` follow them
/// (tools/base/spheres.hpp), then `motions`.
WrittenModel write_model(const Mechanism& mechanism, const Unknowns& unknowns, int payload_frame,
                         const std::vector<int>& told, const SphereOutputs& spheres = {},
                         const std::vector<MotionOutput>& motions = {});

}  // namespace tiller::tools
