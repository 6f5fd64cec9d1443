#pragma once

// The cost of a model's outputs: one text for plain numbers, lanes and duals; and to second order by Gauss and Newton.
// A model without outputs leaves nothing of it in its kernels.

#include "rollout/cost_text.hpp"
#include "rollout/expansion.hpp"
#include "scalar/dual.hpp"

namespace tiller {

/// The target of output j in the row that is due.
template <class T>
TILLER_INLINE T output_target(const CostTerms<T>& cost, int ny, std::uint64_t step, int j) {
  if (!cost.output_reference) return static_cast<T>(cost.outputs[j].target);
  const std::size_t row = cost_row(step, cost.output_reference_rows);
  return static_cast<T>(cost.output_reference[row * static_cast<std::size_t>(ny) + static_cast<std::size_t>(j)]);
}

/// How far y stands beyond the bounds of output j, 0 within them.
template <class T, class S>
TILLER_INLINE S beyond_bounds(const tiller_output_cost_t& o, const S& y) {
  return max(max(S(static_cast<T>(o.low)) - y, y - S(static_cast<T>(o.high))), S(0.0));
}

/// sum_j w_j (y_j - t_j)^2, w the terminal weights at the end of the horizon; without the bounds.
template <class Model, class S, class T>
TILLER_INLINE S output_target_cost(const Model& model, const CostTerms<T>& cost, bool terminal, std::uint64_t step,
                                   const typename Model::template Output<S>& y) {
  const int ny = static_cast<int>(model.ny());
  S sum = S(0.0);
  each(model.ny(), [&](auto i) {
    const int j = static_cast<int>(i);
    const S d = y[i] - S(output_target(cost, ny, step, j));
    sum = sum + S(static_cast<T>(terminal ? cost.outputs[j].terminal_weight : cost.outputs[j].weight)) * d * d;
  });
  return sum;
}

/// sum_j b_j max(0, low_j - y_j, y_j - high_j)^2.
template <class Model, class S, class T>
TILLER_INLINE S output_bounds_cost(const Model& model, const CostTerms<T>& cost,
                                   const typename Model::template Output<S>& y) {
  S sum = S(0.0);
  each(model.ny(), [&](auto i) {
    const tiller_output_cost_t& o = cost.outputs[static_cast<int>(i)];
    const S outside = beyond_bounds<T>(o, y[i]);
    sum = sum + S(static_cast<T>(o.bound_weight)) * outside * outside;
  });
  return sum;
}

/// Both, from the state; 0 where nothing is asked of the outputs.
template <class Model, class S, class T>
TILLER_INLINE S output_cost(const Model& model, const CostTerms<T>& cost, bool terminal, std::uint64_t step,
                            const typename Model::template State<S>& x, const typename Model::template Params<S>& p) {
  S sum = S(0.0);
  if constexpr (Model::kOutputs > 0) {
    if (cost.has(kCostOutputs) || cost.has(kCostOutputBounds)) {
      const auto y = model.template outputs<S>(x, p);
      if (cost.has(kCostOutputs)) sum = output_target_cost<Model, S>(model, cost, terminal, step, y);
      if (cost.has(kCostOutputBounds)) sum = sum + output_bounds_cost<Model, S>(model, cost, y);
    }
  }
  return sum;
}

/// The bounds alone, whatever `extra` says: they belong to the penalties.
template <class Model, class S, class T>
TILLER_INLINE S output_penalty(const Model& model, const CostTerms<T>& cost, const typename Model::template State<S>& x,
                               const typename Model::template Params<S>& p) {
  if constexpr (Model::kOutputs > 0)
    if (cost.outputs) return output_bounds_cost<Model, S>(model, cost, model.template outputs<S>(x, p));
  return S(0.0);
}

/// Adds output j to a second order, given its value and its gradient (nx): Gauss and Newton's, 2 w J' J, which is exact
/// where the output is linear and positive semidefinite everywhere. `target` and `weight` are the row's.
template <class S, class E>
TILLER_INLINE void expand_output(const tiller_output_cost_t& o, const S& target, double weight, int nx, const S& y,
                                 const S* gradient, E& e) {
  const S d = y - target;
  const S above = max(y - S(o.high), S(0.0)), below = max(S(o.low) - y, S(0.0));
  const S outside = above - below;
  e.value = e.value + S(weight) * d * d + S(o.bound_weight) * outside * outside;
  const S slope = S(2.0 * weight) * d + S(2.0 * o.bound_weight) * outside;
  const S curvature = S(2.0 * weight) + select(above + below > S(0.0), S(2.0 * o.bound_weight), S(0.0));
  for (int r = 0; r < nx; ++r) {
    e.lx[r] = e.lx[r] + slope * gradient[r];
    const S scaled = curvature * gradient[r];
    for (int c = 0; c < nx; ++c) e.lxx[r * nx + c] = e.lxx[r * nx + c] + scaled * gradient[c];
  }
}

/// Outputs to second order of a model written as a template: kPass directions at once. due(table, rows, count, index)
/// as for expand_states.
template <class Model, class S, class Due, class E>
TILLER_INLINE void expand_outputs(const CostTerms<double>& cost, bool terminal, const Due& due,
                                  const typename Model::template State<S>& x,
                                  const typename Model::template Params<S>& p, E& e) {
  constexpr int kX = Model::kStates, kY = Model::kOutputs, kPass = kX <= 8 ? kX : 4;
  using D = Dual<S, kPass>;
  S value[kY], gradient[kY][kX];
  typename Model::template Params<D> pd;
  each(Model::np(), [&](auto i) { pd[i] = D(p[i]); });
  for (int first = 0; first < kX; first += kPass) {
    typename Model::template State<D> xd;
    each(Model::nx(), [&](auto i) {
      xd[i] = D(x[i]);
      if (i >= first && i < first + kPass) xd[i].d[i - first] = S(1.0);
    });
    const auto y = Model::template outputs<D>(xd, pd);
    each(Model::ny(), [&](auto j) {
      value[j] = y[j].v;
      for (int k = 0; k < kPass && first + k < kX; ++k) gradient[j][first + k] = y[j].d[k];
    });
  }
  for (int j = 0; j < kY; ++j) {
    const tiller_output_cost_t& o = cost.outputs[j];
    const double weight = terminal ? o.terminal_weight : o.weight;
    if (!(weight > 0.0) && !(o.bound_weight > 0.0)) continue;
    const S target =
        cost.output_reference ? due(cost.output_reference, cost.output_reference_rows, kY, j) : S(o.target);
    expand_output<S>(o, target, weight, kX, value[j], gradient[j], e);
  }
}

}  // namespace tiller
