#pragma once

#include <vector>

/// Derivatives of the imported function in lanes, every point in a lane of its own: (points x states). Points: x, u, f,
/// p one behind the other.
using Rows = std::vector<std::vector<double>>;
