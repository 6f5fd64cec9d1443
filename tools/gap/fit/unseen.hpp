#pragma once

#include <vector>

#include "tools/gap/fit/elimination.hpp"

namespace tiller::tools::gap {

// What effects have at a window's start that neither commands nor the measured path tell. A fit leaves it nearly free,
// since what the run-in gives is smoothed, and a prior about that would bend parameters; what it gains by that is paid
// for afterwards: costs are those of the marginal likelihood (Laplace) under a normal prior of the width that the
// windows have in common.

using UnseenSquare = Square<kMostUnseen>;
using UnseenVector = Vector<kMostUnseen>;

/// What a window tells of it, start states eliminated, in units of the width that the fit leaves.
struct Told {
  UnseenSquare information;
  UnseenVector found;  ///< where the fit has it, under its prior of deviation one
};

/// gram: of the window's start with the fit's own prior in it, states first (nx), then `found`.
Told told_of(const GramMap& gram, std::uint32_t nx, const UnseenVector& found);

/// The variances of where the fit has it, by expectation and maximisation (Dempster, Laird, Rubin 1977). `found` is drawn
/// towards the run-in where a window tells little, so that these come narrower than the likelihood's own: by those a play
/// that hardly moves pays more than it explains (two of the 24 tuning cases of rotors).
UnseenVector likely_variance(const std::vector<Told>& told);

/// Twice the nats by which the window's likelihood at its best is above that in the mean over the prior.
double price_of(const Told& told, const UnseenVector& variance);

}  // namespace tiller::tools::gap
