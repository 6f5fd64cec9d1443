#include "rollout/rollout.hpp"

namespace tiller {

const RolloutTable& table_kernel();

const RolloutTable& select_rollout(const tiller_model_t& model, Isa best) {
  if (const auto* kernels = static_cast<const ModelKernels*>(model.kernels))
    for (int isa = static_cast<int>(best); isa >= 0; --isa)
      if (kernels->table[isa] && has_isa(static_cast<Isa>(isa))) return *kernels->table[isa];
  return table_kernel();
}

}  // namespace tiller
