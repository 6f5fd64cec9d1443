#include "bench/planning/knowledge.hpp"

#include <algorithm>
#include <initializer_list>

namespace tiller::bench {

const char* knowledge_name(Knowledge k) {
  switch (k) {
    case Knowledge::nominal: return "nominal";
    case Knowledge::mean: return "posterior mean";
    case Knowledge::expected: return "expected cost";
    case Knowledge::cvar: return "CVaR 0.9";
    case Knowledge::closed_expected: return "closed loop, expected cost";
    case Knowledge::closed_cvar: return "closed loop, CVaR 0.9";
    case Knowledge::uncorrected: return "prior, expected cost";
    case Knowledge::closed_uncorrected: return "prior, closed loop";
    default: return "oracle";
  }
}

bool is_unsure(Knowledge k) { return k != Knowledge::nominal && k != Knowledge::oracle; }

void set_knowledge(tiller_config_t& config, Knowledge knowledge, std::uint32_t hypotheses) {
  const auto is = [&](std::initializer_list<Knowledge> kinds) {
    return std::find(kinds.begin(), kinds.end(), knowledge) != kinds.end();
  };
  const bool unsure = is_unsure(knowledge);
  config.posterior.enabled = unsure && !is({Knowledge::uncorrected, Knowledge::closed_uncorrected});
  config.planner.particles = unsure && knowledge != Knowledge::mean ? hypotheses : 1;
  config.planner.risk = is({Knowledge::cvar, Knowledge::closed_cvar}) ? tiller_risk_cvar : tiller_risk_mean;
  config.planner.closed_loop = is({Knowledge::closed_expected, Knowledge::closed_cvar, Knowledge::closed_uncorrected});
}

}  // namespace tiller::bench
