#pragma once

// The cost to second order, term by term, with the convex choices that QuadratiseJob states: one text for lanes (a lane
// per step) and for plain numbers.

#include "rollout/cost_text.hpp"
#include "rollout/psd.hpp"
#include "scalar/inline.hpp"

namespace tiller {

/// Second order around one step; nx and nu are the model's counts, kX and kU their bounds.
template <class S, int kX, int kU>
struct Expansion {
  S value;
  S lx[kX], lu[kU], lb[kU];
  S lxx[kX * kX], luu[kU * kU], lux[kU * kX];

  TILLER_INLINE void clear(int nx, int nu) {
    value = S(0.0);
    for (int i = 0; i < nx; ++i) lx[i] = S(0.0);
    for (int i = 0; i < nu; ++i) lu[i] = lb[i] = S(0.0);
    for (int i = 0; i < nx * nx; ++i) lxx[i] = S(0.0);
    for (int i = 0; i < nu * nu; ++i) luu[i] = S(0.0);
    for (int i = 0; i < nu * nx; ++i) lux[i] = S(0.0);
  }
};

/// w (1 - e^(-q/2)), q = sum (d_i / width_i)^2: gradient w e z with z_i = d_i / width_i^2; of the second derivative
/// w e (diag(1 / width^2) - z z') the first part stays, which is what makes it convex everywhere.
template <class S, class E>
TILLER_INLINE void expand_saturating(const CostTerms<double>& cost, int nx, const S* d, E& e) {
  S q = S(0.0);
  for (int i = 0; i < nx; ++i) {
    const S z = d[i] * S(cost.inverse_width[i]);
    q = q + z * z;
  }
  const S bell = S(cost.saturating_weight) * exp(S(-0.5) * q);
  e.value = e.value + S(cost.saturating_weight) - bell;
  for (int i = 0; i < nx; ++i) {
    const S curvature = bell * S(cost.inverse_width[i] * cost.inverse_width[i]);
    e.lx[i] = e.lx[i] + curvature * d[i];
    e.lxx[i * nx + i] = e.lxx[i * nx + i] + curvature;
  }
}

template <class S, class E>
TILLER_INLINE void expand_bounds(const CostTerms<double>& cost, int nx, const S* x, E& e) {
  for (int i = 0; i < nx; ++i) {
    if (!(cost.bound[i] > 0.0)) continue;
    const S above = max(x[i] - S(cost.high[i]), S(0.0)), below = max(S(cost.low[i]) - x[i], S(0.0));
    const S outside = above - below, twice = S(2.0 * cost.bound[i]);
    e.value = e.value + S(cost.bound[i]) * outside * outside;
    e.lx[i] = e.lx[i] + twice * outside;
    e.lxx[i * nx + i] = e.lxx[i * nx + i] + select(above + below > S(0.0), twice, S(0.0));
  }
}

/// Gauss-Newton of the depth: 2 w n n' inside, n the direction away from the centre. At the centre itself there is no
/// direction: value alone.
template <class S, class E>
TILLER_INLINE void expand_obstacles(const CostTerms<double>& cost, int nx, const S* x, E& e) {
  for (std::uint32_t k = 0; k < cost.obstacle_count; ++k) {
    const CostObstacle<double>& o = cost.obstacles[k];
    const int a = static_cast<int>(o.x_state), b = static_cast<int>(o.y_state);
    const S dx = x[a] - S(o.x_m), dy = x[b] - S(o.y_m);
    const S distance = sqrt(dx * dx + dy * dy);
    const S depth = max(S(o.radius_m) - distance, S(0.0));
    const S inverse = select(distance > S(0.0), S(1.0) / select(distance > S(0.0), distance, S(1.0)), S(0.0));
    const S nx_out = dx * inverse, ny_out = dy * inverse;
    const S slope = S(-2.0 * o.weight) * depth;
    const S curvature = select(depth > S(0.0), S(2.0 * o.weight), S(0.0));
    e.value = e.value + S(o.weight) * depth * depth;
    e.lx[a] = e.lx[a] + slope * nx_out;
    e.lx[b] = e.lx[b] + slope * ny_out;
    e.lxx[a * nx + a] = e.lxx[a * nx + a] + curvature * nx_out * nx_out;
    e.lxx[b * nx + b] = e.lxx[b * nx + b] + curvature * ny_out * ny_out;
    e.lxx[a * nx + b] = e.lxx[a * nx + b] + curvature * nx_out * ny_out;
    e.lxx[b * nx + a] = e.lxx[b * nx + a] + curvature * nx_out * ny_out;
  }
}

/// w / 2 |W d|^2; root(r, c) is W of the row that is due.
template <int kX, class S, class Root, class E>
TILLER_INLINE void expand_demonstration(double weight, int nx, const S* d, const Root& root, E& e) {
  for (int r = 0; r < nx; ++r) {
    S row[kX], residual = S(0.0);
    for (int c = 0; c < nx; ++c) {
      row[c] = root(r, c);
      residual = residual + row[c] * d[c];
    }
    e.value = e.value + S(0.5 * weight) * residual * residual;
    for (int c = 0; c < nx; ++c) {
      const S scaled = S(weight) * row[c];
      e.lx[c] = e.lx[c] + scaled * residual;
      for (int k = 0; k < nx; ++k) e.lxx[c * nx + k] = e.lxx[c * nx + k] + scaled * row[k];
    }
  }
}

template <class S, class E>
TILLER_INLINE void expand_cost_to_go(const CostTerms<double>& cost, int nx, const S* d, E& e) {
  for (int r = 0; r < nx; ++r) {
    S half = S(0.0);
    for (int c = 0; c < nx; ++c) {
      half = half + S(cost.cost_to_go[r * nx + c]) * d[c];
      e.lxx[r * nx + c] = e.lxx[r * nx + c] + S(2.0 * cost.cost_to_go[r * nx + c]);
    }
    e.value = e.value + half * d[r];
    e.lx[r] = e.lx[r] + S(2.0) * half;
  }
}

/// expand_states() of a model with quaternions: what is written by differences first, then the derivatives by states.
/// Their second derivatives are left out (Gauss and Newton). There are no demonstrations (tiller_config_check).
template <int kX, class Model, class S, class Due, class E>
TILLER_INLINE void expand_turning(const Model& model, const CostTerms<double>& cost, const double* weight,
                                  const Due& due, const typename Model::template State<S>& state, E& e) {
  const int nx = static_cast<int>(model.nx());
  S x[kX], d[kX];
  const auto target = [&](auto i) {
    const int k = static_cast<int>(i);
    return cost.has(kCostReference) ? due(cost.reference, cost.reference_rows, nx, k) : S(cost.target[k]);
  };
  const auto off = differences<Model, S>(model, state, target);
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    x[k] = state[i];
    d[k] = off[i];
    e.value = e.value + S(weight[k]) * d[k] * d[k];
    e.lx[k] = e.lx[k] + S(2.0 * weight[k]) * d[k];
    e.lxx[k * nx + k] = e.lxx[k * nx + k] + S(2.0 * weight[k]);
  });
  if (cost.has(kCostSaturating)) expand_saturating<S>(cost, nx, d, e);
  if (cost.has(kCostToGo) && weight == cost.terminal) expand_cost_to_go<S>(cost, nx, d, e);
  expand_turns<Model, S>(model, state, target, e.lx, e.lxx);
  if (cost.has(kCostBounds)) expand_bounds<S>(cost, nx, x, e);
  if (cost.has(kCostObstacles)) expand_obstacles<S>(cost, nx, x, e);
}

