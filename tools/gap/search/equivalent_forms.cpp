#include "tools/gap/search/equivalent_forms.hpp"

#include <algorithm>

#include "effects/effect_info.hpp"
#include "tools/gap/search/cross_validate.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::uint32_t kOne = tiller_effect_asymmetric_friction;
constexpr std::uint32_t kPair[] = {tiller_effect_coulomb_friction, tiller_effect_constant_offset};

bool has(const std::vector<EffectAt>& effects, std::uint32_t kind, std::uint32_t port) {
  return std::find(effects.begin(), effects.end(), EffectAt{kind, port}) != effects.end();
}

bool can_split(const std::vector<EffectAt>& effects, const EffectAt& e) {
  return e.kind == kOne && !has(effects, kPair[0], e.port) && !has(effects, kPair[1], e.port);
}

bool can_join(const std::vector<EffectAt>& effects, const EffectAt& e) {
  return e.kind == kPair[0] && has(effects, kPair[1], e.port) && !has(effects, kOne, e.port);
}

/// First parameter of each effect in the configuration's.
std::size_t first_param(const Hypothesis& h, std::size_t effect) {
  std::size_t at = h.own_params;
  for (std::size_t i = 0; i < effect; ++i) at += static_cast<std::size_t>(info_of(h.added[i].kind).param_count);
  return at;
}

std::size_t index_of(const std::vector<EffectAt>& effects, std::uint32_t kind, std::uint32_t port) {
  return static_cast<std::size_t>(std::find(effects.begin(), effects.end(), EffectAt{kind, port}) - effects.begin());
}

/// The entry's effects and parameters with every one that can be written otherwise written so.
bool rewrite(const Candidate& entry, std::vector<EffectAt>& effects, std::vector<double>& params) {
  const std::vector<EffectAt>& old = entry.effects();
  const std::vector<double>& p = entry.fit.params;
  params.assign(p.begin(), p.begin() + entry.hypothesis.own_params);
  bool changed = false;
  for (std::size_t i = 0; i < old.size(); ++i) {
    const double* mine = p.data() + first_param(entry.hypothesis, i);
    if (can_split(old, old[i])) {
      effects.push_back({kPair[0], old[i].port});
      effects.push_back({kPair[1], old[i].port});
      params.insert(params.end(), {0.5 * (mine[0] + mine[1]), 0.5 * (mine[1] - mine[0])});
      changed = true;
    } else if (can_join(old, old[i])) {
      const double force = p[first_param(entry.hypothesis, index_of(old, kPair[1], old[i].port))];
      if (mine[0] <= force || mine[0] <= -force) return false;
      effects.push_back({kOne, old[i].port});
      params.insert(params.end(), {mine[0] - force, mine[0] + force});
      changed = true;
    } else if (!(old[i].kind == kPair[1] && can_join(old, {kPair[0], old[i].port}) &&
                 has(old, kPair[0], old[i].port))) {
      effects.push_back(old[i]);
      params.insert(params.end(), mine, mine + info_of(old[i].kind).param_count);
    }
  }
  return changed;
}

}  // namespace

std::vector<EffectAt> elementary(const std::vector<EffectAt>& effects) {
  std::vector<EffectAt> split;
  for (const EffectAt& e : effects) {
    if (can_split(effects, e)) {
      split.push_back({kPair[0], e.port});
      split.push_back({kPair[1], e.port});
    } else {
      split.push_back(e);
    }
  }
  return split;
}

std::size_t name_count(const std::vector<EffectAt>& effects) {
  const auto joins = [&](const EffectAt& e) { return can_join(effects, e); };
  return effects.size() - static_cast<std::size_t>(std::count_if(effects.begin(), effects.end(), joins));
}

bool make_equivalent(Session& s, const Candidate& entry, Candidate& twin) {
  std::vector<EffectAt> effects;
  std::vector<double> params;
  if (!rewrite(entry, effects, params) || !make_hypothesis(s.config, effects, &s.scales, twin.hypothesis)) return false;
  twin.fit = s.shooting->begin(twin.hypothesis, params, &entry.fit);
  s.shooting->fit(twin.hypothesis, s.work, {}, twin.fit);
  if (!twin.fit.finite) return false;
  cross_validate(s, twin);
  return true;
}

}  // namespace tiller::tools::gap
