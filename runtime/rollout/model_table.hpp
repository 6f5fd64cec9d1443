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
                                                    const tiller_body_t* body, const double* p, int first_direction) {
    typename Model::template State<S> xs;
    typename Model::template Input<S> us;
    typename Model::template Force<S> fs;
    typename Model::template Params<S> ps;
    read<S>(x, u, f, p, xs, us, fs, ps);
    if constexpr (!std::is_same<S, double>::value) {
      each(Model::nx(), [&](auto i) { xs[i].d[first_direction + i] = 1.0; });
      each(Model::nu(), [&](auto i) { us[i].d[first_direction + Model::kStates + i] = 1.0; });
    }
    (void)first_direction;
    return Model::template dynamics<S>(xs, us, fs, Body<S>::from(*body), ps);
  }
  static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                       double* dxdt) {
    const auto dx = evaluate<double>(x, u, f, body, p, 0);
    each(Model::nx(), [&](auto i) { dxdt[i] = dx[i]; });
  }
  static void jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                       double* a, double* b) {
    const auto dx = evaluate<Dual<double, Model::kStates + Model::kInputs>>(x, u, f, body, p, 0);
    each(Model::nx(), [&](auto i) {
      for (int c = 0; c < Model::kStates; ++c) a[i * Model::kStates + c] = dx[i].d[c];
      for (int c = 0; c < Model::kInputs; ++c) b[i * Model::kInputs + c] = dx[i].d[Model::kStates + c];
    });
  }

  static constexpr tiller_model_t make(const ModelKernels* kernels) {
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
    t.jacobian = &jacobian;
    t.kernels = kernels;
    return t;
  }
};

}  // namespace tiller
