#pragma once

#include <cstddef>

namespace tiller {

/// An element of an array that may be left out: `otherwise` where there is none.
constexpr double element_or(const double* array, std::size_t index, double otherwise) {
  return array != nullptr ? array[index] : otherwise;
}

}  // namespace tiller
