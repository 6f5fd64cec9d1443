#pragma once

// One control period of one register of trajectories: the only text of integrators and effects, for lanes, duals
// and plain numbers. Order within a period:
//   1. period effects of the inputs (delay): the command that acts in this period
//   2. each substep:
//      a. input effects (lag) advance and give the acting input
//      b. force effects add to the generalised forces
//      c. the integrator takes the free step
//      d. dissipation effects (friction) act on the free step's velocities, implicitly, one after the other
// Dissipation is split off because it is what is stiff: solved for the velocity at the end of the step it is stable at
// any step and can stop a joint exactly. The splitting is second order in the substep where friction is smooth.

#include "effects/catalogue.hpp"
#include "rollout/model_adapter.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// What one register of trajectories carries.
template <class Model, class S>
struct Trajectory {
  typename Model::template State<S> x;
  S effect_state[TILLER_MAX_EFFECT_STATES];
};

/// Parameters of one register of trajectories.
template <class Model, class S>
struct Parameters {
  typename Model::template Params<S> model;
  S effect[TILLER_MAX_PARAMS];
};

template <class Model, class S>
struct Stepper {
  using State = typename Model::template State<S>;
  using Input = typename Model::template Input<S>;
  using Force = typename Model::template Force<S>;
  using Params = typename Model::template Params<S>;

  const Model model;
  const StepSetup& setup;
  const Body<S> body;
  const double substep_s;

  Stepper(const Model& m, const StepSetup& s, double period_s)
      : model(m), setup(s), body(Body<S>::from(s.body)), substep_s(period_s / s.substeps) {}

  // ---- the free step ---------------------------------------------------------------------------

  TILLER_INLINE State along(const State& x, const State& dx, double h) const {
    State next;
    each(model.nx(), [&](auto i) { next[i] = x[i] + S(h) * dx[i]; });
    return next;
  }

  /// Velocities first, positions with the new velocities: first order, and keeps the energy of a swinging pendulum.
  TILLER_INLINE State semi_implicit(const State& x, const Input& u, const Force& f, const Params& p) const {
    State next = along(x, model.template dynamics<S>(x, u, f, body, p), substep_s);
    State before = x;
    each(model.nf(), [&](auto j) {
      if (S* q = model.template position<S>(next, j))
        *q = *model.template position<S>(before, j) + S(substep_s) * model.template velocity<S>(next, j);
    });
    return next;
  }
  TILLER_INLINE State midpoint(const State& x, const Input& u, const Force& f, const Params& p) const {
    const State half = along(x, model.template dynamics<S>(x, u, f, body, p), 0.5 * substep_s);
    return along(x, model.template dynamics<S>(half, u, f, body, p), substep_s);
  }
  TILLER_INLINE State rk4(const State& x, const Input& u, const Force& f, const Params& p) const {
    const State k1 = model.template dynamics<S>(x, u, f, body, p);
    const State k2 = model.template dynamics<S>(along(x, k1, 0.5 * substep_s), u, f, body, p);
    const State k3 = model.template dynamics<S>(along(x, k2, 0.5 * substep_s), u, f, body, p);
    const State k4 = model.template dynamics<S>(along(x, k3, substep_s), u, f, body, p);
    State next;
    each(model.nx(), [&](auto i) { next[i] = x[i] + S(substep_s / 6.0) * (k1[i] + S(2.0) * (k2[i] + k3[i]) + k4[i]); });
    return next;
  }
  TILLER_INLINE State free_step(tiller_integrator_t integrator, const State& x, const Input& u, const Force& f,
                                const Params& p) const {
    switch (integrator) {
      case tiller_integrator_semi_implicit_euler: return semi_implicit(x, u, f, p);
      case tiller_integrator_midpoint: return midpoint(x, u, f, p);
      default: return rk4(x, u, f, p);
    }
  }
  TILLER_INLINE Force no_force() const {
    Force f;
    each(model.nf(), [&](auto j) { f[j] = S(0.0); });
    return f;
  }

  // ---- effects ---------------------------------------------------------------------------------

