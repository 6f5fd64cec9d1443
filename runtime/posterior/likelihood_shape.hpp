#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/cloud.hpp"

namespace tiller {

/// The log likelihood around a cloud: a polynomial of second order in whitened coordinates, by least squares through
/// what some of its particles have. It costs next to nothing to ask, so that a walk may be judged by it before its end
/// is judged by the data. Products are those of the first kMostCurvedCoordinates coordinates.
class LikelihoodShape {
 public:
  static LikelihoodShape lay_out(Arena& arena, std::uint32_t d);

  void clear() { fitted_ = false; }
  /// Through log_likelihood (N) of `count` particles from `first` on (modulo N); mean (d) and root (d x d, lower) are
  /// those of their law. Cost: O(count terms^2). Nothing is believed where they are too few.
  void fit(const Cloud& cloud, std::uint32_t first, std::uint32_t count, const double* mean, const double* root,
           const double* log_likelihood);
  bool fitted() const { return fitted_; }
  /// At v (d); -infinity farther out than the particles that it goes through.
  double at(const double* v) const;

 private:
  bool monomials(const double* v, double* phi) const;
  bool solve();

  std::uint32_t d_ = 0, curved_ = 0, terms_ = 0;
  bool fitted_ = false;
  double trusted_square_ = 0.0;
  double* mean_ = nullptr;         // (d)
  double* root_ = nullptr;         // (d x d)
  double* normal_ = nullptr;       // (terms x terms) lower
  double* coefficient_ = nullptr;  // (terms)
};

}  // namespace tiller
