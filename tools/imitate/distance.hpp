#pragma once

#include <vector>

#include "tools/imitate/demonstration.hpp"

namespace tiller::tools::imitate {

/// (nx) RMS of each state over all demonstrations, from where the first one begins; angles wrapped.
Vector spread_of(const Scene& scene, const std::vector<Demonstration>& all);

/// RMS difference of two motions of the same length, each state over its spread; one without spread has no say.
/// Not finite where a motion is not.
double distance(const Scene& scene, const Motion& a, const Motion& b, const Vector& spread);

}  // namespace tiller::tools::imitate
