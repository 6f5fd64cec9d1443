#pragma once

// Kernels of gradient planners for one model and one instruction set. Linearisation: the lanes are the points of the
// path, which are known beforehand, so the steps of a horizon run side by side. Rollouts with feedback: a step waits
// for the one before, so the lanes are the candidates of the line search, which then cost nothing.

#include "rollout/cone_lanes.hpp"
#include "rollout/dual_step.hpp"
#include "rollout/fading.hpp"
#include "rollout/output_cost.hpp"
#include "rollout/own_cost.hpp"
#include "rollout/path.hpp"
#include "rollout/slopes.hpp"
#include "rollout/step.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <template <class> class M, template <class> class Cost = NoCost>
struct GradientKernel {
  using Model = StaticModel<M>;
  using P = Pack<double>;
  using Slope = Slopes<Model>;
  static constexpr int kStates = Model::kStates, kInputs = Model::kInputs, kWidth = P::width;
  static constexpr int kDirections = kStates + kInputs;

  /// Lane l of the pack: rows[offset[l] + i].
  struct Gather {
    const double* lane[kWidth];
    TILLER_INLINE P operator()(int i) const {
      alignas(64) double all[kWidth];
#pragma GCC unroll 8
      for (int l = 0; l < kWidth; ++l) all[l] = lane[l][i];
      return P::load(all);
    }
  };

  /// The points of a path that one register works on: where each lane reads and writes.
  struct Points {
    std::uint32_t stage[kWidth], scenario[kWidth];
    std::size_t point[kWidth];
    Points(const PathJob& job, std::uint32_t first) {
      const std::uint32_t last = job.horizon * job.scenarios - 1;
      for (int l = 0; l < kWidth; ++l) {
        // lanes behind the last point repeat it
        const std::uint32_t at =
            first + static_cast<std::uint32_t>(l) < last ? first + static_cast<std::uint32_t>(l) : last;
        point[l] = at;
        stage[l] = job.scenarios == 1 ? at : at / job.scenarios;
        scenario[l] = job.scenarios == 1 ? 0 : at % job.scenarios;
      }
    }
  };

  // ---- without effects ---------------------------------------------------------------------------

  static void linearise_bare(const PathJob& job) {
    const double period_s = job.period_s > 0.0 ? job.period_s : job.setup->period_s;
    const std::uint32_t points = job.horizon * job.scenarios, n = job.lq_states;
    Slope slope(*job.setup, period_s);
    each(Model::np(), [&](auto i) { slope.p[i] = P(job.params[i]); });
    for (std::uint32_t first = 0; first < points; first += kWidth) {
      const Points at(job, first);
      Gather state, control;
      for (int l = 0; l < kWidth; ++l) {
        state.lane[l] = job.state + at.point[l] * kStates;
        control.lane[l] = job.control + std::size_t{at.stage[l]} * kInputs;
      }
      if (job.scenarios > 1) {
        Gather params;
        for (int l = 0; l < kWidth; ++l) params.lane[l] = job.params + std::size_t{at.scenario[l]} * job.param_count;
        each(Model::np(), [&](auto i) { slope.p[i] = params(i); });
      }
      typename Slope::State x;
      each(Model::nx(), [&](auto i) { x[i] = state(i); });
      each(Model::nu(), [&](auto i) { slope.u[i] = control(i); });
      alignas(64) double next[kStates][kWidth], a[kStates * kStates][kWidth], b[kStates * kInputs][kWidth];
      slope.advance(x, {next[0], a[0], b[0], kWidth});
      const int used = points - first < kWidth ? static_cast<int>(points - first) : kWidth;
      for (int l = 0; l < used; ++l) {
        for (int i = 0; i < kStates; ++i) job.next[at.point[l] * kStates + i] = next[i][l];
        if (slips<Model>(*job.setup))
          add_slips(*job.setup, period_s, job.params + std::size_t{at.scenario[l]} * job.param_count, at.stage[l],
                    job.next + at.point[l] * kStates);
        if (!job.a) continue;
        double *a_out = job.a + at.point[l] * n * n, *b_out = job.b + at.point[l] * n * kInputs;
        for (int i = 0; i < kStates; ++i) {
          for (int c = 0; c < kStates; ++c) a_out[i * n + c] = a[i * kStates + c][l];
          for (int c = 0; c < kInputs; ++c) b_out[i * kInputs + c] = b[i * kInputs + c][l];
        }
      }
    }
  }