  /// Calls visit(Type<S>{}, slot) for every effect whose hook is kHook; the switch is per register, not per lane.
  template <Hook kHook, class Visit>
  TILLER_INLINE void for_effects(Visit&& visit) const {
    for (std::uint32_t e = 0; e < setup.effect_count; ++e) {
      const EffectSlot& slot = setup.effects[e];
      switch (slot.kind) {
#define TILLER_EFFECT(name, Type)                                 \
  case tiller_effect_##name:                                      \
    if constexpr (Type<S>::hook == kHook) visit(Type<S>{}, slot); \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
        default: break;
      }
    }
  }
  const S* effect_params(const Parameters<Model, S>& p, const EffectSlot& slot) const {
    return p.effect + (slot.param - static_cast<int>(model.np()));
  }

  /// past(i, port): the command of input `port` i periods ago.
  template <class Past>
  TILLER_INLINE Input acting_command(const Input& command, const Parameters<Model, S>& p, const Past& past) const {
    Input acting = command;
    for_effects<Hook::period_input>([&](auto effect, const EffectSlot& slot) {
      each(model.nu(), [&](auto i) {
        if (static_cast<int>(i) != slot.port) return;
        acting[i] = effect.apply_period([&](int age) { return past(age, static_cast<int>(i)); },
                                        static_cast<int>(setup.delay_steps), effect_params(p, slot),
                                        S(substep_s * setup.substeps));
      });
    });
    return acting;
  }

  TILLER_INLINE void dissipate(State& next, const State& x, const Input& u, const Force& f,
                               const Parameters<Model, S>& p) const {
    const double position_share = setup.integrator == tiller_integrator_semi_implicit_euler ? 1.0 : 0.5;
    S column[TILLER_MAX_JOINTS];
    int column_of = -1;
    State before = x, middle;  // the inertia in the middle of the step: at its start it would cost an order
    each(model.nx(), [&](auto i) { middle[i] = S(0.5) * (x[i] + next[i]); });
    for_effects<Hook::dissipation>([&](auto effect, const EffectSlot& slot) {
      each(model.nf(), [&](auto j) {
        if (static_cast<int>(j) != slot.port) return;
        if (column_of != static_cast<int>(j)) model.template force_response<S>(middle, u, f, body, p.model, j, column);
        column_of = j;
        const S push = effect.force(model.template velocity<S>(before, j), model.template velocity<S>(next, j),
                                    S(substep_s) * column[j], effect_params(p, slot));
        each(model.nf(), [&](auto i) {
          const S change = S(substep_s) * column[i] * push;
          model.template velocity<S>(next, i) = model.template velocity<S>(next, i) + change;
          if (S* q = model.template position<S>(next, i)) *q = *q + S(position_share * substep_s) * change;
        });
      });
    });
  }

  /// One period with effects, from the acting command.
  TILLER_INLINE void advance(Trajectory<Model, S>& t, const Input& command, const Parameters<Model, S>& p) const {
    for (std::uint32_t k = 0; k < setup.substeps; ++k) {
      Input u = command;
      for_effects<Hook::input>([&](auto effect, const EffectSlot& slot) {
        each(model.nu(), [&](auto i) {
          if (static_cast<int>(i) == slot.port)
            u[i] = effect.apply(u[i], t.effect_state + slot.state, effect_params(p, slot), S(substep_s));
        });
      });
      Force f = no_force();
      State before = t.x;
      for_effects<Hook::force>([&](auto effect, const EffectSlot& slot) {
        each(model.nf(), [&](auto j) {
          if (static_cast<int>(j) != slot.port) return;
          S* q = model.template position<S>(before, j);
          f[model.force_index(j)] =
              f[model.force_index(j)] +
              effect.force(q ? *q : S(0.0), model.template velocity<S>(before, j), effect_params(p, slot));
        });
      });
      State next = free_step(setup.integrator, t.x, u, f, p.model);
      dissipate(next, t.x, u, f, p);
      t.x = next;
    }
  }

  /// One period without effects; the integrator is a constant.
  template <tiller_integrator_t kIntegrator>
  TILLER_INLINE void advance_bare(State& x, const Input& u, const Params& p) const {
    const Force f = no_force();
    for (std::uint32_t k = 0; k < setup.substeps; ++k) x = free_step(kIntegrator, x, u, f, p);
  }
};

}  // namespace tiller
