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

constexpr int kHooks = static_cast<int>(Hook::dissipation) + 1;

/// Where the kernel calls an effect.
TILLER_INLINE Hook hook_of(std::uint32_t kind) {
  switch (kind) {
#define TILLER_EFFECT(name, Type) \
  case tiller_effect_##name:      \
    return Type<double>::hook;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: return Hook::force;  // no effect: nobody calls it
  }
}

/// Time is what the length of a step is kept in.
template <class Model, class S, class Time = double>
struct Stepper {
  using State = typename Model::template State<S>;
  using Input = typename Model::template Input<S>;
  using Force = typename Model::template Force<S>;
  using Params = typename Model::template Params<S>;

  const Model model;
  const StepSetup& setup;
  const Body<S> body;
  Time substep_s;                                // of the steps to come
  EffectSlot slots[kHooks][TILLER_MAX_EFFECTS];  // the setup's effects by hook, in their order
  std::uint32_t slot_count[kHooks] = {};
  std::uint32_t rubbing = 0;  // bit j: a dissipation acts at joint j

  Stepper(const Model& m, const StepSetup& s, const Time& period_s)
      : model(m), setup(s), body(Body<S>::from(s.body)), substep_s(period_s / s.substeps) {
    for (std::uint32_t e = 0; e < s.effect_count; ++e) {
      const int hook = static_cast<int>(hook_of(s.effects[e].kind));
      slots[hook][slot_count[hook]++] = s.effects[e];
      if (hook == static_cast<int>(Hook::dissipation)) rubbing |= 1u << s.effects[e].port;
    }
  }

  // ---- the free step ---------------------------------------------------------------------------

  TILLER_INLINE State along(const State& x, const State& dx, const Time& h) const {
    State next;
    each(model.nx(), [&](auto i) TILLER_INLINED { next[i] = x[i] + S(h) * dx[i]; });
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
    each(model.nx(), [&](auto i) TILLER_INLINED {
      next[i] = x[i] + S(substep_s / 6.0) * (k1[i] + S(2.0) * (k2[i] + k3[i]) + k4[i]);
    });
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
    constexpr int kList = static_cast<int>(kHook);
    for (std::uint32_t e = 0; e < slot_count[kList]; ++e) {
      const EffectSlot& slot = slots[kList][e];
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

  // Several trajectories go through a period together, effect by effect and not one after the other: their arithmetic
  // does not wait for each other's, and an effect is looked up once for all. kSets is 1 where they share parameters.

  /// The inputs that act in this period; past(trajectory, i, port): the command of input `port` i periods ago.
  template <int kCount, int kSets, class Past>
  TILLER_INLINE void acting_commands(Input* commands, const Parameters<Model, S>* p, const Past& past) const {
    for_effects<Hook::period_input>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      each(model.nu(), [&](auto i) TILLER_INLINED {
        if (static_cast<int>(i) != slot.port) return;
        for (int r = 0; r < kCount; ++r)
          commands[r][i] = effect.apply_period(
              [&](int age) { return past(r, age, static_cast<int>(i)); }, static_cast<int>(setup.delay_steps),
              effect_params(p[kSets == 1 ? 0 : r], slot), S(substep_s * setup.substeps));
      });
    });
  }
  template <class Past>
  TILLER_INLINE Input acting_command(const Input& command, const Parameters<Model, S>& p, const Past& past) const {
    Input acting = command;
    acting_commands<1, 1>(&acting, &p, [&](int, int age, int port) { return past(age, port); });
    return acting;
  }

