#pragma once

// QuadratiseJob in lanes: a lane is a step of the horizon.

#include "rollout/output_cost.hpp"
#include "rollout/own_cost.hpp"
#include "rollout/own_expansion.hpp"
#include "rollout/quadratise.hpp"
#include "rollout/rollout.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <class Model, template <class> class Cost>
struct Quadratiser {
  using P = Pack<double>;
  using State = typename Model::template State<P>;
  using Input = typename Model::template Input<P>;
  using Params = typename Model::template Params<P>;
  static constexpr int kX = Model::kStates, kU = Model::kInputs, kP = Model::kParams, kN = kX + kU;
  static constexpr std::uint32_t kWidth = static_cast<std::uint32_t>(P::width);
  static constexpr bool kOwn = !std::is_same<Cost<double>, NoCost<double>>::value;
  using E = Expansion<P, kX, kU>;

  /// Rows by lane: `spread` 1 where the lanes of a register are steps that follow each other, 0 where all are one step.
  struct Rows {
    std::uint64_t step;
    std::uint32_t spread;
    TILLER_INLINE P operator()(const double* table, std::uint32_t rows, int count, int index) const {
      double values[kWidth];
      for (std::uint32_t l = 0; l < kWidth; ++l)
        values[l] = table[cost_row(step + l * spread, rows) * static_cast<std::size_t>(count) +
                          static_cast<std::size_t>(index)];
      return P::load(values);
    }
    TILLER_INLINE P time(double period_s) const {
      double values[kWidth];
      for (std::uint32_t l = 0; l < kWidth; ++l) values[l] = static_cast<double>(step + l * spread) * period_s;
      return P::load(values);
    }
  };

  // ---- an own cost -------------------------------------------------------------------------------

  /// The template under nested duals, along (x, u) or along x alone.
  template <int kDirections>
  static __attribute__((noinline)) void add_template(const CostTerms<double>& cost, const State& x, const Input* u,
                                                     const Params& p, const P& time, E& e) {
    using Inner = Dual<P, kDirections>;
    using D = Dual<Inner, kDirections>;
    const auto seed = [](const P& value, int direction) {
      D z = D(Inner(value));
      z.v.d[direction] = P(1.0);
      z.d[direction].v = P(1.0);
      return z;
    };
    typename Model::template State<D> xs;
    typename Model::template Params<D> ps;
    each(Model::nx(), [&](auto i) { xs[i] = seed(x[i], i); });
    each(Model::np(), [&](auto i) { ps[i] = D(Inner(p[i])); });
    D result;
    if constexpr (kDirections == kN) {
      typename Model::template Input<D> us;
      each(Model::nu(), [&](auto i) { us[i] = seed((*u)[i], kX + i); });
      result = Cost<D>::stage(xs, us, ps, D(Inner(time)));
    } else {
      result = Cost<D>::terminal(xs, ps, D(Inner(time)));
    }
    P gradient[kDirections], hessian[kDirections * kDirections];
    for (int r = 0; r < kDirections; ++r) {
      gradient[r] = result.v.d[r];
      for (int c = 0; c < kDirections; ++c) hessian[r * kDirections + c] = result.d[r].d[c];
    }
    add_own<kDirections>(cost.own_weight, kX, kU, kDirections, result.v.v, gradient, hessian, e);
  }

  /// The function in C, lane by lane.
  static __attribute__((noinline)) void add_function(const CostTerms<double>& cost, const State& x, const Input* u,
                                                     const Params& p, const P& time, E& e) {
    const int n = u ? kN : kX;
    double rows[kN][kWidth] = {}, params[kP + 1][kWidth], times[kWidth];
    double values[kWidth], gradients[kN][kWidth], hessians[kN * kN][kWidth];
    each(Model::nx(), [&](auto i) { x[i].store(rows[i]); });
    if (u) each(Model::nu(), [&](auto i) { (*u)[i].store(rows[kX + i]); });
    each(Model::np(), [&](auto i) { p[i].store(params[i]); });
    time.store(times);
    for (std::uint32_t l = 0; l < kWidth; ++l) {
      double z[kN], own_params[kP + 1] = {}, gradient[kN], hessian[kN * kN];
      for (int i = 0; i < kN; ++i) z[i] = rows[i][l];
      for (int i = 0; i < kP; ++i) own_params[i] = params[i][l];
      difference_own(*cost.own, u != nullptr, kX, n, z, own_params, times[l], values[l], gradient, hessian);
      for (int i = 0; i < n; ++i) gradients[i][l] = gradient[i];
      for (int i = 0; i < n * n; ++i) hessians[i][l] = hessian[i];
    }
    P gradient[kN], hessian[kN * kN];
    for (int i = 0; i < n; ++i) gradient[i] = P::load(gradients[i]);
    for (int i = 0; i < n * n; ++i) hessian[i] = P::load(hessians[i]);
    add_own<kN>(cost.own_weight, kX, kU, n, P::load(values), gradient, hessian, e);
  }

