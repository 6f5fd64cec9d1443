#pragma once

// One-step residuals of one model for the instruction set that this source is compiled for. A block of up to 64 steps
// is laid out once, with what depends on the measured states alone (recorded with a step in each lane); then each
// register of lanes goes through the block with its parameters and its sums in registers.

#include "rollout/lane_rows.hpp"
#include "rollout/moving_step.hpp"
#include "rollout/residual.hpp"
#include "scalar/shared_start.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// The model as the residuals' stepper sees it: says what each argument depends on, where the stepper's run-time
/// choices would hide it from the compiler.
template <template <class> class M>
struct SharedStartModel : StaticModel<M> {
  using Base = StaticModel<M>;
  using P = Pack<float>;

  template <class S>
  static TILLER_INLINE typename Base::template State<S> dynamics(const typename Base::template State<S>& x,
                                                                 typename Base::template Input<S> u,
                                                                 typename Base::template Force<S> f,
                                                                 const Body<S>& body,
                                                                 typename Base::template Params<S> p) {
    each(Base::nu(), [&](auto i) { u[i] = S(u[i].v); });
    each(Base::nf(), [&](auto i) { f[i] = S(f[i].v); });
    each(Base::np(), [&](auto i) { p[i] = S(p[i].v); });
    // of the lane's own: a tilt or a payload may be; called as directly as it can be, or GCC inlines less of it
    if constexpr (Base::kForces > 0 && Base::kParams > 0)
      return M<S>::dynamics(
          x, u, f, {S(body.gravity_x_m_s2.v), S(body.gravity_z_m_s2.v), S(body.payload_kg.v), S(body.payload_kgm2.v)},
          p);
    else
      return Base::template dynamics<S>(
          x, u, f, {S(body.gravity_x_m_s2.v), S(body.gravity_z_m_s2.v), S(body.payload_kg.v), S(body.payload_kgm2.v)},
          p);
  }
};

template <template <class> class M>
struct ResidualKernel {
  using Model = SharedStartModel<M>;
  using P = Pack<float>;
  using S = SharedStart;
  using Step = Stepper<Model, S, S>;
  using State = typename Model::template State<S>;
  using Input = typename Model::template Input<S>;
  static constexpr int kStates = Model::kStates, kInputs = Model::kInputs, kSteps = static_cast<int>(kResidualBlock);
  static constexpr int kBasis = static_cast<int>(kMaxBasis);
  static_assert(kSteps % P::width == 0, "whole registers of steps");

  /// Steps in single precision, a row for each number. Angles lie within +-pi, whatever turns were counted.
  struct Block {
    std::uint32_t first = 0;
    int count = 0;
    alignas(64) float state[kStates][kSteps + P::width];
    alignas(64) float change[kStates][kSteps];  // 0 where missing
    alignas(64) float weight[kStates][kSteps];  // 0 where missing
    alignas(64) float input[kInputs][kSteps];
    alignas(64) float basis[kBasis][kSteps];
    alignas(64) float tape[Tape::kRows][kSteps];
    alignas(64) float substep_s[kSteps + P::width];
  };

  static TILLER_INLINE double wrap(double angle) {
    constexpr double kTurn = 6.28318530717958647693;
    return angle > -3.2 && angle < 3.2 ? angle : angle - kTurn * __builtin_floor(angle / kTurn + 0.5);
  }

  static void lay_out(const ResidualJob& job, std::uint32_t first, Block& b) {
    const StepSetup& setup = *job.setup;
    const std::uint32_t left = job.count - first;
    b.first = first;
    b.count = static_cast<int>(left < kResidualBlock ? left : kResidualBlock);
    const double share = 1.0 / setup.substeps;
    for (int k = 0; k < b.count; ++k) {
      const MeasuredStep& s = job.steps[first + static_cast<std::uint32_t>(k)];
      each(Model::nx(), [&](auto i) {
        const bool missing = __builtin_isnan(s.change[i]);
        b.state[i][k] = static_cast<float>(Model::is_angle(i) ? wrap(s.state[i]) : s.state[i]);
        b.change[i][k] = missing ? 0.0f : static_cast<float>(s.change[i]);
        b.weight[i][k] = missing ? 0.0f : static_cast<float>(s.weight);
      });
      each(Model::nu(), [&](auto i) { b.input[i][k] = static_cast<float>(s.input[i]); });
      b.substep_s[k] = static_cast<float>((s.period_s > 0.0 ? s.period_s : setup.period_s) * share);
      if (job.basis_count == 0) continue;
      for (std::uint32_t j = 0; j < kMaxBasis; ++j)
        b.basis[j][k] = j < job.basis_count ? static_cast<float>(s.basis[j]) : 0.0f;
    }
    // the recording works on whole registers: the last step is repeated
    const int last = b.count - 1;
    each(Model::nx(), [&](auto i) { P(b.state[i][last]).store(&b.state[i][b.count]); });
    P(b.substep_s[last]).store(&b.substep_s[b.count]);
  }

