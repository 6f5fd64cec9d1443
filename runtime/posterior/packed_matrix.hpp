#pragma once

#include <cstdint>

namespace tiller {

/// Distinct elements of a symmetric matrix, row by row from the diagonal on: 00 01 02 .. 11 12 ..
constexpr std::uint32_t upper_triangle(std::uint32_t size) { return size * (size + 1) / 2; }

/// Largest matrix below.
constexpr std::uint32_t kMaxPacked = 16;

/// Inverse of a symmetric positive definite matrix, both as upper triangles, and the logarithm of its determinant.
/// size <= kMaxPacked. Cost: O(size^3).
void invert_packed(std::uint32_t size, const double* matrix, double* inverse, double& log_determinant);
/// product (size) = m x
void multiply_packed(std::uint32_t size, const double* m, const double* x, double* product);
/// x' m x
double quadratic_packed(std::uint32_t size, const double* m, const double* x);

}  // namespace tiller
