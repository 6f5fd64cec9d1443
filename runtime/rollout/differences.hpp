#pragma once

// State less state, as the cost takes it: angles wrapped, rows of tables in the precision of the terms.

#include <cmath>

#include "rollout/model_adapter.hpp"
#include "rollout/quaternion.hpp"

namespace tiller {

/// A table's value of state i in the precision of the terms. Whole turns of an angle make no difference to what is
/// wrapped and would cost single precision its digits; up to 16 of them (turns.hpp) it stays as it is.
template <class T, class Model, class I>
TILLER_INLINE T table_value(const Model& model, I i, double value) {
  if (model.is_angle(i) && (value > 100.53096491487338 || value < -100.53096491487338))
    value -= 6.283185307179586 * std::nearbyint(value * 0.15915494309189535);
  return static_cast<T>(value);
}

/// a - b, wrapped to +-pi where state i is an angle.
template <class Model, class S, class I>
TILLER_INLINE S wrapped_difference(const Model& model, I i, const S& a, const S& b) {
  const S difference = a - b;
  if (!model.is_angle(i)) return difference;
  return difference - S(6.283185307179586) * nearest(difference * S(0.15915494309189535));
}

/// x - b state by state, b(i) being state i of b.
template <class Model, class S, class B>
TILLER_INLINE typename Model::template State<S> differences(const Model& model,
                                                            const typename Model::template State<S>& x, const B& b) {
  typename Model::template State<S> d;
  each(model.nx(), [&](auto i) { d[i] = wrapped_difference<Model, S>(model, i, x[i], b(i)); });
  turn_differences<Model, S>(model, x, b, d);
  return d;
}

}  // namespace tiller
