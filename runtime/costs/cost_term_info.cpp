#include "costs/cost_term_info.hpp"

#include "costs/catalogue.hpp"

namespace tiller {
namespace {
constexpr CostTermInfo kInfos[] = {
#define TILLER_COST_TERM(key, Type) Type::info,
#include "tiller/costs.def"
#undef TILLER_COST_TERM
};
constexpr const char* kKeys[] = {
#define TILLER_COST_TERM(key, Type) #key,
#include "tiller/costs.def"
#undef TILLER_COST_TERM
};
static_assert(sizeof(kInfos) / sizeof(kInfos[0]) == tiller_cost_term_kind_count,
              "the C enumeration and the catalogue come from the same lines");
}  // namespace

const CostTermInfo& cost_term_info(std::uint32_t kind) { return kInfos[kind]; }
const char* cost_term_key(std::uint32_t kind) { return kKeys[kind]; }

}  // namespace tiller
