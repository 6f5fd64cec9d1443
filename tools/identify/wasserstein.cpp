#include "tools/identify/wasserstein.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "tools/identify/coordinates.hpp"

namespace tiller::tools {

double sorted_wasserstein_1d(const double* a, const double* b, std::size_t n) {
  double sum = 0;
  for (std::size_t i = 0; i < n; ++i) sum += std::fabs(a[i] - b[i]);
  return sum / static_cast<double>(n);
}

double wasserstein_1d(double* a, double* b, std::size_t n) {
  std::sort(a, a + n);
  std::sort(b, b + n);
  return sorted_wasserstein_1d(a, b, n);
}

std::vector<double> slice_directions(std::size_t count, std::size_t dimension) {
  std::vector<double> all(count * dimension);
  for (std::size_t l = 0; l < count; ++l) {
    Rng rng(0, kRngDirection, l);
    double* direction = all.data() + l * dimension;
    double square = 0;
    for (std::size_t i = 0; i < dimension; ++i) {
      direction[i] = rng.normal();
      square += direction[i] * direction[i];
    }
    for (std::size_t i = 0; i < dimension; ++i) direction[i] /= std::sqrt(square);
  }
  return all;
}

}  // namespace tiller::tools
