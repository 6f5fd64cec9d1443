#pragma once

#include <cstddef>
#include <cstdint>

// Names of array elements, "cost.target[17]", made by the compiler: a finding's field is a literal, so that nothing
// formats text at run time, and no list of names has to follow the capacities of model.h.

namespace tiller {

/// kCount texts of one stride. Static storage only: what reads a name keeps a pointer into it.
template <std::uint32_t kCount, std::size_t kStride>
struct ElementNames {
  char text[kCount][kStride] = {};
  constexpr const char* operator[](std::size_t i) const { return text[i]; }
};

/// The field's own name.
template <std::size_t kLength>
constexpr ElementNames<1, kLength> single_name(const char (&field)[kLength]) {
  ElementNames<1, kLength> names;
  for (std::size_t k = 0; k < kLength; ++k) names.text[0][k] = field[k];
  return names;
}

/// "field[0]" to "field[kCount - 1]".
template <std::uint32_t kCount, std::size_t kLength>
constexpr ElementNames<kCount, kLength + 4> element_names(const char (&field)[kLength]) {
  static_assert(kCount <= 100, "two digits");
  ElementNames<kCount, kLength + 4> names;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    char* at = names.text[i];
    for (std::size_t k = 0; k + 1 < kLength; ++k) *at++ = field[k];
    *at++ = '[';
    if (i >= 10) *at++ = static_cast<char>('0' + i / 10);
    *at++ = static_cast<char>('0' + i % 10);
    *at++ = ']';
  }
  return names;
}

}  // namespace tiller
