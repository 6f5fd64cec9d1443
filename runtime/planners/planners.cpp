#include "planners/planner.hpp"

namespace tiller {

#define TILLER_PLANNER(name, help) extern const PlannerTable name##_planner;
#include "tiller/planners.def"

namespace {

// null: left out of this build (TILLER_PLANNERS); the linker then needs nothing of it
const PlannerTable* const kPlanners[] = {
#define TILLER_PLANNER(name, help) TILLER_BUILT_PLANNER_##name ? &name##_planner : nullptr,
#include "tiller/planners.def"
};

const char* const kHelp[] = {
#define TILLER_PLANNER(name, help) help,
#include "tiller/planners.def"
};

}  // namespace

const PlannerTable* find_planner(std::uint32_t kind) {
  return kind < tiller_planner_kind_count ? kPlanners[kind] : nullptr;
}

const char* planner_help(std::uint32_t kind) { return kind < tiller_planner_kind_count ? kHelp[kind] : nullptr; }

}  // namespace tiller
