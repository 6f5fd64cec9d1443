#include "posterior/packed_matrix.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

void invert_packed(std::uint32_t size, const double* matrix, double* inverse, double& log_determinant) {
  // A = U' U row by row, then columns of U^-1 and U^-1 U^-T
  double u[kMaxPacked][kMaxPacked] = {}, v[kMaxPacked][kMaxPacked] = {};
  log_determinant = 0.0;
  for (std::uint32_t r = 0; r < size; ++r)
    for (std::uint32_t c = r; c < size; ++c) {
      double rest = *matrix++;
      for (std::uint32_t k = 0; k < r; ++k) rest -= u[k][r] * u[k][c];
      u[r][c] = r == c ? std::sqrt(rest) : rest / u[r][r];
      if (r == c) log_determinant += 2.0 * math::log(u[r][r]);
    }
  for (std::uint32_t c = 0; c < size; ++c)
    for (std::uint32_t r = c + 1; r-- > 0;) {
      double rest = r == c ? 1.0 : 0.0;
      for (std::uint32_t k = r + 1; k <= c; ++k) rest -= u[r][k] * v[k][c];
      v[r][c] = rest / u[r][r];
    }
  for (std::uint32_t r = 0; r < size; ++r)
    for (std::uint32_t c = r; c < size; ++c, ++inverse) {
      *inverse = 0.0;
      for (std::uint32_t k = c; k < size; ++k) *inverse += v[r][k] * v[c][k];
    }
}

void multiply_packed(std::uint32_t size, const double* m, const double* x, double* product) {
  for (std::uint32_t r = 0; r < size; ++r) product[r] = 0.0;
  for (std::uint32_t r = 0; r < size; ++r)
    for (std::uint32_t c = r; c < size; ++c, ++m) {
      product[r] += *m * x[c];
      if (c != r) product[c] += *m * x[r];
    }
}

double quadratic_packed(std::uint32_t size, const double* m, const double* x) {
  double product[kMaxPacked], sum = 0.0;
  multiply_packed(size, m, x, product);
  for (std::uint32_t i = 0; i < size; ++i) sum += x[i] * product[i];
  return sum;
}

}  // namespace tiller
