#pragma once

// The rollout kernel of one model for the instruction set that this source is compiled for. Several registers of
// trajectories are in flight: their steps do not depend on each other, which hides the latency of the arithmetic
// (with one register a step waits for itself most of the time).

#include "rollout/cone_lanes.hpp"
#include "rollout/dual_step.hpp"
#include "rollout/fading.hpp"
#include "rollout/gradient_kernel.hpp"
#include "rollout/lane_rows.hpp"
#include "rollout/lq_scenarios.hpp"
#include "rollout/lq_sweep.hpp"
#include "rollout/model_table.hpp"
#include "rollout/output_cost.hpp"
#include "rollout/own_cost.hpp"
#include "rollout/quadratise_lanes.hpp"
#include "rollout/residual_kernel.hpp"
#include "rollout/slopes.hpp"
#include "rollout/step.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// Cost is a cost of one's own beside the model: see docs/reference/costs.md.
template <template <class> class M, template <class> class Cost = NoCost>
struct Kernel {
  using Model = StaticModel<M>;
  static constexpr int kStates = Model::kStates, kInputs = Model::kInputs;

  /// Every term; out of line, so that the loops of a quadratic cost keep their registers to themselves.
  template <class P, class T>
  static __attribute__((noinline)) P every_cost(const RolloutJob<T>& job, std::uint32_t step,
                                                const typename Model::template State<P>& x,
                                                const typename Model::template Input<P>* u,
                                                const typename Model::template Input<P>& before,
                                                const typename Model::template Params<P>& p) {
    const CostTerms<T>& cost = *job.cost;
    const std::uint64_t row = job.task_step + step;
    P sum = u ? every_state_cost<Model, P>(Model{}, cost, cost.state, row, x) +
                    input_cost<Model, P>(Model{}, cost, *u, before)
              : every_terminal_cost<Model, P>(Model{}, cost, row, x);
    if constexpr (Model::kOutputs > 0) sum = sum + output_cost<Model, P>(Model{}, cost, !u, row, x, p);
    if (cost.has(kCostOwnTemplate) || cost.has(kCostOwnFunction))
      sum = sum + OwnCost<Model, Cost, P>::evaluate(cost, x, u, p, static_cast<double>(row) * job.setup->period_s);
    return sum;
  }

  /// As every_cost, out of line.
  template <class P, class T>
  static __attribute__((noinline)) P state_penalty(const RolloutJob<T>& job,
                                                   const typename Model::template State<P>& x) {
    return penalty_cost<Model, P>(Model{}, *job.cost, x);
  }
  template <class P, class T>
  static TILLER_INLINE P penalty(const RolloutJob<T>& job, const typename Model::template State<P>& x,
                                 [[maybe_unused]] const typename Model::template Params<P>& p) {
    if constexpr (Model::kOutputs > 0)
      return state_penalty<P>(job, x) + output_penalty<Model, P>(Model{}, *job.cost, x, p);
    else
      return state_penalty<P>(job, x);
  }

  /// The input of a closed loop: see RolloutFeedback. As every_cost, out of line.
  template <class P, class T>
  static __attribute__((noinline)) void feed_back(const RolloutJob<T>& job, std::uint32_t step, std::uint32_t lane,
                                                  const typename Model::template State<P>& x,
                                                  const typename Model::template Input<P>& before,
                                                  typename Model::template Input<P>& u) {
    const RolloutFeedback<T>& loop = *job.feedback;
    typename Model::template State<P> d;
    typename Model::template Input<P> last;
    load_fields<P, P>(d, Model::nx(), loop.reference, static_cast<int>(step) * kStates, lane);
    each(Model::nx(), [&](auto c) { d[c] = x[c] - d[c]; });
    const bool rate = loop.columns > static_cast<std::uint32_t>(kStates);
    if (rate) {
      load_fields<P, P>(last, Model::nu(), job.controls, (static_cast<int>(step) - 1) * kInputs, lane);
      each(Model::nu(), [&](auto c) { last[c] = before[c] - last[c]; });
    }
    each(Model::nu(), [&](auto i) {
      const T* row = loop.gain + (static_cast<std::size_t>(step) * kInputs + i) * loop.columns;
      P wish = u[i];
      each(Model::nx(), [&](auto c) { wish = wish + P(row[c]) * d[c]; });
      if (rate) each(Model::nu(), [&](auto c) { wish = wish + P(row[kStates + c]) * last[c]; });
      // in this order, so that a NaN comes through
      const P low = max(P(loop.low[i]), before[i] - P(loop.most_change[i]));
      const P high = min(P(loop.high[i]), before[i] + P(loop.most_change[i]));
      u[i] = select(wish < low, low, select(wish > high, high, wish));
    });
    if (loop.cones) keep_within<Model, P>(*loop.cones, before, loop.most_change, u);
  }

