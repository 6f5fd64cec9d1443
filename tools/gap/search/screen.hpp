#pragma once

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// `base`'s parameters with the robot file's own at their priors' centre, where its fit drove one of them far from its
/// prior or to a bound and to less than half or more than twice the centre; else empty. What the lack of an effect
/// drives there (a mass to nothing, where its slope is lost) may be a valley of its own: effects are tried from the
/// centre too.
std::vector<double> centre_of_own(const Session& s, const Candidate& base);

/// Parameters of each candidate (candidates x its own) where the first screen left it; starts of later ones.
using Hints = std::vector<std::vector<double>>;

/// Candidate effects beside those of `base`, fitted in a few coarse steps on a part of the windows, best first: one
/// from every start, three more for twice `keep` of them. `fresh`: from all starts of the catalogue, else from the
/// hints.
std::vector<Candidate> screen(Session& session, const Candidate& base, std::size_t keep, Hints& hints, bool fresh);

/// Fits entry.hypothesis on the screen's windows from `params` with each of `starts` behind them; the best is the
/// entry's. `scanned`: the start states follow before the parameters move.
void fit_from(Session& session, const std::vector<double>& params, const Fit& warm,
              const std::vector<std::vector<double>>& starts, int iterations, bool scanned, Candidate& entry);

/// Every start of an effect's parameters at a port (starts x params).
std::vector<std::vector<double>> starts_of(const Session& session, const EffectAt& effect);

}  // namespace tiller::tools::gap
