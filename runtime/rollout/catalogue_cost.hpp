#pragma once

// The terms of costs.def: their values, one text for plain numbers, lanes and duals, and their second order by Gauss
// and Newton. S computes, T is the precision of the terms.

#include "costs/catalogue.hpp"
#include "rollout/cost.hpp"
#include "rollout/model_adapter.hpp"
#include "scalar/dual.hpp"

namespace tiller {

/// x[index] where the index is known only at run time.
template <class Model, class S>
TILLER_INLINE S pick_state(const Model& model, const typename Model::template State<S>& x, std::uint32_t index) {
  S value = S(0.0);
  each(model.nx(), [&](auto i) {
    if (static_cast<std::uint32_t>(i) == index) value = x[i];
  });
  return value;
}

/// The residual of a term of the kind, whose state k is state(k).
template <class Kind, class S, class T, class State>
TILLER_INLINE S residual_of(const CatalogueTerm<T>& term, const State& state) {
  S x[TILLER_MAX_COST_TERM_STATES], p[TILLER_MAX_COST_TERM_PARAMS];
  for (std::uint32_t k = 0; k < Kind::info.state_count; ++k) x[k] = state(k);
  for (std::uint32_t k = 0; k < Kind::info.param_count; ++k) p[k] = S(term.params[k]);
  return Kind::template residual<S>(x, p);
}

/// weight r^2.
template <class Model, class S, class T>
TILLER_INLINE S term_cost(const Model& model, const CatalogueTerm<T>& term,
                          const typename Model::template State<S>& x) {
  const auto state = [&](std::uint32_t k) { return pick_state<Model, S>(model, x, term.states[k]); };
  S r = S(0.0);
  switch (term.kind) {
#define TILLER_COST_TERM(key, Kind)        \
  case tiller_cost_term_##key:             \
    r = residual_of<Kind, S>(term, state); \
    break;
#include "tiller/costs.def"
#undef TILLER_COST_TERM
    default: break;
  }
  return S(term.weight) * r * r;
}

/// Terms `first` to `end` of the catalogue's.
template <class Model, class S, class T>
TILLER_INLINE S catalogue_cost(const Model& model, const CostTerms<T>& cost, std::uint32_t first, std::uint32_t end,
                               const typename Model::template State<S>& x) {
  S sum = S(0.0);
  for (std::uint32_t k = first; k < end; ++k) sum = sum + term_cost<Model, S>(model, cost.terms[k], x);
  return sum;
}

/// 2 w r r' of a term, whose second part is left out: positive semidefinite everywhere.
template <class Kind, class S, class E>
TILLER_INLINE void expand_term(const CatalogueTerm<double>& term, int nx, const S* x, E& e) {
  constexpr int n = static_cast<int>(Kind::info.state_count);
  using D = Dual<S, n>;
  const D r =
      residual_of<Kind, D>(term, [&](std::uint32_t k) { return D::seed(x[term.states[k]], static_cast<int>(k)); });
  const S twice = S(2.0 * term.weight), slope = twice * r.v;
  e.value = e.value + S(term.weight) * r.v * r.v;
  for (int a = 0; a < n; ++a) {
    const int row = term.states[a];
    e.lx[row] = e.lx[row] + slope * r.d[a];
    for (int b = 0; b < n; ++b) {
      S& entry = e.lxx[row * nx + term.states[b]];
      entry = entry + twice * r.d[a] * r.d[b];
    }
  }
}

template <class S, class E>
TILLER_INLINE void expand_catalogue(const CostTerms<double>& cost, int nx, const S* x, E& e) {
  for (std::uint32_t k = 0; k < cost.term_count; ++k) {
    const CatalogueTerm<double>& term = cost.terms[k];
    switch (term.kind) {
#define TILLER_COST_TERM(key, Kind)    \
  case tiller_cost_term_##key:         \
    expand_term<Kind>(term, nx, x, e); \
    break;
#include "tiller/costs.def"
#undef TILLER_COST_TERM
      default: break;
    }
  }
}

}  // namespace tiller
