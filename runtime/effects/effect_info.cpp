#include "effects/effect_info.hpp"

#include <cstring>

#include "effects/catalogue.hpp"

namespace tiller {
namespace {
constexpr EffectInfo kInfos[] = {
#define TILLER_EFFECT(name, Type) Type<double>::info,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
constexpr std::uint32_t kCount = sizeof(kInfos) / sizeof(kInfos[0]);
static_assert(kCount == tiller_effect_kind_count, "the C enumeration and the catalogue come from the same lines");
}  // namespace

const EffectInfo& effect_info(std::uint32_t kind) { return kInfos[kind]; }
std::uint32_t effect_kind_count() { return kCount; }
int find_effect(const char* name) {
  for (std::uint32_t kind = 0; kind < kCount; ++kind)
    if (std::strcmp(kInfos[kind].name, name) == 0) return static_cast<int>(kind);
  return -1;
}

}  // namespace tiller