  template <class P, class T>
  static __attribute__((noinline)) void add_noise(const RolloutJob<T>& job, std::uint32_t step, std::uint32_t lane,
                                                  typename Model::template State<P>& x) {
    each(Model::nx(),
         [&](auto i) { x[i] = x[i] + load_row<P>(job.noise, static_cast<int>(step) * kStates + i, lane); });
  }

  template <class T>
  static TILLER_INLINE void store_state(T* rows, std::size_t stride, std::uint32_t lane,
                                        const typename Model::template State<Pack<T>>& x) {
    each(Model::nx(), [&](auto i) { x[i].store(rows + static_cast<std::size_t>(i) * stride + lane); });
  }

  /// The whole horizon of kRegisters registers beginning at `lane`.
  /// kExtra: the cost may have more than its quadratic terms. registers: how many of them there are; with effects all.
  template <class T, int kRegisters, bool kEffects, bool kSplat, bool kExtra, tiller_integrator_t kIntegrator>
  static void roll(const Stepper<Model, Pack<T>>& stepper, const RolloutJob<T>& job, std::uint32_t lane,
                   std::uint32_t registers) {
    using P = Pack<T>;
    using Input = typename Model::template Input<P>;
    const StepSetup& setup = *job.setup;
    const int count = kEffects || registers > kRegisters ? kRegisters : static_cast<int>(registers);
    Trajectory<Model, P> t[kRegisters];
    constexpr int kParameterSets = kSplat ? 1 : kRegisters;  // NOLINT(bugprone-branch-clone): equal for one register
    Parameters<Model, P> p[kParameterSets];
    Input before[kRegisters], commands[kRegisters];
    P cost[kRegisters], penalties[kRegisters];
    [[maybe_unused]] Turn<P> kept[kParameterSets];  // of forces that fade
    for (int r = 0; r < count; ++r) {
      const std::uint32_t at = lane + static_cast<std::uint32_t>(r * P::width);
      load_fields<P, P>(t[r].x, Model::nx(), job.state, 0, at);
      if (!kSplat || r == 0) {
        if constexpr (kEffects)
          load_parameters<Model, P, P>(p[r], setup, job.params, at);
        else
          load_fields<P, P>(p[r].model, Model::np(), job.params, 0, at);
      }
      if constexpr (kEffects)
        for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
          t[r].effect_state[s] = load_row<P>(job.effect_state, static_cast<int>(s), at);
      if (job.previous_input)
        each(Model::nu(), [&](auto i) { before[r][i] = P(job.previous_input[i]); });
      else
        load_fields<P, P>(before[r], Model::nu(), job.controls, 0, at);
      cost[r] = penalties[r] = P(0.0);
    }
    typename Stepper<Model, P>::template Plan<kRegisters, kParameterSets> plan;
    if constexpr (kEffects) {
      stepper.plan_bodies(plan, p);
      stepper.plan_steps(plan, p, true);
      for (int r = 0; setup.fading > 0 && r < kParameterSets; ++r) kept[r] = turn_after(Model{}, setup, p[r], P(1.0));
    }
    for (std::uint32_t step = 0; step < job.horizon; ++step) {
      for (int r = 0; r < count; ++r) {
        const std::uint32_t at = lane + static_cast<std::uint32_t>(r * P::width);
        const auto& params = p[kSplat ? 0 : r];
        if (job.trajectory)
          store_state<T>(job.trajectory + static_cast<std::size_t>(step) * kStates * job.lanes, job.lanes, at, t[r].x);
        Input u;
        load_fields<P, P>(u, Model::nu(), job.controls, static_cast<int>(step) * kInputs, at);
        if (kExtra && job.feedback && step >= job.feedback->from) feed_back<P>(job, step, at, t[r].x, before[r], u);
        if (job.cost) {
          if (kExtra && !job.cost->only_quadratic())
            cost[r] = cost[r] + every_cost<P>(job, step, t[r].x, &u, before[r], params.model);
          else
            cost[r] = cost[r] + state_cost<Model, P>(stepper.model, job.cost->target, job.cost->state, t[r].x) +
                      input_cost<Model, P>(stepper.model, *job.cost, u, before[r]);
          if (kExtra && job.penalty_out) penalties[r] = penalties[r] + penalty<P>(job, t[r].x, params.model);
          before[r] = u;
        }
        commands[r] = u;
      }
      if constexpr (!kEffects) {
        stepper.template advance_bare<kIntegrator, kRegisters>(t, commands, p[0].model, count);
      } else {
        const auto past = [&](int r, int age, int input) {
          const int then = static_cast<int>(step) - age;
          return then >= 0 ? load_row<P>(job.controls, then * kInputs + input,
                                         lane + static_cast<std::uint32_t>(r * P::width))
                           : P(job.history[(-then - 1) * kInputs + input]);
        };
        stepper.advance_all(t, commands, p, plan, past);
        for (int r = 0; setup.fading > 0 && r < kParameterSets; ++r) fade(Model{}, setup, kept[r], p[r]);
      }
      if (kExtra && job.noise.data)
        for (int r = 0; r < count; ++r)
          add_noise<P>(job, step, lane + static_cast<std::uint32_t>(r * P::width), t[r].x);
    }
    for (int r = 0; r < count; ++r) {
      const std::uint32_t at = lane + static_cast<std::uint32_t>(r * P::width);
      if (job.cost && job.cost_out) {
        const P last = kExtra && !job.cost->only_quadratic()
                           ? every_cost<P>(job, job.horizon, t[r].x, nullptr, before[r], p[kSplat ? 0 : r].model)
                           : state_cost<Model, P>(stepper.model, job.cost->target, job.cost->terminal, t[r].x);
        (cost[r] + last).store(job.cost_out + at);
        if (kExtra && job.penalty_out)
          (penalties[r] + penalty<P>(job, t[r].x, p[kSplat ? 0 : r].model)).store(job.penalty_out + at);
      }
      if (job.trajectory)
        store_state<T>(job.trajectory + static_cast<std::size_t>(job.horizon) * kStates * job.lanes, job.lanes, at,
                       t[r].x);
      if (job.final_state) store_state<T>(job.final_state, job.lanes, at, t[r].x);
      if (kEffects && job.final_effect_state)
        for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
          t[r].effect_state[s].store(job.final_effect_state + static_cast<std::size_t>(s) * job.lanes + at);
    }
  }

