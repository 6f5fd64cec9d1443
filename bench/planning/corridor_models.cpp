// The models of bench_corridors with their kernels.
#include "bench/planning/corridor_models.hpp"

#include "rollout/model_table.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(RolloutTable, kTable_grid_point_mass)
TILLER_DECLARE_COPIES(RolloutTable, kTable_slung_quadrotor)

namespace bench {
namespace {

constexpr ModelKernels kGridKernels = kernels_of({TILLER_COPIES(kTable_grid_point_mass)});
constexpr ModelKernels kSlungKernels = kernels_of({TILLER_COPIES(kTable_slung_quadrotor)});
const tiller_model_t kGridPointMass = ModelTable<GridPointMass>::make(&kGridKernels);
const tiller_model_t kSlungQuadrotor = ModelTable<SlungQuadrotor>::make(&kSlungKernels);

}  // namespace

const tiller_model_t& grid_point_mass_model() { return kGridPointMass; }
const tiller_model_t& slung_quadrotor_model() { return kSlungQuadrotor; }

}  // namespace bench
}  // namespace tiller
