// The rod acrobot's kernel, compiled once per instruction set.
#include "harness/accuracy/rod_acrobot.hpp"
#include "rollout/kernel.hpp"

TILLER_ISA_NAMESPACE_BEGIN
extern const RolloutTable kTable_rod_acrobot;
const RolloutTable kTable_rod_acrobot = Kernel<RodAcrobot>::table(Isa::TILLER_COMPILE_ISA);
TILLER_ISA_NAMESPACE_END
