#pragma once

#include "tools/gap/search/search.hpp"

namespace tiller::tools::gap {

/// What the model of before leaves beyond the best explanation, in amplitude, over what it leaves on its own logs: a
/// change that adds less is not told, however well it is proven. The best models are wrong by as much.
constexpr double kLeastChange_sigma = 0.3;

/// Candidates of what may have changed, beside new effects: every parameter that the robot file learns, and known ones
/// but for lengths, which no use of a machine changes, and zeros, which the catalogue's effects stand for.
std::vector<EffectAt> changeable_parameters(const tiller_config_t& config);

/// The model of before with all of its parameters as they were, on the logs of after: start states alone are fitted.
Candidate frozen_model(Session& session, const Candidate& nominal);

/// Fills result.changes and result.others; the best explanation's fit has its information.
void tell_changes(Session& session, const SearchResult& found, Result& result);

/// The verdict's sentence where it is asked what changed; after conclude().
std::string change_sentence(const Session& session, const Result& result);

/// Whether the two sets are the same quantities at work: a mass that changed and a payload, a damping and viscous
/// friction, by their units.
bool same_quantities(const tiller_config_t& config, const std::vector<EffectAt>& a, const std::vector<EffectAt>& b);

/// The fit of a candidate that has its information, for a search that begins where these logs end.
ModelFit model_fit(const Candidate& entry, double sigma);

}  // namespace tiller::tools::gap
