#pragma once

// One period with everything that a setup may hold, in dual numbers of a few directions. Duals are long arithmetic, so
// there is one text a width, out of line, for all that differentiates through effects: the filters' Jacobians and the
// planners' paths. More directions than it has are taken in passes.

#include "rollout/step.hpp"
#include "scalar/dual.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// Directions that a filter takes at once, which has none but the state's: all where they are few. The wider, the less
/// is computed twice, and the longer it compiles.
template <class Model>
constexpr int kStatePass = Model::kFewStates || Model::kKnowsSlopes ? Model::kStates : 4;

template <class Model, int kDirections>
struct DualStep {
  using P = Pack<double>;
  using D = Dual<P, kDirections>;
  using Step = Stepper<Model, D>;

  /// value, with derivative 1 where `direction` is one of those from `first` on.
  static TILLER_INLINE D seeded(const P& value, int direction, int first) {
    D x(value);
    for (int i = 0; i < kDirections; ++i)
      if (first + i == direction) x.d[i] = P(1.0);
    return x;
  }

  /// history (delay_steps x nu), newest first; null: no input is delayed, whatever the setup says.
  static __attribute__((noinline)) void advance(const Step& step, Trajectory<Model, D>& t,
                                                const typename Model::template Input<D>& u,
                                                const Parameters<Model, D>& p, const double* history) {
    const auto past = [&](int age, int port) {
      if (age > 0) return D(P(history[(age - 1) * Model::kInputs + port]));
      return element(u, port);
    };
    step.advance(t, u, p, past, history != nullptr);
  }
};

TILLER_ISA_NAMESPACE_END
