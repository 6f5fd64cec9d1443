#pragma once

#include <cstdint>
#include <vector>

namespace tiller::tools {

/// Wasserstein-1 distance of two sets of n numbers, all of equal mass: the least mean distance over all ways to pair
/// them. On a line the pairing in sorted order is one of the best, so it is exact. Both arrays are sorted. O(n log n).
double wasserstein_1d(double* a, double* b, std::size_t n);
/// The same of arrays that are sorted already. O(n).
double sorted_wasserstein_1d(const double* a, const double* b, std::size_t n);

/// `count` unit vectors (count x dimension), uniform on the sphere, the same at every call: the sliced distance is the
/// mean of wasserstein_1d over projections on them (Rabin, Peyre, Delon, Bernot, SSVM 2011).
std::vector<double> slice_directions(std::size_t count, std::size_t dimension);

}  // namespace tiller::tools
