// The kernel of slung_quadrotor, compiled once per instruction set.
#include "bench/planning/corridor_models.hpp"
#include "rollout/kernel.hpp"

TILLER_ISA_NAMESPACE_BEGIN
extern const RolloutTable kTable_slung_quadrotor;
const RolloutTable kTable_slung_quadrotor = Kernel<SlungQuadrotor>::table(Isa::TILLER_COMPILE_ISA);
TILLER_ISA_NAMESPACE_END
