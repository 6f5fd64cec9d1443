#include "planners/line_search.hpp"

#include <cmath>
#include <limits>

namespace tiller {
namespace {

constexpr double kRaise = 8.0;
constexpr double kFirstRaise = 1e-3;  // from zero: in shares of the largest curvature
constexpr double kOpenLoop[kCandidates] = {};

}  // namespace

const double kStepAlpha[kCandidates] = {1.0, 0.6, 0.36, 0.2, 0.08, 0.02, 0.0, 0.0};
const double kStepBeta[kCandidates] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0};

void raise_regularisation(PathPlan& p) {
  double most = 0.0;
  // the curvature of the cost: that of cones in force is without bound
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) {
    const std::size_t at = i * p.nu + i % p.nu;
    most = std::fmax(most, std::fabs(p.cone_curvature ? p.quu[at] : p.factor.curvature[at]));
  }
  if (!(most > 0.0) || !std::isfinite(most)) most = 1.0;
  p.problem.regularisation = std::fmax(kRaise * p.problem.regularisation, kFirstRaise * most);
}

void lower_regularisation(PathPlan& p) {
  p.problem.regularisation = std::fmax(p.settings->regularisation, p.problem.regularisation / kRaise);
  if (p.problem.regularisation < 1e-9) p.problem.regularisation = p.settings->regularisation;
}

double roll_open(PathPlan& p) {
  roll_candidates(p, kOpenLoop, kOpenLoop);
  const double cost = candidate_risk(p, kWarm);
  if (!std::isfinite(cost)) return std::numeric_limits<double>::infinity();
  take_candidate(p, kWarm);
  return cost;
}

double roll_warm(PathPlan& p, std::uint32_t& chosen) {
  constexpr double kFalls = 2.0;
  roll_candidates(p, kOpenLoop, kStepBeta);
  const double plain = candidate_risk(p, kWarm), gains = candidate_risk(p, kWarmUnderGains);
  chosen = std::isfinite(gains) && !(plain <= kFalls * gains) ? kWarmUnderGains : kWarm;
  const double cost = chosen == kWarm ? plain : gains;
  if (!std::isfinite(cost)) return std::numeric_limits<double>::infinity();
  take_candidate(p, chosen);
  return cost;
}

double weigh_full_step(PathPlan& p) {
  double full[TILLER_MAX_SCENARIOS];
  for (std::uint32_t j = 0; j < p.scenarios; ++j) full[j] = p.candidate_cost[j * kCandidates];
  return p.risk.update(full);
}

}  // namespace tiller
