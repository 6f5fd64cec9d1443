#pragma once

// The C table of a model that is written as a template.

#include "rollout/model_adapter.hpp"
#include "rollout/rollout.hpp"
#include "scalar/isa_copies.hpp"

namespace tiller {

/// A model's kernels from the copies of its table: kernels_of({TILLER_COPIES(kTable_pendulum)}).
template <std::size_t count>
constexpr ModelKernels kernels_of(const IsaCopy<RolloutTable> (&copies)[count]) {
  ModelKernels kernels{};
  for (const IsaCopy<RolloutTable>& copy : copies) kernels.table[static_cast<int>(copy.isa)] = copy.table;
  return kernels;
}

template <template <class> class M>
struct ModelTable {
  using Model = StaticModel<M>;
  template <class S>
  static void read(const double* x, const double* u, const double* f, const double* p,
                   typename Model::template State<S>& xs, typename Model::template Input<S>& us,
                   typename Model::template Force<S>& fs, typename Model::template Params<S>& ps) {
    each(Model::nx(), [&](auto i) { xs[i] = S(x[i]); });
    each(Model::nu(), [&](auto i) { us[i] = S(u[i]); });
    each(Model::nf(), [&](auto i) { fs[i] = S(f[i]); });
    each(Model::np(), [&](auto i) { ps[i] = S(p[i]); });
  }
  template <class S>
  static typename Model::template State<S> evaluate(const double* x, const double* u, const double* f,
                                                    const tiller_body_t* body, const double* p,
                                                    [[maybe_unused]] int first_direction = 0) {
    typename Model::template State<S> xs;
    typename Model::template Input<S> us;
    typename Model::template Force<S> fs;
    typename Model::template Params<S> ps;
    read<S>(x, u, f, p, xs, us, fs, ps);
    if constexpr (!std::is_same<S, double>::value) {
      const auto seed = [&](S& value, int direction) {
        if (direction >= first_direction && direction < first_direction + S::directions)
          value.d[direction - first_direction] = 1.0;
      };
      each(Model::nx(), [&](auto i) { seed(xs[i], i); });
      each(Model::nu(), [&](auto i) { seed(us[i], Model::kStates + i); });
    }
    return Model::template dynamics<S>(xs, us, fs, Body<S>::from(*body), ps);
  }
  static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                       double* dxdt) {
    const auto dx = evaluate<double>(x, u, f, body, p);
    each(Model::nx(), [&](auto i) { dxdt[i] = dx[i]; });
  }
  static void jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                       double* a, double* b) {
    // all directions at once where they are few; the text of many compiles for a long time, and nothing waits for it
    constexpr int kAll = Model::kStates + Model::kInputs, kPass = kAll <= 16 || Model::kKnowsSlopes ? kAll : 4;
    for (int first = 0; first < kAll; first += kPass) {
      const auto dx = evaluate<Dual<double, kPass>>(x, u, f, body, p, first);
      each(Model::nx(), [&](auto i) {
        for (int c = first; c < kAll && c < first + kPass; ++c)
          (c < Model::kStates ? a[i * Model::kStates + c] : b[i * Model::kInputs + c - Model::kStates]) =
              dx[i].d[c - first];
      });
    }
  }

  static void outputs(const double* x, const double* p, double* y) {
    typename Model::template State<double> xs;
    typename Model::template Params<double> ps;
    each(Model::nx(), [&](auto i) { xs[i] = x[i]; });
    each(Model::np(), [&](auto i) { ps[i] = p[i]; });
    const auto ys = Model::template outputs<double>(xs, ps);
    each(Model::ny(), [&](auto i) { y[i] = ys[i]; });
  }

  using Jacobian = decltype(tiller_model_t::jacobian);
  static constexpr tiller_model_t make(const ModelKernels* kernels, Jacobian of = &jacobian) {
    tiller_model_t t{};
    t.size = sizeof(tiller_model_t);
    t.version = TILLER_MODEL_VERSION;
    t.name = M<double>::name;
    t.state_count = Model::kStates;
    t.input_count = Model::kInputs;
    t.param_count = Model::kParams;
    t.joint_count = Model::kForces;
    t.state_names = M<double>::State::names;
    t.input_names = M<double>::Input::names;
    t.param_names = ParamsOf<M<double>>::type::names;
    t.force_names = ForceOf<M<double>>::type::names;
    t.joints = ForceOf<M<double>>::joints;
    t.angle_mask = AnglesOf<M<double>>::mask;
    t.dynamics = &dynamics;
    t.jacobian = of;
    t.kernels = kernels;
    t.output_count = Model::kOutputs;
    t.output_names = OutputOf<M<double>>::type::names;
    if constexpr (Model::kOutputs > 0) t.outputs = &outputs;
    t.quaternion_mask = Model::kQuaternions;
    return t;
  }
};

}  // namespace tiller