  /// Input effects and force effects, before the free step.
  template <int kCount, int kSets>
  TILLER_INLINE void act(Trajectory<Model, S>* t, Input* u, Force* f, const Parameters<Model, S>* p) const {
    for_effects<Hook::input>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      each(model.nu(), [&](auto i) TILLER_INLINED {
        if (static_cast<int>(i) != slot.port) return;
        for (int r = 0; r < kCount; ++r)
          u[r][i] = effect.apply(u[r][i], t[r].effect_state + slot.state, effect_params(p[kSets == 1 ? 0 : r], slot),
                                 S(substep_s));
      });
    });
    for_effects<Hook::force>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      each(model.nf(), [&](auto j) TILLER_INLINED {
        if (static_cast<int>(j) != slot.port) return;
        const auto k = model.force_index(j);
        for (int r = 0; r < kCount; ++r) {
          S* q = model.template position<S>(t[r].x, j);
          f[r][k] = f[r][k] + effect.force(q ? *q : S(0.0), model.template velocity<S>(t[r].x, j),
                                           effect_params(p[kSets == 1 ? 0 : r], slot));
        }
      });
    });
  }

  /// Accelerations for unit forces at the joints where something dissipates, in the middle of the step: the inertia at
  /// its start would cost an order. response[r][j][i]: of joint i for a force at j.
  using Response = S[TILLER_MAX_JOINTS][TILLER_MAX_JOINTS];
  template <int kCount, int kSets>
  TILLER_INLINE void respond(Response* response, const State* next, const Trajectory<Model, S>* t, const Input* u,
                             const Force* f, const Parameters<Model, S>* p) const {
    each(model.nf(), [&](auto j) TILLER_INLINED {
      if (!((rubbing >> static_cast<int>(j)) & 1u)) return;
      for (int r = 0; r < kCount; ++r) {
        State middle;
        each(model.nx(), [&](auto i) { middle[i] = S(0.5) * (t[r].x[i] + next[r][i]); });
        model.template force_response<S>(middle, u[r], f[r], body, p[kSets == 1 ? 0 : r].model, j, response[r][j]);
      }
    });
  }

  template <int kCount, int kSets>
  TILLER_INLINE void dissipate(State* next, Trajectory<Model, S>* t, const Response* response,
                               const Parameters<Model, S>* p) const {
    const double position_share = setup.integrator == tiller_integrator_semi_implicit_euler ? 1.0 : 0.5;
    for_effects<Hook::dissipation>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      each(model.nf(), [&](auto j) TILLER_INLINED {
        if (static_cast<int>(j) != slot.port) return;
        for (int r = 0; r < kCount; ++r) {
          const S* column = response[r][j];
          const S push = effect.force(model.template velocity<S>(t[r].x, j), model.template velocity<S>(next[r], j),
                                      S(substep_s) * column[j], effect_params(p[kSets == 1 ? 0 : r], slot));
          each(model.nf(), [&](auto i) TILLER_INLINED {
            const S change = S(substep_s) * column[i] * push;
            model.template velocity<S>(next[r], i) = model.template velocity<S>(next[r], i) + change;
            if (S* q = model.template position<S>(next[r], i)) *q = *q + S(position_share * substep_s) * change;
          });
        }
      });
    });
  }

  template <int kCount, int kSets, tiller_integrator_t kIntegrator>
  TILLER_INLINE void free_steps(State* next, const Trajectory<Model, S>* t, const Input* u, const Force* f,
                                const Parameters<Model, S>* p) const {
    for (int r = 0; r < kCount; ++r) next[r] = free_step(kIntegrator, t[r].x, u[r], f[r], p[kSets == 1 ? 0 : r].model);
  }

  /// One substep with effects, from the acting commands.
  template <int kCount, int kSets>
  TILLER_INLINE void substep_all(Trajectory<Model, S>* t, const Input* commands, const Parameters<Model, S>* p) const {
    Input u[kCount];
    Force f[kCount];
    State next[kCount];
    for (int r = 0; r < kCount; ++r) {
      u[r] = commands[r];
      f[r] = no_force();
    }
    act<kCount, kSets>(t, u, f, p);
    switch (setup.integrator) {
      case tiller_integrator_semi_implicit_euler:
        free_steps<kCount, kSets, tiller_integrator_semi_implicit_euler>(next, t, u, f, p);
        break;
      case tiller_integrator_midpoint: free_steps<kCount, kSets, tiller_integrator_midpoint>(next, t, u, f, p); break;
      default: free_steps<kCount, kSets, tiller_integrator_rk4>(next, t, u, f, p);
    }
    if (rubbing != 0) {
      Response response[kCount];
      respond<kCount, kSets>(response, next, t, u, f, p);
      dissipate<kCount, kSets>(next, t, response, p);
    }
    for (int r = 0; r < kCount; ++r) t[r].x = next[r];
  }
  template <int kCount, int kSets>
  TILLER_INLINE void advance_all(Trajectory<Model, S>* t, const Input* commands, const Parameters<Model, S>* p) const {
    for (std::uint32_t k = 0; k < setup.substeps; ++k) substep_all<kCount, kSets>(t, commands, p);
  }
  TILLER_INLINE void advance(Trajectory<Model, S>& t, const Input& command, const Parameters<Model, S>& p) const {
    advance_all<1, 1>(&t, &command, &p);
  }

  /// One period without effects; the integrator is a constant.
  template <tiller_integrator_t kIntegrator>
  TILLER_INLINE void advance_bare(State& x, const Input& u, const Params& p) const {
    const Force f = no_force();
    for (std::uint32_t k = 0; k < setup.substeps; ++k) x = free_step(kIntegrator, x, u, f, p);
  }
};

}  // namespace tiller