  /// Runs the first free step of every step of the block with nothing but the shared state: what is left of it once the
  /// compiler has dropped what nobody reads are the functions that the tape keeps.
  template <tiller_integrator_t kIntegrator>
  static __attribute__((flatten, noinline)) void record(const StepSetup& setup, Block& b) {
    Step step({}, setup, S(setup.period_s));
    typename Model::template Params<S> p;
    Input u;
    each(Model::np(), [&](auto i) { p[i] = S(P(1.0)); });
    each(Model::nu(), [&](auto i) { u[i] = S(P(0.0)); });
    for (int k = 0; k < b.count; k += P::width) {
      Tape tape{&b.tape[0][k], kSteps, true};
      State x;
      each(Model::nx(), [&](auto i) { x[i] = S::of_state(P::load(&b.state[i][k]), &tape); });
      step.substep_s = S(P::load(&b.substep_s[k]), S::kConstant);
      step.free_step(kIntegrator, x, u, step.no_force(), p);
    }
  }

  /// Step k of the block in all lanes of a register: how far each state moves. Without effects and with one substep.
  template <tiller_integrator_t kIntegrator>
  static TILLER_INLINE void advance_bare(const Step& step, const Block& b, int k,
                                         const typename Model::template Params<S>& p, P* moved) {
    Tape tape{const_cast<float*>(&b.tape[0][k]), kSteps, false};
    State x;
    Input u;
    each(Model::nx(), [&](auto i) { x[i] = S::of_state(P(b.state[i][k]), &tape); });
    each(Model::nu(), [&](auto i) { u[i] = S(P(b.input[i][k])); });
    x = step.free_step(kIntegrator, x, u, step.no_force(), p);
    each(Model::nx(), [&](auto i) { moved[i] = x[i].moved(P(b.state[i][k])); });
  }
  /// rows[0 ..] += sums, in double.
  static TILLER_INLINE void add(double* rows, const P& sums) {
    alignas(64) float all[P::width];
    sums.store(all);
#pragma GCC ivdep
#pragma GCC unroll 1
    for (int l = 0; l < P::width; ++l) rows[l] += static_cast<double>(all[l]);
  }

  /// The sums of a register of lanes over the block.
  struct Sums {
    P squared[kStates], projected[kStates][kBasis];
    unsigned basis_rows;
    float* residual;  // of the block's first step

    TILLER_INLINE Sums(const ResidualJob& job, const Block& b)
        : basis_rows(job.projected ? job.basis_rows : 0u),
          residual(job.residual ? job.residual + std::size_t{b.first} * kStates * job.lanes : nullptr) {
      each(Model::nx(), [&](auto i) { squared[i] = P(0.0); });
      if (basis_rows)
        for (auto& row : projected)
          for (P& cell : row) cell = P(0.0);
    }
    TILLER_INLINE void take(const ResidualJob& job, const Block& b, int k, const P* moved, std::uint32_t lane) {
      P e[kStates], weighted[kStates];
      each(Model::nx(), [&](auto i) {
        e[i] = P(b.change[i][k]) - moved[i];
        weighted[i] = e[i] * P(b.weight[i][k]);
        squared[i] = squared[i] + weighted[i] * e[i];
      });
      if (residual)
        each(Model::nx(),
             [&](auto i) { e[i].store(residual + (static_cast<std::size_t>(k) * kStates + i) * job.lanes + lane); });
      if (basis_rows)
        each(Model::nx(), [&](auto i) {
          if ((basis_rows >> i) & 1u)
            for (int j = 0; j < kBasis; ++j) projected[i][j] = projected[i][j] + weighted[i] * P(b.basis[j][k]);
        });
    }
    TILLER_INLINE void put(const ResidualJob& job, std::uint32_t lane) const {
      if (job.squared) each(Model::nx(), [&](auto i) { add(job.squared + i * job.lanes + lane, squared[i]); });
      for (std::uint32_t i = 0; basis_rows >> i; ++i)
        for (std::uint32_t j = 0; ((basis_rows >> i) & 1u) && j < job.basis_count; ++j)
          add(job.projected + (i * job.basis_count + j) * job.lanes + lane, projected[i][j]);
    }
  };

