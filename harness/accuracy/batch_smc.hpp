#pragma once

// All data at once: a sampler for a posterior whose likelihood is known, with a budget of simulations.

#include <Eigen/Core>
#include <cstdint>

#include "harness/accuracy/exact_likelihood.hpp"

namespace tiller::bench {

struct BatchPosterior {
  Eigen::MatrixXd point;          // (d x n) inferred parameters, physical; equal weights
  double exponent = 0;            ///< reached on the likelihood; below one: the budget was too small
  std::uint32_t simulations = 0;  ///< parameter vectors whose likelihood was evaluated
};

/// Tempered sequential Monte Carlo (Del Moral, Doucet, Jasra, Sequential Monte Carlo samplers, JRSS B 2006):
/// `particles` draws from the prior; the exponent on the likelihood rises from 0 to 1 by steps that keep half of the
/// effective number; each step resamples systematically and moves every particle once by a random-walk Metropolis step
/// of 2.38 / sqrt(d) of the cloud's own root. What is left of the budget at exponent 1 goes into further moves. Cost:
/// `budget` simulations of the whole record at most.
BatchPosterior batch_smc(const ExactLikelihood& likelihood, int particles, std::uint32_t budget, std::uint64_t seed);

}  // namespace tiller::bench
