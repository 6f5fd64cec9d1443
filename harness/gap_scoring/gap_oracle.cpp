#include "harness/gap_scoring/gap_oracle.hpp"

#include <cmath>

#include "effects/effect_info.hpp"
#include "harness/gap_scoring/gap_score.hpp"

namespace tiller::bench {
namespace {

/// The effect of the catalogue that has the name at the port; false: there is none.
bool find_in_catalogue(const sim::HiddenEffect& hidden, const tiller_model_t& model, tools::gap::EffectAt& found) {
  const int kind = find_effect(hidden.kind.c_str());
  if (kind < 0) return false;
  found.kind = static_cast<std::uint32_t>(kind);
  const PortKind port = effect_info(found.kind).port;
  for (found.port = 0; found.port < port_count(port, model); ++found.port)
    if (hidden.port == port_name(port, model, found.port)) return port_fits(effect_info(found.kind), found.port, model);
  return false;
}

}  // namespace

Oracle fit_oracle(const tools::RobotFile& robot, const tools::gap::Options& options, const WorldCase& truth) {
  Oracle oracle{NAN, {}};
  tools::gap::Options told = options;
  for (const sim::HiddenEffect& hidden : truth.effects) {
    tools::gap::EffectAt effect;
    if (!find_in_catalogue(hidden, *robot.config.model, effect)) return oracle;
    told.given.push_back(effect);
  }
  const tools::gap::Result result = find_gap(robot, told);
  if (result.ranking.empty() || result.ranking[0].effects.size() != told.given.size()) return oracle;
  if (const auto* h = one_second(result.horizons)) oracle.gap = h->after_sigma;
  oracle.params = result.ranking[0].params;
  return oracle;
}

const tools::gap::HorizonGap* one_second(const std::vector<tools::gap::HorizonGap>& horizons) {
  const tools::gap::HorizonGap* best = nullptr;
  for (const auto& h : horizons)
    if (h.windows && (!best || std::fabs(h.seconds - 1) < std::fabs(best->seconds - 1))) best = &h;
  return best;
}

}  // namespace tiller::bench
