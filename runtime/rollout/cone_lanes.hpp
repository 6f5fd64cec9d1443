#pragma once

#include "core/input_cone.hpp"
#include "rollout/step.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// The inputs of a model kept within cones and changes (core/input_cone.hpp). Out of line: few robots have cones.
template <class Model, class P, class T>
__attribute__((noinline)) void keep_within(const InputCones& cones, const typename Model::template Input<P>& before,
                                           const T* most_change, typename Model::template Input<P>& u) {
  P last[Model::kInputs], wide[Model::kInputs];
  each(Model::nu(), [&](auto i) {
    last[i] = before[i];
    wide[i] = u[i];
  });
  keep_lanes(cones, Model::kInputs, last, most_change, wide);
  each(Model::nu(), [&](auto i) { u[i] = wide[i]; });
}

TILLER_ISA_NAMESPACE_END
