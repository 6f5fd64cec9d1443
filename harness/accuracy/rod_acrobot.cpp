#include "harness/accuracy/rod_acrobot.hpp"

#include "rollout/kernel_table.hpp"

namespace tiller::bench {

const tiller_model_t& rod_acrobot_model();
const tiller_model_t& rod_acrobot_model() { return KernelTable<RodAcrobot>::kModel; }

}  // namespace tiller::bench
