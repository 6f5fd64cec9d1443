#pragma once

#include <cstdint>

namespace tiller {

// What knowing more is worth, from a table of costs; docs/theory/probing.md has the derivations.

constexpr std::uint32_t kMostProbeHypotheses = 32;

/// Costs of M + 1 plans on M hypotheses, which are as likely as one another: row 0 of the plan that hedges between them
/// all, row 1 + j of the one that is made for hypothesis j.
struct RegretTable {
  std::uint32_t count = 0;  // M
  double hedged = 0.0;      // mean regret of plan 0
  double ignorance = 0.0;   // of the plan that is best on average: what perfect information saves, at most `hedged`
  double mistaken = 0.0;    // mean over pairs of what it costs to take i for j
  double pair[kMostProbeHypotheses * kMostProbeHypotheses] = {};  // (M x M) regret(i, j) + regret(j, i), i < j

  /// cost ((M + 1) x M), row by plan. A hypothesis' least cost is that of whichever plan serves it best.
  void fill(std::uint32_t hypotheses, const double* cost);
};

/// What is left of the chance to take one of two hypotheses for the other, 1 at first, once a signal tells them `apart`
/// by D = 1/2 d^2 nats: of Gaussian signals 2 E p q / (p + q)^2 = exp(-D / 4) E sech(z sqrt(D / 2)), z normal. The
/// expectation is (1 + D + D^2 / pi^2)^(-1/4) to 1 %: exact to first order at 0, and in the limit.
double confusion(double apart);

/// Share of the mistakes that will not be made once each pair of hypotheses is told `apart` (M x M, upper triangle), in
/// nats:  1 - sum_(i<j) pair_ij confusion(apart_ij) / sum_(i<j) pair_ij.  In [0, 1], 0 where nothing is told or no
/// mistake costs anything. Cost: M^2 / 2 exponentials.
double told_share(const RegretTable& regrets, const double* apart);

/// Expected saving of who learns that much before anything is decided: told_share of the hedged regret.
inline double expected_saving(const RegretTable& regrets, const double* apart) {
  return regrets.hedged * told_share(regrets, apart);
}

/// Nats about a Gaussian parameter that M draws from it stand for: 1/2 log det(I + G / (M - 1)) of the Gram matrix G
/// (M x M) of the signals less their mean; exact where signals are linear in the parameters and the draws are many.
/// Destroys `gram`. Cost: M^3 / 6.
double gaussian_information(std::uint32_t count, double* gram);

/// Nats about which of M equal hypotheses it is: bounds of the mutual information by the pairwise distances, with
/// exp(-D / 4) from below and exp(-D) from above (Kolchinsky and Tracey 2017, "Estimating mixture entropy with pairwise
/// distances", Entropy 19:361). `apart` (M x M, upper triangle) in nats.
struct InformationBounds {
  double low, high;
};
InformationBounds mixture_information(std::uint32_t count, const double* apart);

}  // namespace tiller
