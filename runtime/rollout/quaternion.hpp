#pragma once

// Unit quaternions among the states of a model (tiller_model_t.quaternion_mask). A model without any pays nothing: all
// of this falls away while it compiles.
//
// A quaternion has four states and three degrees of freedom. Every step ends on the unit sphere, so its Jacobian has
// no part along the quaternion itself: linear problems in the four states are those of the tangent plane, to first
// order, as long as differences are tangent (attitude_difference in rotation.hpp). Differences stand in the last three
// of the four states, along the body's axes; the first is always 0.

#include "rollout/model_adapter.hpp"
#include "tiller/rotation.hpp"

namespace tiller {

template <int I, int K>
constexpr Index<I + K> behind(Index<I>, Index<K>) {
  return {};
}
template <int K>
constexpr int behind(int i, Index<K>) {
  return i + K;
}

/// f(first) for the first of each four states, a constant where the model is one.
template <class Model, class F, int I>
TILLER_INLINE void if_quaternion(const Model&, Index<I> i, F&& f) {
  if constexpr ((Model::kQuaternions >> I) & 1u) f(i);
}
template <class Model, class F>
TILLER_INLINE void if_quaternion(const Model& model, int i, F&& f) {
  if ((model.quaternions() >> i) & 1u) f(i);
}
template <class Model, class F>
TILLER_INLINE void each_quaternion(const Model& model, F&& f) {
  if constexpr (Model::kMayTurn) each(model.nx(), [&](auto i) TILLER_INLINED { if_quaternion(model, i, f); });
}

/// The four from `first` on; at(i) is state i.
template <class S, class At, class I>
TILLER_INLINE Quaternion<S> quaternion_of(const At& at, I first) {
  return {S(at(first)), S(at(behind(first, Index<1>{}))), S(at(behind(first, Index<2>{}))),
          S(at(behind(first, Index<3>{})))};
}
template <class State, class S, class I>
TILLER_INLINE void put_quaternion(State& x, I first, const Quaternion<S>& q) {
  x[first] = q.w;
  x[behind(first, Index<1>{})] = q.x;
  x[behind(first, Index<2>{})] = q.y;
  x[behind(first, Index<3>{})] = q.z;
}

/// What ends a step.
template <class Model, class S>
TILLER_INLINE void normalise_quaternions(const Model& model, typename Model::template State<S>& x) {
  each_quaternion(model, [&](auto first) TILLER_INLINED {
    put_quaternion(x, first, normalised(quaternion_of<S>([&](auto i) { return x[i]; }, first)));
  });
}

/// The quaternions' part of the differences d = x - b; b(i) is state i of what is subtracted.
template <class Model, class S, class B>
TILLER_INLINE void turn_differences(const Model& model, const typename Model::template State<S>& x, const B& b,
                                    typename Model::template State<S>& d) {
  each_quaternion(model, [&](auto first) TILLER_INLINED {
    const Vector3<S> turn =
        attitude_difference(quaternion_of<S>([&](auto i) { return x[i]; }, first), quaternion_of<S>(b, first));
    put_quaternion(d, first, Quaternion<S>{S(0.0), turn.x, turn.y, turn.z});
  });
}

/// Gradient lx (nx) and Hessian lxx (nx x nx) by the differences become those by the states x.
template <class Model, class S, class B>
TILLER_INLINE void expand_turns(const Model& model, const typename Model::template State<S>& x, const B& b, S* lx,
                                S* lxx) {
  const int nx = static_cast<int>(model.nx());
  each_quaternion(model, [&](auto index) {
    using D = Dual<S, 4>;
    const int first = static_cast<int>(index);
    Quaternion<D> a = quaternion_of<D>([&](auto i) { return D(x[i]); }, index);
    a.w.d[0] = a.x.d[1] = a.y.d[2] = a.z.d[3] = S(1.0);
    const Vector3<D> turn = attitude_difference(a, quaternion_of<D>([&](auto i) { return D(b(i)); }, index));
    const D* const slope[3] = {&turn.x, &turn.y, &turn.z};
    const auto pull = [&](S* at, int stride) {  // four numbers v become J' v
      const S v[3] = {at[stride], at[2 * stride], at[3 * stride]};
      for (int c = 0; c < 4; ++c)
        at[c * stride] = slope[0]->d[c] * v[0] + slope[1]->d[c] * v[1] + slope[2]->d[c] * v[2];
    };
    pull(lx + first, 1);
    for (int c = 0; c < nx; ++c) pull(lxx + first * nx + c, nx);
    for (int r = 0; r < nx; ++r) pull(lxx + r * nx + first, 1);
  });
}

}  // namespace tiller
