#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "rollout/attitude.hpp"

namespace tiller::tools {

/// q and -q are one attitude: rows of states (a column each, empty: not there) go on with the sign that is nearer to
/// the last row that has all four.
inline void take_near_signs(std::uint32_t quaternions, std::vector<std::vector<double>>& columns) {
  for_quaternions(quaternions, [&](std::uint32_t first) {
    const std::size_t rows = columns[first].size();
    for (std::uint32_t i = first + 1; i < first + 4; ++i)
      if (columns[i].size() != rows) return;
    double last[4] = {};
    for (std::size_t k = 0; k < rows; ++k) {
      double along = 0;
      for (std::uint32_t i = 0; i < 4; ++i) along += columns[first + i][k] * last[i];
      if (!std::isfinite(along)) continue;
      for (std::uint32_t i = 0; i < 4; ++i) {
        double& value = columns[first + i][k];
        if (along < 0) value = -value;
        last[i] = value;
      }
    }
  });
}

}  // namespace tiller::tools
