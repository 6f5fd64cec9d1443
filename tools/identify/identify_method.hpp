#pragma once

#include <string>
#include <vector>

#include "tools/identify/identify_fit.hpp"

namespace tiller::tools {

/// fit() by options.method. A candidate that learns nothing goes through the posterior, whatever the method. Of what
/// a method does not have, the fit holds NaN (noise_scale, exponent) or nothing (history).
bool fit_by_method(const Candidate& candidate, const std::vector<Stretch>& stretches, const std::vector<Grid>& grids,
                   const FitOptions& options, Fit& result, std::string& error);

/// 512 equally weighted rows (np) by systematic resampling: the middles of as many slices of the weights.
std::vector<double> resample(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np);

/// "\n  the weight lies on ... draws: ..." where reps left so few that their moments are rough; else empty.
std::string few_draws(const std::string& method, double effective_samples, std::uint64_t simulations);

/// The tables' line about the method: simulations, iterations, the caveat. Empty for the posterior.
std::string method_text(const Fit& fit);

}  // namespace tiller::tools
