// Compiled for one instruction set: a model of twelve states, and beside it the same equations as a table in C.

#include "large_models.hpp"

#include "rollout/kernel_table.hpp"
#include "spatial_quadrotor.hpp"

namespace tiller::test {
namespace {

constexpr tiller_model_t kInC = ModelTable<SpatialQuadrotor>::make(nullptr);

}  // namespace

const tiller_model_t* large_model() { return &KernelTable<SpatialQuadrotor>::kModel; }
const tiller_model_t* large_model_in_c() { return &kInC; }

}  // namespace tiller::test
