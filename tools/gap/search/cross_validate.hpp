#pragma once

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// Fills entry.cv_cost: each working window under parameters fitted to the other fold, its start state fitted anew.
void cross_validate(Session& session, Candidate& entry);

/// Nats that the model's own parameters pay for their distance z from their priors: z^2 / 2, and from kPriorBend on
/// along the tangent (Huber), since a data sheet that is wrong is wrong by more than a Gaussian says.
double prior_nats(const Hypothesis& hypothesis, const std::vector<double>& params);

/// Of the working windows.
double held_out_cost(const Session& session, const Candidate& entry);
/// How large the difference of two explanations is, as a share of the whole gap, in amplitude.
double share_of_gap(const Session& session, const Candidate& nominal, const Candidate& better, const Candidate& worse);

/// How much better `a` foresees the working windows than `b`, what their parameters pay to the priors included.
struct Comparison {
  double gain_nats = 0;  ///< log density, dispersion counted
  double z = 0;          ///< clipped paired differences over windows, in standard errors
  double robust_z = 0;   ///< the same with each window's noise level its own
  bool significant(double nats, double errors) const { return gain_nats > nats && z > errors; }
};
Comparison compare(const Session& session, const Candidate& a, const Candidate& b);
/// The same on the windows `which`, from costs by window; `ahead_nats`: of `a` before any window is looked at.
Comparison compare_on(const Session& session, const std::vector<std::size_t>& which, const std::vector<double>& cost_a,
                      const std::vector<double>& cost_b, double ahead_nats = 0);

/// Variance of an entry's whitened residuals with their serial correlation over the working windows; at least 1.
double dispersion_of(Session& session, const Hypothesis& hypothesis, const Fit& fit);

/// Root mean square difference of what two entries predict in the working windows, whitened.
double difference_sigma(Session& session, const Candidate& a, const Candidate& b);

}  // namespace tiller::tools::gap