/// All that a state costs but an own cost; `weight` is Q or Qf. due(table, rows, count, index) is entry `index` of the
/// row of `count` that is due in each lane.
template <int kX, class Model, class S, class Due, class E>
TILLER_INLINE void expand_states(const Model& model, const CostTerms<double>& cost, const double* weight,
                                 const Due& due, const typename Model::template State<S>& state, E& e) {
  const int nx = static_cast<int>(model.nx());
  if constexpr (Model::kMayTurn)
    if (model.quaternions() != 0) return expand_turning<kX, Model, S>(model, cost, weight, due, state, e);
  S x[kX], d[kX];
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    const S target = cost.has(kCostReference) ? due(cost.reference, cost.reference_rows, nx, k) : S(cost.target[k]);
    x[k] = state[i];
    d[k] = wrapped_difference<Model, S>(model, i, state[i], target);
    e.value = e.value + S(weight[k]) * d[k] * d[k];
    e.lx[k] = e.lx[k] + S(2.0 * weight[k]) * d[k];
    e.lxx[k * nx + k] = e.lxx[k * nx + k] + S(2.0 * weight[k]);
  });
  if (cost.has(kCostSaturating)) expand_saturating<S>(cost, nx, d, e);
  if (cost.has(kCostBounds)) expand_bounds<S>(cost, nx, x, e);
  if (cost.has(kCostObstacles)) expand_obstacles<S>(cost, nx, x, e);
  if (cost.has(kCostToGo) && weight == cost.terminal) expand_cost_to_go<S>(cost, nx, d, e);
  if (!cost.has(kCostDemonstration)) return;
  const std::uint32_t rows = cost.demonstration_rows;
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    d[k] = wrapped_difference<Model, S>(model, i, state[i], due(cost.demonstration_mean, rows, nx, k));
  });
  const auto root = [&](int r, int c) { return due(cost.demonstration_root, rows, nx * nx, r * nx + c); };
  expand_demonstration<kX, S>(cost.demonstration_weight, nx, d, root, e);
}

