#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

#include "tiller/model.h"
#include "tools/gap/fit/hypothesis.hpp"

namespace tiller::tools::gap {

// Matrices of a fit's normal equations, their memory within themselves.
template <int kMost>
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
template <int kMost>
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;
// Of a window's start: states, then what effects have that nobody sees.
constexpr int kMostStarts = TILLER_MAX_STATES + static_cast<int>(kMostUnseen);
using StateSquare = Square<kMostStarts>;
using StateVector = Vector<kMostStarts>;
using ParamSquare = Square<TILLER_MAX_PARAMS>;
using ParamVector = Vector<TILLER_MAX_PARAMS>;
using Coupling = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostStarts, TILLER_MAX_PARAMS>;

// A window's step of the start state for a step of the parameters: first + second * step.
struct Elimination {
  StateVector first;
  Coupling second;
};

using GramMap = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

inline Eigen::LDLT<StateSquare> damped(const GramMap& gram, std::uint32_t nx, double damping) {
  StateSquare a = gram.topLeftCorner(nx, nx);
  double largest = 1e-12;
  for (std::uint32_t i = 0; i < nx; ++i) largest = std::max(largest, a(i, i));
  const double floor = 1e-9 * largest;
  for (std::uint32_t i = 0; i < nx; ++i) a(i, i) += damping * a(i, i) + floor;
  return Eigen::LDLT<StateSquare>(a);
}

inline Elimination eliminate(const GramMap& gram, std::uint32_t nx, std::uint32_t nf, double damping) {
  const Eigen::LDLT<StateSquare> factor = damped(gram, nx, damping);
  Elimination e;
  e.first = factor.solve(StateVector(gram.block(0, nx + nf, nx, 1)));
  e.second = -factor.solve(Coupling(gram.block(0, nx, nx, nf)));
  return e;
}

}  // namespace tiller::tools::gap