  template <tiller_integrator_t kIntegrator>
  static __attribute__((flatten, noinline)) void sum_bare(const ResidualJob& job, const Block& b) {
    Step step({}, *job.setup, S(job.setup->period_s));
    for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
      typename Model::template Params<S> p;
      load_fields<S, P>(p, Model::np(), job.params, 0, lane);
      Sums sums(job, b);
      P moved[kStates];
      for (int k = 0; k < b.count; ++k) {
        step.substep_s = S(P(b.substep_s[k]), S::kConstant);
        advance_bare<kIntegrator>(step, b, k, p, moved);
        sums.take(job, b, k, moved, lane);
      }
      sums.put(job, lane);
    }
  }

  static __attribute__((noinline)) void sum(const ResidualJob& job, const Block& b) {
    using Moving = MovingStep<M>;
    typename Moving::Step step({}, *job.setup, P(job.setup->period_s));
    for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
      Parameters<typename Moving::Model, P> p;
      load_parameters<typename Moving::Model, P, P>(p, *job.setup, job.params, lane);
      typename Moving::Plan plan;
      step.plan_bodies(plan, &p);
      Sums sums(job, b);
      Moving moving;
      for (int k = 0; k < b.count; ++k) {
        typename Moving::Input input;
        P moved[kStates];
        const double* const history = job.steps[b.first + static_cast<std::uint32_t>(k)].history;
        step.substep_s = P(b.substep_s[k]);
        each(Model::nx(), [&](auto i) { moving.begin[i] = P(b.state[i][k]); });
        each(Model::nu(), [&](auto i) { input[i] = P(b.input[i][k]); });
        moving.advance(step, input, p, plan, [&](int age, int port) {
          return age == 0 ? P(b.input[port][k]) : P(history[(age - 1) * kInputs + port]);
        });
        each(Model::nx(), [&](auto i) { moved[i] = moving.moved[i]; });
        sums.take(job, b, k, moved, lane);
      }
      sums.put(job, lane);
    }
  }

  template <tiller_integrator_t kIntegrator>
  static void run_bare(const ResidualJob& job, Block& b) {
    record<kIntegrator>(*job.setup, b);
    sum_bare<kIntegrator>(job, b);
  }
  /// Of few states a bare step is worth a copy per integrator, which shares what the measured state alone decides.
  static void run(const ResidualJob& job, Block& b) {
    if constexpr (Model::kFewStates)
      if (job.setup->effect_count == 0 && job.setup->substeps == 1) switch (job.setup->integrator) {
          case tiller_integrator_semi_implicit_euler: return run_bare<tiller_integrator_semi_implicit_euler>(job, b);
          case tiller_integrator_midpoint: return run_bare<tiller_integrator_midpoint>(job, b);
          default: return run_bare<tiller_integrator_rk4>(job, b);
        }
    sum(job, b);
  }

  /// Missing rows were summed with no weight; their residual is not a number.
  static void mark_missing(const ResidualJob& job) {
    for (std::uint32_t k = 0; k < job.count; ++k)
      for (int i = 0; i < kStates; ++i)
        if (job.steps[k].change[i] != job.steps[k].change[i])
          for (std::uint32_t l = 0; l < job.lanes; ++l)
            job.residual[(static_cast<std::size_t>(k) * kStates + static_cast<std::size_t>(i)) * job.lanes + l] =
                __builtin_nanf("");
  }

  static void residual(const tiller_model_t&, const ResidualJob& job) {
    Block b;
    for (std::uint32_t first = 0; first < job.count; first += kResidualBlock) {
      lay_out(job, first, b);
      run(job, b);
    }
    if (job.residual) mark_missing(job);
  }
};

TILLER_ISA_NAMESPACE_END
