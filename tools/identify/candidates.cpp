#include "tools/identify/candidates.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"

namespace tiller::tools {

std::vector<double> params_of(const Coordinates& coordinates, const std::vector<double>& v, std::size_t np) {
  const std::size_t count = v.size() / coordinates.count();
  std::vector<double> params(count * np);
  for (std::size_t s = 0; s < count; ++s)
    coordinates.to_params(v.data() + s * coordinates.count(), params.data() + s * np);
  return params;
}

void load_lanes(const Coordinates& coordinates, const std::vector<double>& v, std::size_t first, GridRollout& rollout) {
  const std::size_t count = v.size() / coordinates.count();
  double params[TILLER_MAX_PARAMS];
  for (std::uint32_t lane = 0; lane < rollout.lanes(); ++lane) {
    coordinates.to_params(v.data() + std::min(first + lane, count - 1) * coordinates.count(), params);
    for (std::uint32_t i = 0; i < rollout.param_count(); ++i) rollout.params()[i * rollout.lanes() + lane] = params[i];
  }
}

bool count_finite(const Coordinates& coordinates, const std::vector<double>& cost, MethodResult& result,
                  std::string& error) {
  const auto finite =
      static_cast<std::size_t>(std::count_if(cost.begin(), cost.end(), [](double c) { return std::isfinite(c); }));
  result.simulations += cost.size();
  result.diverged += cost.size() - finite;
  if (finite >= coordinates.count() + 2) return true;
  error = "only " + std::to_string(finite) + " of " + std::to_string(cost.size()) +
          " rollouts stayed finite; narrow the priors, shorten the rollouts or raise substeps";
  return false;
}

bool refuse_hidden_states(const MethodProblem& problem, std::string& error) {
  for (std::uint32_t e = 0; e < problem.config->effect_count; ++e) {
    const EffectInfo& info = effect_info(problem.config->effects[e].kind);
    if (info.state_count == 0) continue;
    error = std::string("the effect ") + info.name +
            " has a state that no log shows, so a single step cannot be simulated; use posterior or trajectory_simopt";
    return true;
  }
  return false;
}

}  // namespace tiller::tools
