// The sweeps that need no model: any size, and the size of a quadrotor's linear model. Once per instruction set.

#include "rollout/lq_scenarios.hpp"
#include "rollout/lq_sweep.hpp"

TILLER_ISA_NAMESPACE_BEGIN

extern const LqKernel kLqGeneral, kLqTwelveFour;
const LqKernel kLqGeneral = lq::ScenarioSweep<0, 0>::kernel();
#if defined(TILLER_NO_C_MODELS)
// A hundred kilobytes, unrolled, for models in C alone: others bring sweeps of their own size.
const LqKernel kLqTwelveFour = lq::ScenarioSweep<0, 0>::kernel();
#else
const LqKernel kLqTwelveFour = lq::Sweep<12, 4>::kernel();
#endif

TILLER_ISA_NAMESPACE_END
