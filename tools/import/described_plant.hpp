#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "sim/mechanisms/tree.hpp"

namespace tiller::tools {

/// How a description becomes a plant: what `tiller import` was told of it.
struct DescribedPlant {
  std::string file;   ///< the description
  std::string frame;  ///< the link, or the point on one, that carries a payload; empty: none
  std::map<std::string, double> hold, armature;
};

/// The tree for the plant, with the names that the imported model has. Null with every problem in `errors`.
std::shared_ptr<const sim::Tree> describe_plant(const DescribedPlant& plant, std::vector<std::string>& errors);

}  // namespace tiller::tools