  // ---- with effects ------------------------------------------------------------------------------

  /// Parameters of the points' scenarios, as constants.
  template <class S>
  static void load_params(const PathJob& job, const Points& at, Parameters<Model, S>& p) {
    const std::size_t count = job.param_count;
    Gather params;
    for (int l = 0; l < kWidth; ++l) params.lane[l] = job.params + at.scenario[l] * count;
    each(Model::np(), [&](auto i) { p.model[i] = S(params(i)); });
    for (std::size_t i = Model::kParams; i < count; ++i) p.effect[i - Model::kParams] = S(params(static_cast<int>(i)));
    if (job.setup->fading == 0) return;
    alignas(64) double stage[kWidth];
    for (int l = 0; l < kWidth; ++l) stage[l] = at.stage[l];
    const int rates = static_cast<int>(job.setup->fading_param + 2 * job.setup->fading);
    const Turn<P> turn = turn_after(params(rates), params(rates + 1), P::load(stage));
    fade(Model{}, *job.setup, Turn<S>{S(turn.along), S(turn.across)}, p);
  }

  /// Directions beyond (x, s, u) are not there; a pass takes kPass of them.
  static constexpr int kPass = Model::kKnowsSlopes ? kDirections : 4;
  using DualPass = DualStep<Model, kPass>;

  static void linearise_effects_pass(const PathJob& job, const Points& at, int used, int first_direction) {
    using D = typename DualPass::D;
    const StepSetup& setup = *job.setup;
    const int ns = static_cast<int>(setup.effect_state_count), nz = kStates + ns;
    const std::size_t n = job.lq_states;
    const Stepper<Model, D> stepper({}, setup, job.period_s > 0.0 ? job.period_s : setup.period_s);
    Trajectory<Model, D> t;
    Parameters<Model, D> p;
    typename Model::template Input<D> u;
    load_params<D>(job, at, p);
    Gather state, control;
    for (int l = 0; l < kWidth; ++l) {
      state.lane[l] = job.state + at.point[l] * static_cast<std::size_t>(nz);
      control.lane[l] = job.control + std::size_t{at.stage[l]} * kInputs;
    }
    const auto seeded = [&](const P& value, int direction) {
      return DualPass::seeded(value, direction, first_direction);
    };
    each(Model::looped_nx(), [&](auto i) { element(t.x, i) = seeded(state(i), i); });
    for (int s = 0; s < ns; ++s) t.effect_state[s] = seeded(state(kStates + s), kStates + s);
    each(Model::looped_nu(), [&](auto i) { element(u, i) = seeded(control(i), nz + i); });
    DualPass::advance(stepper, t, u, p, nullptr);

    const auto put = [&](int row, const D& value) {
      alignas(64) double lanes[kWidth];
      if (first_direction == 0) {
        value.v.store(lanes);
        for (int l = 0; l < used; ++l) job.next[at.point[l] * static_cast<std::size_t>(nz) + row] = lanes[l];
      }
      for (int i = 0; job.a && i < kPass; ++i) {
        const int direction = first_direction + i;
        if (direction >= nz + kInputs) break;
        value.d[i].store(lanes);
        for (int l = 0; l < used; ++l)
          if (direction < nz)
            job.a[(at.point[l] * n + row) * n + direction] = lanes[l];
          else
            job.b[(at.point[l] * n + row) * kInputs + direction - nz] = lanes[l];
      }
    };
    each(Model::looped_nx(), [&](auto i) { put(i, element(t.x, i)); });
    for (int s = 0; s < ns; ++s) put(kStates + s, t.effect_state[s]);
  }

