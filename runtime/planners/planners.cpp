#include "planners/planner.hpp"

namespace tiller {

#define TILLER_PLANNER(name, help) extern const PlannerTable name##_planner;
#include "planners/planners.def"
#undef TILLER_PLANNER

namespace {

enum PlannerIndex {
#define TILLER_PLANNER(name, help) name##_index,
#include "planners/planners.def"
#undef TILLER_PLANNER
  planner_index_count
};
#define TILLER_PLANNER(name, help) \
  static_assert(int{name##_index} == int{tiller_planner_##name}, "planners.def is not in the order of the enum");
#include "planners/planners.def"
#undef TILLER_PLANNER
static_assert(int{planner_index_count} == int{tiller_planner_kind_count}, "a planner lacks its line in planners.def");

// null: left out of this build (TILLER_PLANNERS); the linker then needs nothing of it
const PlannerTable* const kPlanners[] = {
#define TILLER_PLANNER(name, help) TILLER_BUILT_PLANNER_##name ? &name##_planner : nullptr,
#include "planners/planners.def"
#undef TILLER_PLANNER
};

const char* const kHelp[] = {
#define TILLER_PLANNER(name, help) help,
#include "planners/planners.def"
#undef TILLER_PLANNER
};

}  // namespace

const PlannerTable* find_planner(std::uint32_t kind) {
  return kind < tiller_planner_kind_count ? kPlanners[kind] : nullptr;
}

const char* planner_help(std::uint32_t kind) { return kind < tiller_planner_kind_count ? kHelp[kind] : nullptr; }

}  // namespace tiller
