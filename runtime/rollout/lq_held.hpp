#pragma once

#include "rollout/lq.hpp"

namespace tiller {

/// A step of the active set on the solution (x, u) of a factorised problem: inputs beyond the box are held at its
/// bound, held ones that pull back are let go. How many changed; 0: the solution is the box problem's.
std::uint32_t update_lq_held(const LqProblem& problem, const LqFactor& factor, const double* x, const double* u);

}  // namespace tiller