template <class Model, class S, class E>
TILLER_INLINE void expand_inputs(const Model& model, const CostTerms<double>& cost,
                                 const typename Model::template Input<S>& u,
                                 const typename Model::template Input<S>& before, E& e) {
  const int nu = static_cast<int>(model.nu());
  each(model.nu(), [&](auto i) {
    const int k = static_cast<int>(i);
    const S off = u[i] - S(cost.input_centre[k]), change = u[i] - before[i];
    const S rate = S(2.0 * cost.input_rate[k]) * change;
    e.value = e.value + S(cost.input[k]) * off * off + S(cost.input_rate[k]) * change * change;
    e.lu[k] = e.lu[k] + S(2.0 * cost.input[k]) * off + rate;
    e.lb[k] = e.lb[k] - rate;
    e.luu[k * nu + k] = e.luu[k * nu + k] + S(2.0 * (cost.input[k] + cost.input_rate[k]));
  });
}

/// Adds weight times a cost of one's own, given by value, gradient (n) and Hessian (n x n) over (x, u), with the
/// Hessian's negative eigenvalues clipped; n = nx at the end of the horizon. The Hessian is overwritten.
template <int kN, class S, class E>
TILLER_INLINE void add_own(double weight, int nx, int nu, int n, const S& value, const S* gradient, S* hessian, E& e) {
  clip_negative_eigenvalues<kN>(hessian, n);
  const S w = S(weight);
  e.value = e.value + w * value;
  for (int r = 0; r < nx; ++r) {
    e.lx[r] = e.lx[r] + w * gradient[r];
    for (int c = 0; c < nx; ++c) e.lxx[r * nx + c] = e.lxx[r * nx + c] + w * hessian[r * n + c];
  }
  if (n == nx) return;
  for (int r = 0; r < nu; ++r) {
    const int row = nx + r;
    e.lu[r] = e.lu[r] + w * gradient[row];
    for (int c = 0; c < nu; ++c) e.luu[r * nu + c] = e.luu[r * nu + c] + w * hessian[row * n + nx + c];
    for (int c = 0; c < nx; ++c) e.lux[r * nx + c] = e.lux[r * nx + c] + w * hessian[row * n + c];
  }
}

/// Value, gradient and Hessian of a function in C by central differences: widths of eps^(1/3) and eps^(1/4), relative
/// to the argument where it is above 1. z = (x, u), n of them; the end of the horizon where `stage` is false.
/// 1 + 2 n + 2 n^2 calls.
TILLER_INLINE void difference_own(const tiller_own_cost_t& own, bool stage, int nx, int n, const double* z,
                                  const double* p, double time_s, double& value, double* gradient, double* hessian) {
  double at[TILLER_MAX_STATES + TILLER_MAX_INPUTS];
  const auto call = [&] {
    if (stage) return own.stage(at, at + nx, p, time_s, own.context);
    return own.terminal ? own.terminal(at, p, time_s, own.context) : 0.0;
  };
  const auto width = [&](int i, double relative) {
    const double size = z[i] < 0.0 ? -z[i] : z[i];
    return relative * (size > 1.0 ? size : 1.0);
  };
  for (int i = 0; i < n; ++i) at[i] = z[i];
  value = call();
  for (int i = 0; i < n; ++i) {
    const double narrow = width(i, 6e-6), wide = width(i, 1.2e-4);
    const auto moved = [&](double way) {
      at[i] = z[i] + way;
      const double result = call();
      at[i] = z[i];
      return result;
    };
    gradient[i] = (moved(narrow) - moved(-narrow)) / (2.0 * narrow);
    hessian[i * n + i] = (moved(wide) - 2.0 * value + moved(-wide)) / (wide * wide);
    for (int j = 0; j < i; ++j) {
      const double other = width(j, 1.2e-4);
      double sum = 0.0;
      for (int corner = 0; corner < 4; ++corner) {
        const double si = corner & 1 ? 1.0 : -1.0, sj = corner & 2 ? 1.0 : -1.0;
        at[i] = z[i] + si * wide;
        at[j] = z[j] + sj * other;
        sum += si * sj * call();
      }
      at[i] = z[i];
      at[j] = z[j];
      hessian[i * n + j] = hessian[j * n + i] = sum / (4.0 * wide * other);
    }
  }
}

}  // namespace tiller
