// The sweeps that need no model: any size, and the size of a quadrotor's linear model. Once per instruction set.

#include "rollout/lq_scenarios.hpp"
#include "rollout/lq_sweep.hpp"

TILLER_ISA_NAMESPACE_BEGIN

extern const LqKernel kLqGeneral, kLqTwelveFour;
const LqKernel kLqGeneral = lq::ScenarioSweep<0, 0>::kernel();
const LqKernel kLqTwelveFour = lq::Sweep<12, 4>::kernel();

TILLER_ISA_NAMESPACE_END
