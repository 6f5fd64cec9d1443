// Whether a force that the model lacks goes with the velocity or its sign: the evidence of a friction against none.
//
// Each particle's filter has friction as a state, normal before the data (variance V) and after them (mean m, variance
// P). The data's density with the state, over that with the state at zero, is the ratio of the two laws' densities at
// zero (Dickey, "The weighted likelihood ratio", Annals of Mathematical Statistics 42, 1971; Savage's),
//
//     B_i = L(S, l) / L(S + m^2 / P, l - log(V / P)),
//
// L the likelihood of the innovations with their scale integrated out (ScaleEvidence). Over the particles, who are
// drawn from the posterior with the friction,
//
//     p(data | none) / p(data | friction) = sum_i w_i / B_i.
//
// The null: everything else as it is, the wandering force with the same laws of size, time and swing among it, and no
// friction now. So a gust or a constant force, which these explain, is no evidence, and neither is a large s: it widens
// V as well, which makes friction dearer. What the null may be true of, the evidence exceeds 1 / a with probability at
// most a (a ratio of marginal likelihoods is a martingale of mean one; Ville). The state walks a little (kDrift), so
// that "none now" is not "none ever": at any one time the bound holds all the same, since then sd >= the deviation that
// m has, and the level is split over the times at which it could be another (AdequacyTest::take_force).

#include <cmath>

#include "posterior/filter/filter_posterior.hpp"
#include "tiller/math.hpp"

namespace tiller {

static_assert(AdequacyTest::kMostForces >= 2 * kDiscrepancyJoints, "two of each joint");

namespace {

/// The first measurement of a joint; the first of all where it has none.
std::uint32_t channel_of(const tiller_config_t& config, const tiller_joint_t& joint) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == joint.position || config.measured_state[k] == joint.velocity) return k;
  return 0;
}

}  // namespace

/// Only of all the data, for a tempered posterior is not what the particles' weights would have to be; and not on
/// trial, when it is open whether the null explains the data at all.
void FilterPosterior::test_friction() {
  if (!disturbances_.has_friction() || exponent_ < 1.0 || early_ > 0 || trial_ > 0) return;
  for (std::uint32_t j = 0; j < disturbances_.joints(); ++j) {
    const std::uint32_t channel = channel_of(*config_, config_->model->joints[j]);
    adequacy_->take_force(2 * j, channel, tiller_feature_velocity, friction_evidence(j, DisturbanceStates::kViscous));
    adequacy_->take_force(2 * j + 1, channel, tiller_feature_velocity_sign,
                          friction_evidence(j, DisturbanceStates::kDry));
  }
}

/// Logarithm; 0 where no such friction is looked for. Cost: O(N).
double FilterPosterior::friction_evidence(std::uint32_t joint, std::uint32_t kind) const {
  const std::uint32_t lacking = disturbances_.force_state(joint) + kind, state = nx_ + lacking;
  const double* const mean = carried_.filter.state + std::size_t{state} * n_;
  const double* const variance = carried_.filter.covariance + std::size_t{triangle_row(nf_, state, state)} * n_;
  const double* const size = carried_.law + std::size_t{joint} * n_;
  const double *const squared = carried_.sums + ScaleEvidence::kSquared * n_, *const logs = carried_.sums +
                                                                                            ScaleEvidence::kLogs * n_;
  double* const without = scratch_row(0);  // sums, two rows
  double* const density = scratch_row(2);
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double law = knows_lacks_ ? kept_law_[joint] : size[i];
    const double before = disturbances_.friction_variance(lacking, law, elapsed_s_);
    if (!(before > 0.0)) return 0.0;
    const double after = std::fmin(before, std::fmax(variance[i], kVarianceFloor * before));
    without[ScaleEvidence::kSquared * n_ + i] = squared[i] + mean[i] * mean[i] / after;
    without[ScaleEvidence::kLogs * n_ + i] = logs[i] - math::log(before / after);
  }
  evidence_.log_likelihood(n_, without, n_, density);
  double none = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double less = density[i] - carried_.log_likelihood[i];
    if (cloud_.weight[i] > 0.0 && std::isfinite(less)) none += cloud_.weight[i] * math::exp(less);
  }
  constexpr double kLeast = 1e-300;  // whose logarithm is one
  return -math::log(std::fmax(none, kLeast));
}

/// Filters that begin with one law of the friction, whatever size a particle has, are judged by the mean size.
void FilterPosterior::keep_friction_law() {
  for (std::uint32_t j = 0; j < disturbances_.joints() && disturbances_.has_friction(); ++j) {
    double mean = 0.0;
    for (std::uint32_t i = 0; i < n_; ++i) mean += cloud_.weight[i] * carried_.law[std::size_t{j} * n_ + i];
    kept_law_[j] = mean;
  }
}

}  // namespace tiller
