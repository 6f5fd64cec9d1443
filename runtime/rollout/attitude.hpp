#pragma once

// Unit quaternions in rows of numbers, for code that knows a model by its table.

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "tiller/rotation.hpp"

namespace tiller {

inline Quaternion<double> read_quaternion(const double* at, std::size_t stride = 1) {
  return {at[0], at[stride], at[2 * stride], at[3 * stride]};
}
inline void write_quaternion(const Quaternion<double>& q, double* at, std::size_t stride = 1) {
  at[0] = q.w;
  at[stride] = q.x;
  at[2 * stride] = q.y;
  at[3 * stride] = q.z;
}

/// f(first state) for each quaternion of the mask.
template <class F>
void for_quaternions(std::uint32_t mask, F&& f) {
  for (std::uint32_t i = 0; mask >> i; ++i)
    if ((mask >> i) & 1u) f(i);
}
/// Bits of all four states of each quaternion.
constexpr std::uint32_t quaternion_states(std::uint32_t mask) { return mask | mask << 1 | mask << 2 | mask << 3; }

/// Whether four numbers pass for a unit quaternion as people write them; false where one is not a number.
inline bool is_attitude(const double* at) {
  return std::fabs(std::sqrt(dot(read_quaternion(at), read_quaternion(at))) - 1.0) <= 1e-3;
}
inline bool are_attitudes(std::uint32_t mask, const double* state) {
  bool good = true;
  for_quaternions(mask, [&](std::uint32_t first) { good = good && is_attitude(state + first); });
  return good;
}

/// A small change v of the components of q as a difference: q' (x) v, whose first part is not there.
inline Quaternion<double> to_tangent(const Quaternion<double>& q, const Quaternion<double>& v) {
  Quaternion<double> turn = conjugate(q) * v;
  turn.w = 0.0;
  return turn;
}
/// A matrix m (rows x columns) of derivatives by states, in differences from `state`; element i at m[i * stride],
/// state i at state[i * state_stride].
void to_tangent_columns(std::uint32_t quaternions, const double* state, std::size_t state_stride, std::uint32_t rows,
                        std::uint32_t columns, double* m, std::size_t stride);
/// Derivatives of states, as many columns, as those of differences from `state`.
void to_tangent_rows(std::uint32_t quaternions, const double* state, std::size_t state_stride, std::uint32_t columns,
                     double* m, std::size_t stride);

}  // namespace tiller
