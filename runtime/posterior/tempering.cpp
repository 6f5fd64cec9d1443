#include "posterior/tempering.hpp"

namespace tiller {

void Tempering::note_moves(const Cloud& cloud, std::uint32_t moves, std::uint32_t accepted) {
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
  cursor_ = (cursor_ + moves) % cloud.n;
  moved_ = moved_ + moves < cloud.n ? moved_ + moves : cloud.n;
}

Tempering::Choice Tempering::choose(const Cloud& cloud, const double* base, const double* gain, const Search& search,
                                    double* weight) const {
  const tiller_posterior_config_t& config = cloud.config->posterior;
  Choice c;
  c.floor = config.ess_fraction * cloud.n;
  c.exponent = c.highest = swept(cloud) ? 1.0 : exponent_;
  c.at_highest = cloud.lanes->weigh(cloud.n, base, gain, c.highest, weight);
  const double ess = c.at_highest.effective_samples;
  const bool can_move = config.moves_per_tick > 0 && cloud.d > 0;
  const bool ordinary = !can_move || (settled(cloud) && ess >= 0.5 * c.floor);
  if (ess < c.floor && !ordinary)
    c.exponent = cloud.largest_exponent(base, gain, exponent_, c.highest, search.share * c.floor, search.slack);
  return c;
}

bool Tempering::take(const Cloud& cloud, const Choice& choice, bool any_dead) {
  if (choice.exponent != exponent_) moved_ = 0;
  exponent_ = choice.exponent;
  return cloud.effective_samples < choice.floor || choice.exponent < choice.highest || any_dead;
}

}  // namespace tiller
