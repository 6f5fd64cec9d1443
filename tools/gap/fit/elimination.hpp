#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

#include "tiller/model.h"

namespace tiller::tools::gap {

// Matrices of a fit's normal equations, their memory within themselves.
template <int kMost>
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
template <int kMost>
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;
using StateSquare = Square<TILLER_MAX_STATES>;
using StateVector = Vector<TILLER_MAX_STATES>;
using ParamSquare = Square<TILLER_MAX_PARAMS>;
using ParamVector = Vector<TILLER_MAX_PARAMS>;
using Coupling = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, TILLER_MAX_STATES, TILLER_MAX_PARAMS>;

// A window's step of the start state for a step of the parameters: first + second * step.
struct Elimination {
  StateVector first;
  Coupling second;
};

using GramMap = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

inline Eigen::LDLT<StateSquare> damped(const GramMap& gram, std::uint32_t nx, double damping) {
  StateSquare a = gram.topLeftCorner(nx, nx);
  const double floor = 1e-9 * std::max(1e-12, a.diagonal().maxCoeff());
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