  static void linearise_effects(const PathJob& job) {
    const std::uint32_t points = job.horizon * job.scenarios;
    const int directions = kStates + static_cast<int>(job.setup->effect_state_count) + kInputs;
    for (std::uint32_t first = 0; first < points; first += kWidth) {
      const Points at(job, first);
      const int used = points - first < kWidth ? static_cast<int>(points - first) : kWidth;
      for (int direction = 0; direction == 0 || (job.a && direction < directions); direction += kPass)
        linearise_effects_pass(job, at, used, direction);
    }
  }

  static void linearise(const tiller_model_t&, const PathJob& job) {
    if (job.setup->effect_count > 0) return linearise_effects(job);
    linearise_bare(job);
  }

  // ---- rollout with feedback ---------------------------------------------------------------------

  static constexpr int kScenarios = TILLER_MAX_SCENARIOS;
  using Input = typename Model::template Input<P>;

  /// The cost of a state with the terms that are not quadratic, the inputs' own left out; u is null at the end of the
  /// horizon.
  static __attribute__((noinline)) P every_cost(const FeedbackJob& job, std::size_t step,
                                                const typename Model::template State<P>& x, const Input* u,
                                                const typename Model::template Params<P>& p) {
    const CostTerms<double>& cost = *job.cost;
    const std::uint64_t row = job.task_step + step;
    P sum = u ? every_state_cost<Model, P>(Model{}, cost, cost.state, row, x)
              : every_terminal_cost<Model, P>(Model{}, cost, row, x);
    if constexpr (Model::kOutputs > 0) sum = sum + output_cost<Model, P>(Model{}, cost, !u, row, x, p);
    if (cost.has(kCostOwnTemplate) || cost.has(kCostOwnFunction))
      sum = sum + OwnCost<Model, Cost, P>::evaluate(cost, x, u, p, static_cast<double>(row) * job.setup->period_s);
    return sum;
  }

