// Compiled for one instruction set: a model of twelve states, and beside it the same equations as a table in C.

#include "large_models.hpp"

#include "rollout/kernel.hpp"
#include "rollout/model_table.hpp"
#include "spatial_quadrotor.hpp"

namespace tiller::test {
namespace {

template <template <class> class Type>
struct Table {
  static constexpr ModelKernels make() {
    ModelKernels k{};
    k.table[static_cast<int>(Isa::TILLER_COMPILE_ISA)] = &kTable;
    return k;
  }
  static constexpr RolloutTable kTable = Kernel<Type>::table(Isa::TILLER_COMPILE_ISA);
  static constexpr ModelKernels kKernels = make();
  static constexpr tiller_model_t kModel = ModelTable<Type>::make(&kKernels);
  static constexpr tiller_model_t kInC = ModelTable<Type>::make(nullptr);
};

}  // namespace

const tiller_model_t* spatial_quadrotor() { return &Table<SpatialQuadrotor>::kModel; }
const tiller_model_t* spatial_quadrotor_in_c() { return &Table<SpatialQuadrotor>::kInC; }

}  // namespace tiller::test