  template <class T, int kRegisters, bool kEffects, bool kSplat, bool kExtra, tiller_integrator_t kIntegrator>
  static void roll_all(const RolloutJob<T>& job) {
    const Stepper<Model, Pack<T>> stepper({}, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
    constexpr std::uint32_t kWidth = static_cast<std::uint32_t>(Pack<T>::width), kBlock = kRegisters * kWidth;
    constexpr bool kSingles = kEffects && kLanePadding % kBlock != 0;  // behind the last whole block
    std::uint32_t lane = 0;
    for (; kSingles ? lane + kBlock <= job.lanes : lane < job.lanes; lane += kBlock)
      roll<T, kRegisters, kEffects, kSplat, kExtra, kIntegrator>(stepper, job, lane,
                                                                 (job.lanes - lane + kWidth - 1) / kWidth);
    if constexpr (kSingles)
      for (; lane < job.lanes; lane += kWidth) roll<T, 1, kEffects, false, kExtra, kIntegrator>(stepper, job, lane, 1);
  }

  template <bool kExtra>
  static void roll_bare(const RolloutJob<float>& job) {
    switch (job.setup->integrator) {
      case tiller_integrator_semi_implicit_euler:
        return roll_all<float, 4, false, true, kExtra, tiller_integrator_semi_implicit_euler>(job);
      case tiller_integrator_midpoint: return roll_all<float, 4, false, true, kExtra, tiller_integrator_midpoint>(job);
      default: return roll_all<float, 4, false, true, kExtra, tiller_integrator_rk4>(job);
    }
  }
  /// Registers that go side by side, so that one does not wait for the other. Long equations have enough to do with
  /// one.
  static constexpr int kTogether_f32 = Model::kLongDynamics ? 1 : 4, kTogether_f64 = Model::kLongDynamics ? 1 : 2;
  /// Planning without effects is the path worth a copy per integrator, where it is more than the equations' calls;
  /// everything else shares one.
  static void rollout_f32(const tiller_model_t&, const RolloutJob<float>& job) {
    if (!job.params.splat()) return roll_all<float, kTogether_f32, true, false, true, tiller_integrator_rk4>(job);
    if (Model::kLongDynamics || job.setup->effect_count > 0 || slips<Model>(*job.setup))
      return roll_all<float, kTogether_f32, true, (kTogether_f32 > 1), true, tiller_integrator_rk4>(job);
    if constexpr (!Model::kLongDynamics) {
      const bool extra =
          job.feedback || job.noise.data || (job.cost && (!job.cost->only_quadratic() || job.penalty_out));
      return extra ? roll_bare<true>(job) : roll_bare<false>(job);
    }
  }
  static void rollout_f64(const tiller_model_t&, const RolloutJob<double>& job) {
    roll_all<double, kTogether_f64, true, false, true, tiller_integrator_rk4>(job);
  }

  // ---- linearisation -----------------------------------------------------------------------------

  /// Derivatives along the directions from `first` on, states before inputs. The first pass writes the next state.
  static void linearise_pass(const LineariseJob& job, std::uint32_t lane, int first) {
    using Dual = DualStep<Model, kStatePass<Model>>;
    using P = typename Dual::P;
    using D = typename Dual::D;
    const StepSetup& setup = *job.setup;
    const Stepper<Model, D> stepper({}, setup, job.period_s > 0.0 ? job.period_s : setup.period_s);
    Trajectory<Model, D> t;
    Parameters<Model, D> p;
    typename Model::template Input<D> u;
    each(Model::looped_nx(),
         [&](auto i) { element(t.x, i) = Dual::seeded(load_row<P>(job.state, i, lane), i, first); });
    each(Model::looped_nu(),
         [&](auto i) { element(u, i) = Dual::seeded(load_row<P>(job.control, i, lane), kStates + i, first); });
    load_parameters<Model, D, P>(p, setup, job.params, lane);
    for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
      t.effect_state[s] = D(load_row<P>(job.effect_state, static_cast<int>(s), lane));
    Dual::advance(stepper, t, u, p, job.history);

    const auto row = [&](double* rows, int i) { return rows + static_cast<std::size_t>(i) * job.lanes + lane; };
    each(Model::looped_nx(), [&](auto i) {
      const D& x = element(t.x, i);
      if (first == 0) x.v.store(row(job.next_state, i));
      each_direction<D::directions>([&](int k) {
        const int c = first + k;
        if (c < kStates && job.a)
          x.d[k].store(row(job.a, i * kStates + c));
        else if (c >= kStates && c < kStates + kInputs && job.b)
          x.d[k].store(row(job.b, i * kInputs + c - kStates));
      });
    });
    if (first == 0 && job.next_effect_state)
      for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
        t.effect_state[s].v.store(row(job.next_effect_state, static_cast<int>(s)));
  }
  static void linearise_bare(const LineariseJob& job) {
    using Slope = Slopes<Model>;
    using P = typename Slope::P;
    Slope slope(*job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
    for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
      typename Slope::State x;
      load_fields<P, P>(x, Model::nx(), job.state, 0, lane);
      load_fields<P, P>(slope.u, Model::nu(), job.control, 0, lane);
      load_fields<P, P>(slope.p, Model::np(), job.params, 0, lane);
      slope.advance(x,
                    {job.next_state + lane, job.a ? job.a + lane : nullptr, job.b ? job.b + lane : nullptr, job.lanes});
    }
    if (slips<Model>(*job.setup)) add_slips(job);
  }
  static void linearise(const tiller_model_t&, const LineariseJob& job) {
    if (job.setup->effect_count == 0) return linearise_bare(job);
    constexpr int kPass = kStatePass<Model>;
    const int directions = job.b ? kStates + kInputs : job.a ? kStates : 1;
    // the first pass last: what it writes may be what the others read
    for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(Pack<double>::width))
      for (int first = (directions - 1) / kPass * kPass; first >= 0; first -= kPass) linearise_pass(job, lane, first);
  }

