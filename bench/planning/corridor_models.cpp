#include "bench/planning/corridor_models.hpp"

#include "rollout/kernel_table.hpp"

namespace tiller::bench {

const tiller_model_t& grid_point_mass_model() { return KernelTable<GridPointMass>::kModel; }
const tiller_model_t& slung_quadrotor_model() { return KernelTable<SlungQuadrotor>::kModel; }

}  // namespace tiller::bench
