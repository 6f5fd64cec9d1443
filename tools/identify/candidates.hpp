#pragma once

#include <string>
#include <vector>

#include "tools/identify/coordinates.hpp"
#include "tools/identify/method.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// v (count x d) as parameters (count x np).
std::vector<double> params_of(const Coordinates& coordinates, const std::vector<double>& v, std::size_t np);

/// Candidates first, first + 1, ... of v (count x d) into the rollout's lanes; the last one fills what is left over.
void load_lanes(const Coordinates& coordinates, const std::vector<double>& v, std::size_t first, GridRollout& rollout);

/// Counts the candidates into `result`. False with a sentence in `error` where too few costs are finite for the
/// moments of d coordinates.
bool count_finite(const Coordinates& coordinates, const std::vector<double>& cost, MethodResult& result,
                  std::string& error);

/// True with a sentence in `error` where a step from a measured state cannot be simulated: an effect with memory has
/// a state that no log shows.
bool refuse_hidden_states(const MethodProblem& problem, std::string& error);

}  // namespace tiller::tools
