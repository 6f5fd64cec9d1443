#pragma once

// Rows of lanes into registers.

#include "rollout/step.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <class P>
TILLER_INLINE P load_row(const Lanes<typename P::value_type>& rows, int row, std::uint32_t lane) {
  return rows.splat() ? P(rows.data[row]) : P::load(rows.data + static_cast<std::size_t>(row) * rows.stride + lane);
}
template <class S, class P, class Fields, class Count>
TILLER_INLINE void load_fields(Fields& fields, Count count, const Lanes<typename P::value_type>& rows, int first_row,
                               std::uint32_t lane) {
  each(count, [&](auto i) { fields[i] = S(load_row<P>(rows, first_row + i, lane)); });
}
template <class Model, class S, class P, class T>
TILLER_INLINE void load_parameters(Parameters<Model, S>& p, const StepSetup& setup, const Lanes<T>& rows,
                                   std::uint32_t lane) {
  load_fields<S, P>(p.model, Model::np(), rows, 0, lane);
  int last = Model::kParams;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e) {
    const int end = setup.effects[e].param + effect_info(setup.effects[e].kind).param_count;
    if (end > last) last = end;
  }
  if (setup.fading > 0) last = static_cast<int>(setup.fading_param + setup.extra_params());
  for (int i = Model::kParams; i < last; ++i) p.effect[i - Model::kParams] = S(load_row<P>(rows, i, lane));
}

TILLER_ISA_NAMESPACE_END
