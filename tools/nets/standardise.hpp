#pragma once

#include "tools/nets/mlp.hpp"

namespace tiller::tools::nets {

/// Mean and standard deviation of each row, for inputs and targets of order one.
struct Standardiser {
  Vector mean, sd;

  /// Of x (rows x samples). A row without spread gets a standard deviation of one.
  static Standardiser of(const Matrix& x);
  Matrix apply(const Matrix& x) const;   ///< (x - mean) / sd
  Matrix revert(const Matrix& z) const;  ///< mean + sd z
};

}  // namespace tiller::tools::nets
