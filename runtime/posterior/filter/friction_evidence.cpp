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

#include "posterior/filter/filter_adequacy.hpp"
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

/// Logarithm; 0 where no such friction is looked for. Cost: O(N).
double friction_evidence(const FilterParticles& particles, const ScaleEvidence& evidence, const double* law,
                         std::uint32_t joint, std::uint32_t kind, double elapsed_s) {
  const DisturbanceStates& disturbances = *particles.disturbances;
  const std::uint32_t n = particles.n(), lacking = disturbances.force_state(joint) + kind;
  const std::uint32_t state = particles.nf - disturbances.states() + lacking;
  const double *const mean = particles.state(state), *const variance = particles.covariance(state, state);
  const double *const size = particles.law(joint), *const squared = particles.sums + ScaleEvidence::kSquared * n,
                      *const logs = particles.sums + ScaleEvidence::kLogs * n;
  double* const without = particles.scratch_row(0);  // sums, two rows
  double* const density = particles.scratch_row(2);
  for (std::uint32_t i = 0; i < n; ++i) {
    const double before = disturbances.friction_variance(lacking, law ? law[joint] : size[i], elapsed_s);
    if (!(before > 0.0)) return 0.0;
    const double after = std::fmin(before, std::fmax(variance[i], kVarianceFloor * before));
    without[ScaleEvidence::kSquared * n + i] = squared[i] + mean[i] * mean[i] / after;
    without[ScaleEvidence::kLogs * n + i] = logs[i] - math::log(before / after);
  }
  evidence.log_likelihood(n, without, n, density);
  double none = 0.0;
  for (std::uint32_t i = 0; i < n; ++i) {
    const double less = density[i] - particles.log_likelihood[i];
    if (particles.weight(i) > 0.0 && std::isfinite(less)) none += particles.weight(i) * math::exp(less);
  }
  constexpr double kLeast = 1e-300;  // whose logarithm is one
  return -math::log(std::fmax(none, kLeast));
}

}  // namespace

void FilterAdequacy::test_friction(const FilterParticles& particles, const ScaleEvidence& evidence,
                                   const FilterStart& start, double elapsed_s) {
  const DisturbanceStates& disturbances = *particles.disturbances;
  if (!disturbances.has_friction() || early_ > 0 || trial_ > 0) return;
  const tiller_config_t& config = *particles.cloud.config;
  const auto evidence_of = [&](std::uint32_t joint, std::uint32_t kind) {
    return friction_evidence(particles, evidence, start.friction_law(), joint, kind, elapsed_s);
  };
  for (std::uint32_t j = 0; j < disturbances.joints(); ++j) {
    const std::uint32_t channel = channel_of(config, config.model->joints[j]);
    test_->take_force(2 * j, channel, tiller_feature_velocity, evidence_of(j, DisturbanceStates::kViscous));
    test_->take_force(2 * j + 1, channel, tiller_feature_velocity_sign, evidence_of(j, DisturbanceStates::kDry));
  }
}

}  // namespace tiller
