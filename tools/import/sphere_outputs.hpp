#pragma once

#include "tools/base/spheres.hpp"
#include "tools/import/mechanism.hpp"

namespace tiller::tools {

/// A sphere's centre in the frame of the body that carries it.
struct PlacedSphere {
  std::string name;
  int body = -1;  ///< -1: the base, or an obstacle
  Vec3<double> at{};
};

/// A distance that the model tells: of two centres, or of a centre from the plane z = 0 of the base.
struct SphereOutput {
  std::string name;
  int a = -1, b = -1;  ///< indices of `placed`; b -1: the height of a
};

struct SphereOutputs {
  std::vector<PlacedSphere> placed;
  std::vector<SphereOutput> outputs;
};

/// Finds the bodies of the spheres and the pairs that are to be kept apart: neither on one body nor on neighbours,
/// which touch where they are joined, nor on links that may touch. False with what is wrong in `errors`.
bool place_spheres(const Spheres& spheres, const Mechanism& mechanism, SphereOutputs& out,
                   std::vector<std::string>& errors);

}  // namespace tiller::tools
