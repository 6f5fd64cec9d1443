#pragma once

// A cost of the user's own in lanes: the template beside the model, or the function in C, one lane after the other.
//
// A template's signature, with the model's structs:
//     template <class S>
//     struct MyCost {
//       static S stage(const typename MyModel<S>::State& x, const typename MyModel<S>::Input& u,
//                      const typename MyModel<S>::Params& p, const S& time_s);
//       static S terminal(const typename MyModel<S>::State& x, const typename MyModel<S>::Params& p, const S& time_s);
//     };

#include "rollout/cost_text.hpp"
#include "scalar/pack.hpp"

namespace tiller {

/// No cost of one's own beside the model.
template <class S>
struct NoCost {};

}  // namespace tiller

TILLER_ISA_NAMESPACE_BEGIN

template <class Model, template <class> class Cost, class P>
struct OwnCost {
  using State = typename Model::template State<P>;
  using Input = typename Model::template Input<P>;
  using Params = typename Model::template Params<P>;
  static constexpr bool kTemplate = !std::is_same<Cost<double>, NoCost<double>>::value;

  /// Weighted; u is null at the end of the horizon.
  template <class T>
  static TILLER_INLINE P evaluate(const CostTerms<T>& cost, const State& x, const Input* u, const Params& p,
                                  double time_s) {
    P value = P(0.0);
    if (cost.has(kCostOwnFunction)) {
      value = by_function<T>(*cost.own, x, u, p, time_s);
    } else if constexpr (kTemplate) {
      value = u ? Cost<P>::stage(x, *u, p, P(time_s)) : Cost<P>::terminal(x, p, P(time_s));
    }
    return P(cost.own_weight) * value;
  }

  template <class T>
  static P by_function(const tiller_own_cost_t& own, const State& x, const Input* u, const Params& p, double time_s) {
    constexpr int kWidth = P::width;
    T xs[Model::kStates][kWidth], us[Model::kInputs][kWidth] = {}, ps[Model::kParams + 1][kWidth], out[kWidth] = {};
    each(Model::nx(), [&](auto i) { x[i].store(xs[i]); });
    if (u) each(Model::nu(), [&](auto i) { (*u)[i].store(us[i]); });
    each(Model::np(), [&](auto i) { p[i].store(ps[i]); });
    for (int l = 0; l < kWidth; ++l) {
      double xl[Model::kStates], ul[Model::kInputs], pl[Model::kParams + 1];
      for (int i = 0; i < Model::kStates; ++i) xl[i] = static_cast<double>(xs[i][l]);
      for (int i = 0; i < Model::kInputs; ++i) ul[i] = static_cast<double>(us[i][l]);
      for (int i = 0; i < Model::kParams; ++i) pl[i] = static_cast<double>(ps[i][l]);
      if (u)
        out[l] = static_cast<T>(own.stage(xl, ul, pl, time_s, own.context));
      else if (own.terminal)
        out[l] = static_cast<T>(own.terminal(xl, pl, time_s, own.context));
    }
    return P::load(out);
  }
};

TILLER_ISA_NAMESPACE_END
