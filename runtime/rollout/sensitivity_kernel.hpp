#pragma once

// The kernel of sensitivity.hpp for one model and one instruction set: points in lanes, directions in passes.

#include "rollout/sensitivity.hpp"
#include "rollout/step.hpp"
#include "scalar/dual.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <template <class> class M>
struct SensitivityKernel {
  using Model = StaticModel<M>;
  static_assert(!Model::kKnowsSlopes, "slopes take parameters for constants");
  using P = Pack<double>;
  /// Directions at once. Fewer compute values more often, more leave lanes of the last pass idle; a model with its
  /// parameters has from 6 (a pendulum) to 24 (a quadrotor).
  static constexpr int kPass = 6;
  using D = Dual<P, kPass>;
  using Step = Stepper<Model, D>;
  static constexpr int kStates = Model::kStates, kInputs = Model::kInputs, kWidth = P::width;

  /// The points of a register; the last one stands for those behind it.
  struct Register {
    std::size_t point[kWidth];
    int used;
    Register(std::uint32_t first, std::uint32_t count) : used(kWidth) {
      for (int l = 0; l < kWidth; ++l) {
        const std::uint32_t at = first + static_cast<std::uint32_t>(l);
        point[l] = at < count ? at : count - 1;
        if (at < count) used = l + 1;
      }
    }
    P gather(const double* rows, std::size_t width, std::size_t share, int i) const {
      alignas(64) double all[kWidth];
      for (int l = 0; l < kWidth; ++l) all[l] = rows[point[l] / share * width + static_cast<std::size_t>(i)];
      return P::load(all);
    }
  };

  static TILLER_INLINE D seeded(const P& value, int direction, int first) {
    D x(value);
    for (int i = 0; i < kPass; ++i)
      if (first + i == direction) x.d[i] = P(1.0);
    return x;
  }

  static __attribute__((noinline)) void advance(const Step& step, Trajectory<Model, D>& t,
                                                const typename Model::template Input<D>& u,
                                                const Parameters<Model, D>& p) {
    if (step.setup.effect_count > 0) return step.advance(t, u, p);
    const typename Model::template Force<D> f = step.no_force();
    for (std::uint32_t k = 0; k < step.setup.substeps; ++k)
      t.x = step.free_step(step.setup.integrator, t.x, u, f, p.model);
  }

  static void run_pass(const SensitivityJob& job, const Step& step, const Register& at, int first) {
    const int ns = static_cast<int>(job.setup->effect_state_count), nz = kStates + ns;
    const int np = static_cast<int>(job.param_count);
    Trajectory<Model, D> t;
    typename Model::template Input<D> u;
    Parameters<Model, D> p;
    const auto state = [&](int i) {
      return seeded(at.gather(job.state, static_cast<std::size_t>(nz), 1, i), i, first);
    };
    const auto param = [&](int i) {
      return seeded(at.gather(job.params, job.param_count, job.points_a_set, i), nz + kInputs + i, first);
    };
    each(Model::nx(), [&](auto i) { t.x[i] = state(i); });
    for (int s = 0; s < ns; ++s) t.effect_state[s] = state(kStates + s);
    each(Model::nu(), [&](auto i) { u[i] = seeded(at.gather(job.control, kInputs, 1, i), nz + i, first); });
    each(Model::np(), [&](auto i) { p.model[i] = param(i); });
    for (int i = Model::kParams; i < np; ++i) p.effect[i - Model::kParams] = param(i);
    advance(step, t, u, p);

    const auto put = [&](int row, const D& value) {
      for (int i = 0; i < kPass && first + i < nz + kInputs + np; ++i) {
        const int direction = first + i;
        double* out = job.a;
        int column = direction, columns = nz;
        if (direction >= nz + kInputs)
          out = job.c, column = direction - nz - kInputs, columns = np;
        else if (direction >= nz)
          out = job.b, column = direction - nz, columns = kInputs;
        alignas(64) double lanes[kWidth];
        value.d[i].store(lanes);
        for (int l = 0; l < at.used; ++l)
          out[(at.point[l] * static_cast<std::size_t>(nz) + static_cast<std::size_t>(row)) *
                  static_cast<std::size_t>(columns) +
              static_cast<std::size_t>(column)] = lanes[l];
      }
    };
    each(Model::nx(), [&](auto i) { put(i, t.x[i]); });
    for (int s = 0; s < ns; ++s) put(kStates + s, t.effect_state[s]);
  }

  static void run(const SensitivityJob& job) {
    const Step step({}, *job.setup, job.setup->period_s);
    const int directions = kStates + static_cast<int>(job.setup->effect_state_count) + kInputs +
                           static_cast<int>(job.param_count);
    for (std::uint32_t first = 0; first < job.points; first += static_cast<std::uint32_t>(kWidth)) {
      const Register at(first, job.points);
      for (int direction = 0; direction < directions; direction += kPass) run_pass(job, step, at, direction);
    }
  }
};

TILLER_ISA_NAMESPACE_END
