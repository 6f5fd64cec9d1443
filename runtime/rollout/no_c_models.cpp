// In the place of table_kernel.cpp and table_path.cpp where TILLER_C_MODELS is off: only models that were compiled with
// their kernels run; tiller_config_check refuses others (bad_model, "model.kernels"). With the sweep of lq_general.cpp
// that only they use this saves some 200 KiB of code.

#include "rollout/path.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

const RolloutTable& table_kernel();
const RolloutTable& table_kernel() {
  static const RolloutTable nothing;
  return nothing;
}

const PathKernel& select_path(const RolloutTable& table) { return *table.path; }

}  // namespace tiller
