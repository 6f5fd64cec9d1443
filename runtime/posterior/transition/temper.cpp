// The exponent on the likelihood and the weights.

#include <cmath>
#include <cstring>

#include "posterior/transition/transition_cloud.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// How close the search for an exponent comes to the floor of effective samples.
constexpr double kSlack = 0.1;
/// While most of the data of a young ring have yet to count, steps may cost more effective samples: the cloud shrinks
/// by orders of magnitude then, and a short run must arrive.
constexpr double kEarly = 0.5, kEarlyFloor = 0.5;

}  // namespace

/// New data: the particles' evidence, and what was to be expected of it.
void TransitionCloud::take_evidence(double log_constant) {
  TransitionParticles& p = particles_;
  const Cloud& cloud = p.cloud;
  evidence_.log_likelihood(p.n(), p.total, p.n(), p.gain);
  // log_weight - log(weight) is the same for all: what normalises them
  std::uint32_t heavy = 0;
  while (heavy + 1 < p.n() && !(cloud.weight[heavy] * p.n() > 0.5)) ++heavy;
  const double normaliser = cloud.log_weight[heavy] - math::log(cloud.weight[heavy]);
  const bool full = exponent() == 1.0;
  WeighResult predicted;
  if (!full) {
    p.split_weights(1.0, p.gain, p.fresh);
    predicted = cloud.lanes->weigh(p.n(), p.base, p.fresh, 1.0, nullptr);
  }
  const WeighResult present = temper(p.split_weights(exponent(), p.gain, p.gain));
  if (full) predicted = present;
  log_predictive_ =
      predicted.sum > 0.0 ? predicted.largest + math::log(predicted.sum) - normaliser + log_constant : 0.0;
  if (robust_.weight() < 1.0) log_predictive_ -= kDoubtCost;
}

/// No new data: the exponent goes as far as the cloud, which has been swept, allows.
void TransitionCloud::raise() {
  particles_.split_weights(exponent(), particles_.log_likelihood, particles_.gain);
  temper(false);
}

/// Weights follow the change of the target: base has the old likelihood no more, gain is the new one. Returns the
/// weights' sum at the largest exponent that is allowed.
WeighResult TransitionCloud::temper(bool any_dead) {
  TransitionParticles& p = particles_;
  Cloud& cloud = p.cloud;
  std::memcpy(p.log_likelihood, p.gain, p.n() * sizeof(double));
  if (!config_->posterior.enabled) return {};

  const bool early = exponent() < kEarly && ring_.begin() == 0;
  const Tempering::Choice choice =
      tempering_.choose(cloud, p.base, p.gain, {early ? kEarlyFloor : 1.0, kSlack}, p.fresh);
  const WeighResult& at = choice.at_highest;
  if (choice.exponent == choice.highest) {
    std::memcpy(cloud.weight, p.fresh, p.n() * sizeof(double));
    transition_table().normalise(p.n(), p.base, p.gain, choice.highest, at.sum, at.largest + math::log(at.sum),
                                 cloud.weight, cloud.log_weight);
    cloud.effective_samples = at.effective_samples;
  } else {
    cloud.set_weights(p.base, p.gain, choice.exponent);
  }
  if (tempering_.take(cloud, choice, any_dead)) {
    p.resample(tick_ * 64 + (tempering_.resamplings() & 63u));
    tempering_.note_resampling();
  }
  return at;
}

}  // namespace tiller