  /// Of more states the library's own sweeps take over (select_lq): loops, unrolled for the sizes that it names.
  static constexpr int kMostSwept = 8;
  template <class Sweep, int kSize>
  static constexpr const LqKernel* swept() {
    if constexpr (kSize <= kMostSwept)
      return &kKernelOf<Sweep>;
    else
      return nullptr;
  }
  template <class Sweep>
  static constexpr LqKernel kKernelOf = Sweep::kernel();

  static constexpr auto kFeedback = &GradientKernel<M, Cost>::feedback;
  /// tiller_model_t::jacobian. A model that knows its slopes has them in lanes already: one of them will do.
  static void jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                       double* a, double* b) {
    if constexpr (Model::kKnowsSlopes) {
      using P = Pack<double>;
      using Lanes = ModelTable<M>;
      typename Model::template State<P> xs;
      typename Model::template Input<P> us;
      typename Model::template Force<P> fs;
      typename Model::template Params<P> ps;
      Lanes::template read<P>(x, u, f, p, xs, us, fs, ps);
      Slopes<Model>::store_rates(xs, us, fs, Body<P>::from(*body), ps, a, b);
    } else {
      ModelTable<M>::jacobian(x, u, f, body, p, a, b);
    }
  }
  /// The derivatives, which are half of a kernel's text: in this unit, or in another one (export_model.hpp).
  struct Derivatives {
    static constexpr auto linearise = &Kernel::linearise;
    static constexpr auto path_linearise = &GradientKernel<M, Cost>::linearise;
    static constexpr auto feedback = kFeedback;
    static constexpr auto quadratise = &Quadratiser<Model, Cost>::quadratise;
    static constexpr auto jacobian = &Kernel::jacobian;
  };
  template <class Derived>
  static constexpr PathKernel kPath = {Derived::path_linearise, Derived::feedback};

  template <class Derived = Derivatives>
  static constexpr RolloutTable table(Isa isa) {
    RolloutTable t;
    t.isa = isa;
    t.width_f32 = Pack<float>::width;
    t.width_f64 = Pack<double>::width;
    t.rollout_f32 = &rollout_f32;
    t.rollout_f64 = &rollout_f64;
    t.linearise = Derived::linearise;
    t.residual = &ResidualKernel<M>::residual;
    t.path = &kPath<Derived>;
    t.lq = swept<lq::Sweep<kStates, kInputs>, kStates>();
    t.lq_rate = swept<lq::Sweep<kStates + kInputs, kInputs>, kStates + kInputs>();
    t.lq_scenarios = swept<lq::ScenarioSweep<kStates, kInputs>, kStates>();
    t.quadratise = Derived::quadratise;
    t.own_cost = OwnCost<Model, Cost, double>::kTemplate;
    return t;
  }
};

TILLER_ISA_NAMESPACE_END