  /// One register of candidates over the horizon.
  template <bool kEffects, tiller_integrator_t kIntegrator>
  static void feedback_lanes(const Stepper<Model, P>& stepper, const FeedbackJob& job, std::uint32_t lane) {
    const StepSetup& setup = *job.setup;
    const int ns = kEffects ? static_cast<int>(setup.effect_state_count) : 0, nz = kStates + ns;
    const int count = static_cast<int>(job.scenarios), n = static_cast<int>(job.lq_states);
    const int param_rows = static_cast<int>(job.param_count);
    Trajectory<Model, P> t[kScenarios];
    Parameters<Model, P> p[kScenarios];
    P cost[kScenarios];
    [[maybe_unused]] Turn<P> kept[kScenarios];  // of forces that fade
    Input before;
    for (int j = 0; j < count; ++j) {
      each(Model::nx(), [&](auto i) { t[j].x[i] = P(job.start[j * nz + i]); });
      for (int s = 0; s < ns; ++s) t[j].effect_state[s] = P(job.start[j * nz + kStates + s]);
      each(Model::np(), [&](auto i) { p[j].model[i] = P(job.params[j * param_rows + i]); });
      for (int i = Model::kParams; kEffects && i < param_rows; ++i)
        p[j].effect[i - Model::kParams] = P(job.params[j * param_rows + i]);
      if (kEffects && setup.fading > 0) kept[j] = turn_after(Model{}, setup, p[j], P(1.0));
      cost[j] = P(0.0);
    }
    each(Model::nu(), [&](auto i) { before[i] = P(job.previous_input[i]); });
    const bool quadratic = job.cost->only_quadratic();
    const P alpha = P::load(job.alpha + lane), beta = P::load(job.beta + lane);
    const auto keep = [&](std::size_t k, int j) {
      double* out = job.state_out + (k * count + j) * nz * kCandidates + lane;
      each(Model::nx(), [&](auto i) { t[j].x[i].store(out + i * kCandidates); });
      for (int s = 0; s < ns; ++s) t[j].effect_state[s].store(out + (kStates + s) * kCandidates);
    };
    for (std::size_t k = 0; k < job.horizon; ++k) {
      Input u;
      each(Model::nu(), [&](auto i) {
        const std::size_t row = k * kInputs + i;
        P wish = P(job.control[row]) + alpha * P(job.step[row]);
        const double* gain = job.gain + row * count * n;
        P feedback = P(0.0);
        for (int j = 0; j < count; ++j) {
          const double *path = job.state + (k * count + j) * nz, *row_gain = gain + j * n;
          each(Model::nx(), [&](auto c) { feedback = feedback + P(row_gain[c]) * (t[j].x[c] - P(path[c])); });
          for (int s = 0; s < ns; ++s)
            feedback = feedback + P(row_gain[kStates + s]) * (t[j].effect_state[s] - P(path[kStates + s]));
          if (n == nz) continue;
          const double* last = k > 0 ? job.control + (k - 1) * kInputs : job.previous_input;
          each(Model::nu(), [&](auto c) { feedback = feedback + P(row_gain[nz + c]) * (before[c] - P(last[c])); });
        }
        wish = wish + beta * feedback;
        // in this order, so that a NaN comes through
        const P low = max(P(job.low[i]), before[i] - P(job.most_change[i]));
        const P high = min(P(job.high[i]), before[i] + P(job.most_change[i]));
        wish = select(wish < low, low, select(wish > high, high, wish));
        u[i] = wish;
      });
      if (job.cones) keep_within<Model, P>(*job.cones, before, job.most_change, u);
      each(Model::nu(), [&](auto i) { u[i].store(job.control_out + (k * kInputs + i) * kCandidates + lane); });
      const P inputs = input_cost<Model, P>(stepper.model, *job.cost, u, before);
      for (int j = 0; j < count; ++j) {
        keep(k, j);
        cost[j] = cost[j] + inputs;
        if (quadratic)
          cost[j] = cost[j] + state_cost<Model, P>(stepper.model, job.cost->target, job.cost->state, t[j].x);
        else
          cost[j] = cost[j] + every_cost(job, k, t[j].x, &u, p[j].model);
        if constexpr (kEffects) {
          stepper.advance(t[j], u, p[j]);
          if (setup.fading > 0) fade(Model{}, setup, kept[j], p[j]);
        } else {
          stepper.template advance_bare<kIntegrator>(t[j].x, u, p[j].model);
        }
      }
      before = u;
    }
    for (int j = 0; j < count; ++j) {
      keep(job.horizon, j);
      if (quadratic)
        cost[j] = cost[j] + state_cost<Model, P>(stepper.model, job.cost->target, job.cost->terminal, t[j].x);
      else
        cost[j] = cost[j] + every_cost(job, job.horizon, t[j].x, nullptr, p[j].model);
      cost[j].store(job.cost_out + j * kCandidates + lane);
    }
  }

  template <bool kEffects, tiller_integrator_t kIntegrator>
  static void feedback_all(const FeedbackJob& job) {
    const Stepper<Model, P> stepper({}, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
    for (std::uint32_t lane = 0; lane < kCandidates; lane += kWidth)
      feedback_lanes<kEffects, kIntegrator>(stepper, job, lane);
  }

  static void feedback(const tiller_model_t&, const FeedbackJob& job) {
    if (Model::kLongDynamics || job.setup->effect_count > 0 || slips<Model>(*job.setup))
      return feedback_all<true, tiller_integrator_rk4>(job);
    if constexpr (!Model::kLongDynamics) switch (job.setup->integrator) {
        case tiller_integrator_semi_implicit_euler:
          return feedback_all<false, tiller_integrator_semi_implicit_euler>(job);
        case tiller_integrator_midpoint: return feedback_all<false, tiller_integrator_midpoint>(job);
        default: return feedback_all<false, tiller_integrator_rk4>(job);
      }
  }
};

TILLER_ISA_NAMESPACE_END
