#pragma once

// Called effects are the same functions for every model (effect_calls.hpp). A library of many kernels compiles them
// once an instruction set, in shared_effects.cpp, and its kernels, which define TILLER_EFFECTS_ARE_SHARED, never see
// their texts; a kernel that is loaded alone brings its own.

#include "rollout/effect_calls.hpp"
#include "scalar/dual.hpp"
#include "scalar/pack.hpp"

namespace tiller {

// of the scalars of rollouts and of the numbers of directions that the built-in models have (dual_step.hpp)
#define TILLER_SHARED_EFFECTS(declared, ...)                                                             \
  declared template __VA_ARGS__ called_force(std::uint32_t, const JointStep<__VA_ARGS__>&, __VA_ARGS__*, \
                                             const __VA_ARGS__*);                                        \
  declared template __VA_ARGS__ called_input(std::uint32_t, const InputStep<__VA_ARGS__>&, __VA_ARGS__*, \
                                             const __VA_ARGS__*);                                        \
  declared template void called_body(std::uint32_t, Body<__VA_ARGS__>&, const __VA_ARGS__*);             \
  declared template void called_network(const tiller_network_t&, const __VA_ARGS__&, const __VA_ARGS__*, __VA_ARGS__*);
#define TILLER_SHARED_EFFECTS_OF_ALL(declared)           \
  TILLER_SHARED_EFFECTS(declared, Pack<float>)           \
  TILLER_SHARED_EFFECTS(declared, Pack<double>)          \
  TILLER_SHARED_EFFECTS(declared, Dual<Pack<double>, 2>) \
  TILLER_SHARED_EFFECTS(declared, Dual<Pack<double>, 3>) \
  TILLER_SHARED_EFFECTS(declared, Dual<Pack<double>, 4>) \
  TILLER_SHARED_EFFECTS(declared, Dual<Pack<double>, 5>) \
  TILLER_SHARED_EFFECTS(declared, Dual<Pack<double>, 6>)

#ifndef TILLER_DEFINES_SHARED_EFFECTS
TILLER_SHARED_EFFECTS_OF_ALL(extern)
#endif

}  // namespace tiller
