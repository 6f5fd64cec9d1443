#include "posterior/transition/transition_past.hpp"

#include "posterior/transition/transition_lanes.hpp"

namespace tiller {

TransitionPast TransitionPast::lay_out(Arena& arena, const TransitionParticles& particles, const Evidence& evidence) {
  TransitionPast p;
  p.summary_ = ResidualSummary::lay_out(arena, particles.cloud.d, evidence);
  const std::size_t points = p.summary_.design().points();
  p.params_ = arena.take<float>(particles.cloud.np * points);
  p.residual_ = arena.take<float>(evidence.nx() * points * (evidence.columns() > 0 ? 2 : 1));
  return p;
}

/// The ring is held beyond its window until the cloud has been swept at the full exponent, because a fit over a cloud
/// that is still wide is a poor one; up to its capacity, where the oldest must leave. Afterwards two leave at a tick
/// until the window is reached.
void TransitionPast::retire(const TransitionData& data, bool swept) {
  const tiller_posterior_config_t& config = data.particles.cloud.config->posterior;
  TransitionRing& ring = data.ring;
  if (data.particles.cloud.d == 0 || !config.enabled) {
    // nobody moves: nobody asks what a transition says of other parameters
    if (ring.size() > config.window) ring.drop_oldest();
    return;
  }
  for (int leaving = 0; leaving < 2; ++leaving) {
    const bool must = leaving == 0 && ring.size() == ring.longest();
    if (!(ring.size() > config.window && (swept || must))) return;
    retire_oldest(data);
  }
}

void TransitionPast::retire_oldest(const TransitionData& data) {
  TransitionParticles& p = data.particles;
  const std::uint64_t oldest = data.ring.begin();
  const std::uint32_t slot = data.ring.slot(oldest);
  data.ring.drop_oldest();
  p.clear_fresh();
  data.sums.sum_fresh(p, oldest, oldest + 1);
  transition_table().add_scaled(p.rows * p.n(), -1.0, p.fresh, p.ring);

  // a cloud does not move far within a few ticks
  constexpr std::uint64_t kLook = 8;
  if (!summary_.design().laid() || (data.ring.begin() % kLook == 0 && !summary_.design().covers(p.cloud)))
    lay_design(p);
  if (summarise(data, slot)) return;
  // a point at which the model has no finite step: around the cloud as it is now there may be none
  lay_design(p);
  if (!summarise(data, slot)) ++lost_;
}

void TransitionPast::lay_design(const TransitionParticles& particles) {
  const Cloud& cloud = particles.cloud;
  summary_.centre_on(cloud);
  const PolynomialDesign& design = summary_.design();
  const std::uint32_t points = design.points();
  for (std::uint32_t i = 0; i < cloud.np; ++i)
    for (std::uint32_t k = 0; k < points; ++k) params_[i * points + k] = particles.params[i * cloud.n];
  for (std::uint32_t j = 0; j < cloud.named; ++j) {
    const std::uint32_t i = cloud.inferred[j];
    for (std::uint32_t k = 0; k < points; ++k)
      params_[i * points + k] =
          static_cast<float>(from_coordinate(cloud.config->priors[i], design.at()[j * points + k]));
  }
}

bool TransitionPast::summarise(const TransitionData& data, std::uint32_t slot) {
  const std::uint32_t points = summary_.design().points();
  float* const before = residual_ + std::size_t{data.evidence.nx()} * points;
  data.sums.residuals({params_, points}, points, slot, residual_);
  if (data.ring.any_linked(slot)) data.sums.residuals({params_, points}, points, data.ring.slot_before(slot), before);
  return summary_.add(residual_, before, data.ring.counted(slot));
}

}  // namespace tiller