  static TILLER_INLINE void add_own_cost(const QuadratiseJob& job, const Rows& rows, const State& x, const Input* u,
                                         std::uint32_t lane, E& e) {
    const CostTerms<double>& cost = *job.cost;
    if (!cost.has(kCostOwnFunction) && !(kOwn && cost.has(kCostOwnTemplate))) return;
    Params p;
    each(Model::np(), [&](auto i) { p[i] = load(job.params, i, lane, rows.spread); });
    const P time = rows.time(job.setup->period_s);
    if (cost.has(kCostOwnFunction)) {
      add_function(cost, x, u, p, time, e);
    } else if constexpr (kOwn) {
      if (u)
        add_template<kN>(cost, x, u, p, time, e);
      else
        add_template<kX>(cost, x, u, p, time, e);
    }
  }

  /// Out of line, as an own cost: a pose's derivatives are long.
  static __attribute__((noinline)) void add_outputs(const QuadratiseJob& job, const Rows& rows, const State& x,
                                                    bool terminal, std::uint32_t lane, E& e) {
    Params p;
    each(Model::np(), [&](auto i) { p[i] = load(job.params, i, lane, rows.spread); });
    expand_outputs<Model, P>(*job.cost, terminal, rows, x, p, e);
  }

  // ---- steps and the end -------------------------------------------------------------------------

  static TILLER_INLINE P load(const Lanes<double>& rows, int row, std::uint32_t lane, std::uint32_t spread) {
    if (rows.splat()) return P(rows.data[row]);
    const double* at = rows.data + static_cast<std::size_t>(row) * rows.stride + lane;
    return spread ? P::load(at) : P(*at);
  }
  static TILLER_INLINE void store(double* rows, int row, const QuadratiseJob& job, std::uint32_t lane,
                                  std::uint32_t spread, const P& value) {
    double* at = rows + static_cast<std::size_t>(row) * job.lanes + lane;
    if (spread)
      value.store(at);
    else
      *at = value.lane(0);
  }

  static TILLER_INLINE void store_all(const QuadratiseJob& job, std::uint32_t lane, std::uint32_t spread, const E& e) {
    if (job.value) store(job.value, 0, job, lane, spread, e.value);
    const auto all = [&](double* rows, const P* values, int count) {
      if (rows)
        for (int i = 0; i < count; ++i) store(rows, i, job, lane, spread, values[i]);
    };
    all(job.lx, e.lx, kX);
    all(job.lu, e.lu, kU);
    all(job.lb, e.lb, kU);
    all(job.lxx, e.lxx, kX * kX);
    all(job.luu, e.luu, kU * kU);
    all(job.lux, e.lux, kU * kX);
  }

  /// The steps of one register (spread 1), or the terminal state in every lane (spread 0).
  template <bool kExtra, bool kTerminal>
  static TILLER_INLINE void expand(const QuadratiseJob& job, std::uint32_t lane) {
    constexpr std::uint32_t kSpread = kTerminal ? 0 : 1;
    const CostTerms<double>& cost = *job.cost;
    const Rows rows{job.task_step + lane, kSpread};
    State x;
    Input u, before;
    each(Model::nx(), [&](auto i) { x[i] = load(job.state, i, lane, kSpread); });
    E e;
    e.clear(kX, kU);
    if constexpr (kExtra || Model::kMayTurn) {
      expand_states<kX, Model, P>(Model{}, cost, kTerminal ? cost.terminal : cost.state, rows, x, e);
    } else {
      const double* weight = kTerminal ? cost.terminal : cost.state;
      each(Model::nx(), [&](auto i) {
        const P d = wrapped_difference<Model, P>(Model{}, i, x[i], P(cost.target[i]));
        const P slope = P(2.0 * weight[i]);
        e.value = e.value + P(weight[i]) * d * d;
        e.lx[i] = slope * d;
        e.lxx[i * kX + i] = slope;
      });
    }
    if constexpr (!kTerminal) {
      each(Model::nu(), [&](auto i) {
        u[i] = load(job.control, i, lane, kSpread);
        before[i] = load(job.before, i, lane, kSpread);
      });
      expand_inputs<Model, P>(Model{}, cost, u, before, e);
    }
    if constexpr (kExtra && Model::kOutputs > 0)
      if (cost.has(kCostOutputs) || cost.has(kCostOutputBounds)) add_outputs(job, rows, x, kTerminal, lane, e);
    if constexpr (kExtra) add_own_cost(job, rows, x, kTerminal ? nullptr : &u, lane, e);
    store_all(job, lane, kSpread, e);
  }

  template <bool kExtra>
  static void expand_all(const QuadratiseJob& job) {
    for (std::uint32_t lane = 0; lane < job.stages; lane += kWidth) expand<kExtra, false>(job, lane);
    if (job.terminal) expand<kExtra, true>(job, job.stages);
  }
  static void quadratise(const tiller_model_t&, const QuadratiseJob& job) {
    if (job.cost->only_quadratic())
      expand_all<false>(job);
    else
      expand_all<true>(job);
  }
};

TILLER_ISA_NAMESPACE_END
