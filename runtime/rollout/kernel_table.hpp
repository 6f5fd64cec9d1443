#pragma once

// A model's table with the kernel of the one instruction set that this source is compiled for. It links the library's
// effects (shared_effects.hpp).

#ifndef TILLER_EFFECTS_ARE_SHARED
#define TILLER_EFFECTS_ARE_SHARED
#endif
#include "rollout/kernel.hpp"
#include "rollout/model_table.hpp"

namespace tiller {

template <template <class> class Type>
struct KernelTable {
  static constexpr ModelKernels make() {
    ModelKernels k{};
    k.table[static_cast<int>(Isa::TILLER_COMPILE_ISA)] = &kTable;
    return k;
  }
  static constexpr RolloutTable kTable = Kernel<Type>::table(Isa::TILLER_COMPILE_ISA);
  static constexpr ModelKernels kKernels = make();
  static constexpr tiller_model_t kModel = ModelTable<Type>::make(&kKernels);
};

}  // namespace tiller
