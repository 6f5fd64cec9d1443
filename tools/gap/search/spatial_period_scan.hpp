#pragma once

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// Starts for an effect whose force is periodic in the joint's position (a parameter of Scale::spatial_period):
/// amplitudes and spatial_period, best first (starts x params). The force goes through the system linearised along the
/// base's path, its harmonics are fitted to what the base leaves, start states and parameters projected out, for
/// spatial periods evenly in frequency, close enough that no period over the whole excursion is missed, from the
/// longest that the excursion contains twice. Of a joint that turns on and on, periods are whole orders of a turn. What
/// a fit from a handful of spatial periods would never find costs here about as much as one fit.
std::vector<std::vector<double>> scan_spatial_periods(Session& session, const Candidate& base, const EffectAt& effect,
                                                      std::size_t starts);

/// The cost of choosing spatial periods: the logarithm of how many a scan compares, summed over the effects that
/// have one. Every spatial_period is a hypothesis of its own, chosen on both folds, so cross-validation does not charge
/// for it.
double choice_nats(const Session& session, const std::vector<EffectAt>& effects);

}  // namespace tiller::tools::gap
