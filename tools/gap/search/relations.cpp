#include "tools/gap/search/relations.hpp"

#include <algorithm>
#include <cstring>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"

namespace tiller::tools::gap {
namespace {

bool covers(const EffectAt& rich, const EffectAt& simple, int depth = 3) {
  if (rich == simple) return true;
  if (depth == 0 || rich.port != simple.port) return false;
  for (const char* name : info_of(rich.kind).contains) {
    const int kind = name ? find_effect(name) : -1;
    if (kind >= 0 && covers({static_cast<std::uint32_t>(kind), rich.port}, simple, depth - 1)) return true;
  }
  return false;
}

bool lists(const EffectInfo& a, const char* name) {
  const auto is = [&](const char* n) { return n != nullptr && std::strcmp(n, name) == 0; };
  return std::any_of(std::begin(a.contains), std::end(a.contains), is) ||
         std::any_of(std::begin(a.aliases), std::end(a.aliases), is);
}

}  // namespace

EffectAt as_new_effect(const EffectAt& e, const tiller_config_t& config) {
  if (e.kind != kChangedParameter) return e;
  std::uint32_t at = config.model->param_count;
  for (std::uint32_t i = 0; i < config.effect_count && at <= e.port; ++i) {
    const auto count = static_cast<std::uint32_t>(info_of(config.effects[i].kind).param_count);
    if (at == e.port && count == 1) return {config.effects[i].kind, config.effects[i].port};
    at += count;
  }
  return e;
}

bool same_set(const std::vector<EffectAt>& a, const std::vector<EffectAt>& b) {
  if (a.size() != b.size()) return false;
  return std::all_of(a.begin(), a.end(),
                     [&](const EffectAt& e) { return std::find(b.begin(), b.end(), e) != b.end(); });
}

bool nested(const Candidate& simple, const Candidate& rich) {
  if (simple.hypothesis.freedom >= rich.hypothesis.freedom) return false;
  std::uint32_t taken = 0;
  for (const EffectAt& changed_or_new : simple.effects()) {
    const EffectAt e = as_new_effect(changed_or_new, simple.hypothesis.config);
    const auto take = [&](const EffectAt& one) {
      for (std::size_t i = 0; i < rich.effects().size(); ++i)
        if (!(taken >> i & 1u) && covers(as_new_effect(rich.effects()[i], rich.hypothesis.config), one)) {
          taken |= 1u << i;
          return true;
        }
      return false;
    };
    if (take(e)) continue;
    if (e.port != TILLER_EVERY_PORT) return false;
    bool each = true;  // one parameter for all ports is a case of one for each
    for_ports(info_of(e.kind), e.port, *rich.hypothesis.config.model, [&](std::uint32_t port) {
      each = each && take({e.kind, port});
    });
    if (!each) return false;
  }
  return true;
}

bool other_mechanism(const Candidate& simple, const Candidate& rich, const tiller_model_t& model) {
  if (simple.effects().size() != rich.effects().size() || nested(simple, rich) ||
      rich.hypothesis.freedom > simple.hypothesis.freedom + 2)
    return false;
  const auto missing = [](const std::vector<EffectAt>& from, const std::vector<EffectAt>& in) {
    std::vector<EffectAt> left;
    for (const EffectAt& e : from)
      if (std::find(in.begin(), in.end(), e) == in.end()) left.push_back(e);
    return left;
  };
  const std::vector<EffectAt> a = missing(simple.effects(), rich.effects()),
                              b = missing(rich.effects(), simple.effects());
  if (a.size() != 1 || b.size() != 1) return false;
  const auto& aliases = info_of(b[0].kind).aliases;
  const char* name = info_of(a[0].kind).name;
  return std::any_of(std::begin(aliases), std::end(aliases),
                     [&](const char* alias) { return alias != nullptr && std::strcmp(alias, name) == 0; }) &&
         joint_of(model, a[0].kind, a[0].port) == joint_of(model, b[0].kind, b[0].port);
}

bool may_be_taken_for(const EffectAt& a, const EffectAt& b, const tiller_model_t& model) {
  if (a == b || a.kind == kChangedParameter || b.kind == kChangedParameter) return false;
  const EffectInfo &x = info_of(a.kind), &y = info_of(b.kind);
  const bool common = a.port == TILLER_EVERY_PORT || b.port == TILLER_EVERY_PORT;
  if (a.kind == b.kind) return common;
  if (!lists(x, y.name) && !lists(y, x.name) && !are_alike(a.kind, b.kind)) return false;
  return common || joint_of(model, a.kind, a.port) == joint_of(model, b.kind, b.port);
}

}  // namespace tiller::tools::gap
