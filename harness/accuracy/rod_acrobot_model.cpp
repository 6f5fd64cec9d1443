// The rod acrobot with its kernels.
#include "harness/accuracy/rod_acrobot.hpp"
#include "rollout/model_table.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(RolloutTable, kTable_rod_acrobot)

namespace bench {
namespace {

constexpr ModelKernels kKernels = kernels_of({TILLER_COPIES(kTable_rod_acrobot)});
const tiller_model_t kModel = ModelTable<RodAcrobot>::make(&kKernels);

}  // namespace

const tiller_model_t& rod_acrobot_model();
const tiller_model_t& rod_acrobot_model() { return kModel; }

}  // namespace bench
}  // namespace tiller
