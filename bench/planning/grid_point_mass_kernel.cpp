// The kernel of grid_point_mass, compiled once per instruction set.
#include "bench/planning/corridor_models.hpp"
#include "rollout/kernel.hpp"

TILLER_ISA_NAMESPACE_BEGIN
extern const RolloutTable kTable_grid_point_mass;
const RolloutTable kTable_grid_point_mass = Kernel<GridPointMass>::table(Isa::TILLER_COMPILE_ISA);
TILLER_ISA_NAMESPACE_END
