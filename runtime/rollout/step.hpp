#pragma once

// One control period of one register of trajectories: the only text of integrators and effects, for lanes, duals
// and plain numbers. Order within a period:
//   1. period effects of the inputs (delay): the commands that act in this period and when the newer one takes over;
//      body effects (tilt, payload)
//   2. each substep, in two parts where a delayed command changes within it:
//      a. input effects (lag) advance and give the acting input
//      b. force effects add to the generalised forces, then what was learnt of all joints together
//      c. the integrator takes the free step, and quaternions come back to unit length
//      d. effects act on the free step's velocities, implicitly, one after the other: more inertia, servos, the drive
//         train, what is elastic, what dissipates; where several joints dissipate, sweep after sweep until they agree;
//         states that are no joint's follow
//   3. slips that a planner expects
// The forces of d. are split off because they are stiff: solved for the velocity at the end of the step it is stable
// at any step and can stop a joint exactly. The splitting is second order in the substep where the force is smooth.
// Dissipation comes last, so that a joint can stick against all the rest.

#include <new>

#include "effects/joint_inertia.hpp"
#include "effects/position_servo.hpp"
#include "rollout/effect_calls.hpp"
#include "rollout/model_adapter.hpp"
#include "rollout/period_plan.hpp"
#include "rollout/quaternion.hpp"
#include "rollout/rollout.hpp"
#include "rollout/sloped_effects.hpp"

namespace tiller {

/// The state of one register of trajectories.
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

/// The delayed commands of one period: where a part of it says so the older one acts, else the newer one.
template <class Model, class S>
struct CommandSwitch {
  typename Model::template Input<S> older, newer;
};

struct NoPast {};

/// Time is what the length of a step is kept in. kTracks: what effects change in the state is added to `moved` too.
template <class Model, class S, class Time = double, bool kTracks = false>
struct Stepper {
  using State = typename Model::template State<S>;
  using Input = typename Model::template Input<S>;
  using Force = typename Model::template Force<S>;
  using Params = typename Model::template Params<S>;
  using Value = typename ValueOf<S>::type;

  /// Effects go by their own few arguments instead of all directions (sloped_effects.hpp).
  static constexpr bool kSloped = Model::kKnowsSlopes && (IsDual<S>::directions > 8);
  using ByArguments = SlopedEffects<Stepper>;
  using ModelType = Model;
  using Scalar = S;

  const Model model;
  const StepSetup& setup;
  const Body<S> body;
  Time substep_s;                                // of the steps to come
  EffectSlot slots[kHooks][TILLER_MAX_EFFECTS];  // the setup's effects by hook, in their order
  std::uint32_t slot_count[kHooks] = {};
  std::uint8_t lag_of[TILLER_MAX_EFFECTS];  // of an input effect that is a lag: its place among the lags
  std::uint8_t lags = 0;
  std::uint32_t reacting = 0;                 // bit j: something acts at joint j after the free step
  std::uint32_t dissipating = 0;              // bit j: something that is swept acts there
  bool serving = false;                       // some command is a goal
  std::uint8_t swept_as[TILLER_MAX_EFFECTS];  // of what acts after the free step: its place among what is swept
  static constexpr std::uint8_t kNotSwept = 255, kServes = 254;  // kServes: nor that, and it makes the drive force
  static constexpr int kMostSwept = 2 * Model::kMostForces;      // bounds the stack; further ones act once
  int swept = 0;
  State* moved = nullptr;  // read only with kTracks

  Stepper(const Model& m, const StepSetup& s, const Time& period_s)
      : model(m), setup(s), body(Body<S>::from(s.body)), substep_s(period_s / s.substeps) {
    if (s.effect_count == 0) return;
    Hook hooks[TILLER_MAX_EFFECTS];
    for (std::uint32_t e = 0; e < s.effect_count; ++e) hooks[e] = hook_of(s.effects[e].kind);
    for (int hook = 0; hook < kHooks; ++hook)
      for (std::uint32_t e = 0; e < s.effect_count; ++e)
        if (static_cast<int>(hooks[e]) == hook) take(static_cast<Hook>(hook), s.effects[e]);
  }
  /// Hooks in their order: what acts after the free step is one list, but for the inertia.
  void take(Hook hook, EffectSlot slot) {
    if (hook == Hook::servo || hook == Hook::drive) slot.port = driven_joint(slot.port);
    if (hook >= Hook::inertia && hook <= Hook::dissipation) reacting |= 1u << slot.port;
    if (hook == Hook::input && slot.kind == tiller_effect_actuator_lag)
      lag_of[slot_count[static_cast<int>(hook)]] = lags++;
    const int list = static_cast<int>(hook > Hook::inertia && hook < Hook::dissipation ? Hook::dissipation : hook);
    if (list == static_cast<int>(Hook::dissipation)) {
      const bool again = hook == Hook::dissipation && effect_info(slot.kind).state_count == 0 && swept < kMostSwept;
      swept_as[slot_count[list]] = again ? static_cast<std::uint8_t>(swept++) : kNotSwept;
      if (again) dissipating |= 1u << slot.port;
      if (hook == Hook::servo) {
        swept_as[slot_count[list]] = kServes;
        serving = true;
      }
    }
    slots[list][slot_count[list]++] = slot;
  }
  /// The first joint that an input drives; make_step_setup has seen to it that there is one.
  std::uint16_t driven_joint(std::uint16_t input) const {
    int joint = -1;
    each(model.nf(), [&](auto j) {
      if (joint < 0 && model.drive(j) == input + 1) joint = j;
    });
    return static_cast<std::uint16_t>(joint);
  }

  // ---- the free step ---------------------------------------------------------------------------

  /// Of a whole substep.
  TILLER_INLINE Length<S> whole() const { return {Value(substep_s), Value(0.5 * substep_s), Value(substep_s / 6.0)}; }
  /// The states: a loop where each carries many derivatives.
  TILLER_INLINE auto states() const {
    if constexpr (kSloped)
      return static_cast<int>(model.nx());
    else
      return model.nx();
  }
  /// Field by field: GCC copies a whole structure by halves of an AVX2 register, for which the next load of it waits.
  TILLER_INLINE void assign(State& to, const State& from) const {
    each(states(), [&](auto i) TILLER_INLINED { element(to, i) = element(from, i); });
  }
  TILLER_INLINE State along(const State& x, const State& dx, const S& h) const {
    State next;
    each(states(), [&](auto i) TILLER_INLINED { element(next, i) = element(x, i) + h * element(dx, i); });
    return next;
  }

  /// Velocities first, positions with the new velocities: first order, and keeps the energy of a swinging pendulum.
  TILLER_INLINE State semi_implicit(const State& x, const Input& u, const Force& f, const Body<S>& b, const Params& p,
                                    const Length<S>& step) const {
    State next = along(x, model.template dynamics<S>(x, u, f, b, p), S(step.h));
    State before = x;
    const auto place = [&](auto j) {
      if (S* q = model.template position<S>(next, j))
        *q = *model.template position<S>(before, j) + S(step.h) * model.template velocity<S>(next, j);
    };
    if constexpr (kSloped)
      each(model.joints(), place);
    else
      each(model.nf(), place);
    return next;
  }
  TILLER_INLINE State midpoint(const State& x, const Input& u, const Force& f, const Body<S>& b, const Params& p,
                               const Length<S>& step) const {
    const State half = along(x, model.template dynamics<S>(x, u, f, b, p), S(step.half));
    return along(x, model.template dynamics<S>(half, u, f, b, p), S(step.h));
  }
  TILLER_INLINE State rk4(const State& x, const Input& u, const Force& f, const Body<S>& b, const Params& p,
                          const Length<S>& step) const {
    const State k1 = model.template dynamics<S>(x, u, f, b, p);
    const State k2 = model.template dynamics<S>(along(x, k1, S(step.half)), u, f, b, p);
    const State k3 = model.template dynamics<S>(along(x, k2, S(step.half)), u, f, b, p);
    const State k4 = model.template dynamics<S>(along(x, k3, S(step.h)), u, f, b, p);
    State next;
    each(states(), [&](auto i) TILLER_INLINED {
      element(next, i) = element(x, i) +
                         S(step.sixth) * (element(k1, i) + S(2.0) * (element(k2, i) + element(k3, i)) + element(k4, i));
    });
    return next;
  }
  /// Registers stage by stage, so that processors find work beside the latency of one's stages. rate(x, r) is of
  /// register r, and step(r) its length.
  template <int kCount, class Rate, class Step>
  TILLER_INLINE void rk4_together(Trajectory<Model, S>* t, const Rate& rate, const Step& step,
                                  int count = kCount) const {
    State k1[kCount], k2[kCount], x[kCount];
    for (int r = 0; r < count; ++r) k1[r] = rate(t[r].x, r);
    for (int r = 0; r < count; ++r) k2[r] = rate(along(t[r].x, k1[r], S(step(r).half)), r);
    for (int r = 0; r < count; ++r) {
      const State k3 = rate(along(t[r].x, k2[r], S(step(r).half)), r);
      x[r] = along(t[r].x, k3, S(step(r).h));
      each(states(), [&](auto i) TILLER_INLINED { element(k2[r], i) = element(k2[r], i) + element(k3, i); });
    }
    for (int r = 0; r < count; ++r) {
      const State k4 = rate(x[r], r);
      each(states(), [&](auto i) TILLER_INLINED {
        element(t[r].x, i) =
            element(t[r].x, i) + S(step(r).sixth) * (element(k1[r], i) + S(2.0) * element(k2[r], i) + element(k4, i));
      });
      if constexpr (Model::kMayTurn) normalise_quaternions<Model, S>(model, t[r].x);
    }
  }
  TILLER_INLINE State free_step(tiller_integrator_t integrator, const State& x, const Input& u, const Force& f,
                                const Body<S>& b, const Params& p, const Length<S>& step) const {
    if constexpr (Model::kMayTurn) {
      State next = integrate(integrator, x, u, f, b, p, step);
      normalise_quaternions<Model, S>(model, next);
      return next;
    } else {
      return integrate(integrator, x, u, f, b, p, step);
    }
  }
  TILLER_INLINE State integrate(tiller_integrator_t integrator, const State& x, const Input& u, const Force& f,
                                const Body<S>& b, const Params& p, const Length<S>& step) const {
    switch (integrator) {
      case tiller_integrator_semi_implicit_euler: return semi_implicit(x, u, f, b, p, step);
      case tiller_integrator_midpoint: return midpoint(x, u, f, b, p, step);
      default: return rk4(x, u, f, b, p, step);
    }
  }
  TILLER_INLINE State free_step(tiller_integrator_t integrator, const State& x, const Input& u, const Force& f,
                                const Params& p) const {
    return free_step(integrator, x, u, f, body, p, whole());
  }
  TILLER_INLINE Force no_force() const {
    Force f;
    each(model.nf(), [&](auto j) { f[j] = S(0.0); });
    return f;
  }

  // ---- effects ---------------------------------------------------------------------------------

  /// Calls visit(Type<S>{}, slot) for every effect of the hook that is compiled into the kernel's loops and
  /// visit(Called{}, slot) for the others; the switch is per register, not per lane.
  template <Hook kHook, class Visit>
  TILLER_INLINE void for_effects(Visit&& visit) const {
    constexpr int kList = static_cast<int>(kHook);
    for (std::uint32_t e = 0; e < slot_count[kList]; ++e) {
      const EffectSlot& slot = slots[kList][e];
      bool called = true;
      switch (slot.kind) {
#define TILLER_INLINED_CASE(name, Type)                                         \
  case tiller_effect_##name:                                                    \
    if constexpr (Type<S>::hook == kHook && InlinedEffect<Type<S>, S>::value) { \
      visit(Type<S>{}, slot);                                                   \
      called = false;                                                           \
    }                                                                           \
    break;
        TILLER_INLINED_EFFECTS(TILLER_INLINED_CASE)
#undef TILLER_INLINED_CASE
        default: break;
      }
      if (called) visit(Called{}, slot);
    }
  }
  const S* effect_params(const Parameters<Model, S>& p, const EffectSlot& slot) const {
    return p.effect + (slot.param - static_cast<int>(model.np()));
  }

  // Several trajectories go through a period together, effect by effect and not one after the other: their arithmetic
  // does not wait for each other's, and an effect is looked up once for all. kSets is 1 where they share parameters.

  // ---- the plan of a period ----------------------------------------------------------------------

  /// Whether commands may change within a period.
  TILLER_INLINE bool delayed() const { return slot_count[static_cast<int>(Hook::period_input)] > 0; }
  template <int kCount, int kSets>
  using Plan = PeriodPlan<Model, S, kCount, kSets>;
  using OnePlan = RegisterPlan<Model, S>;

  /// The bodies with what the body effects make of them.
  template <int kCount, int kSets>
  TILLER_INLINE void plan_bodies(Plan<kCount, kSets>& plan, const Parameters<Model, S>* p) const {
    constexpr int kList = static_cast<int>(Hook::body);
    for (int r = 0; r < kSets; ++r) {
      plan.body[r] = body;
      if constexpr (kSloped)
        ByArguments(*this).change(plan.body[r], p[r]);
      else
        for (std::uint32_t e = 0; e < slot_count[kList]; ++e)
          called_body<S>(slots[kList][e].kind, plan.body[r], effect_params(p[r], slots[kList][e]));
    }
  }
  /// The rest of a plan: delays and the parts of substeps, an exponential for each lag and part. remembers: whether
  /// there are commands to delay. A plan holds for as long as parameters and substep_s stay what they are.
  template <int kCount, int kSets>
  TILLER_INLINE void plan_steps(Plan<kCount, kSets>& plan, const Parameters<Model, S>* p, bool remembers) const {
    plan.turning = remembers && delayed();
    for (int r = 0; r < kSets; ++r) {
      if (plan.turning)
        plan_register(plan.registers[r], p[r]);
      else
        plan_whole(plan.registers[r], p[r]);
    }
  }
  /// Of a substep where nothing is delayed.
  TILLER_INLINE void plan_whole(OnePlan& plan, const Parameters<Model, S>& p) const {
    plan.part_count[0] = 1;
    plan.parts[0].step = whole();
    plan_effects(plan.parts[0], p);
  }
  /// Of a period whose inputs are delayed.
  __attribute__((noinline)) void plan_register(OnePlan& plan, const Parameters<Model, S>& p) const {
    for (auto& delay : plan.delay) delay = {Value(0.0), Value(0.0), 0, 0};
    constexpr int kList = static_cast<int>(Hook::period_input);
    for (std::uint32_t e = 0; e < slot_count[kList]; ++e)
      plan.delay[slots[kList][e].port] = InputDelay<Value>::reach(static_cast<int>(setup.delay_steps),
                                                                  ValueOf<S>::of(*effect_params(p, slots[kList][e])),
                                                                  Value(substep_s * setup.substeps));
    for (std::uint32_t k = 0; k < setup.substeps && !plans_anew(); ++k) plan_parts(plan, p, k);
  }
  /// Whether a delayed period has more substeps than a plan keeps.
  TILLER_INLINE bool plans_anew() const { return setup.substeps > OnePlan::kKept; }
  TILLER_INLINE int kept_as(std::uint32_t k) const { return plans_anew() ? 0 : static_cast<int>(k); }
  /// The parts of substep k: they end where a lane's input takes its newer command.
  __attribute__((noinline)) void plan_parts(OnePlan& plan, const Parameters<Model, S>& p, std::uint32_t k) const {
    const int kept = kept_as(k);
    const Value none(0.0), all(1.0);  // shares of the substep
    const Length<S> longest = whole();
    Value done = none;
    plan.part_count[kept] = 1;
    for (int i = 0; i < OnePlan::kMostParts; ++i) {
      Part<Model, S>& part = plan.parts[kept * OnePlan::kMostParts + i];
      if (any(done < all)) plan.part_count[kept] = i + 1;
      Value until = all;
      for (int input = 0; input < static_cast<int>(model.nu()); ++input) {
        const Value turn =
            plan.delay[input].share * Value(static_cast<double>(setup.substeps)) - Value(static_cast<double>(k));
        const Value share = max(min(turn, all), none);
        part.older[input] = share > done;
        until = select(part.older[input], min(share, until), until);
      }
      const Value length = until - done;
      done = until;
      const auto cut = (length > none) & (length < all);
      part.step.h = select(cut, length * longest.h, longest.h);
      part.step.half = select(cut, Value(0.5) * part.step.h, longest.half);
      part.step.sixth = select(cut, part.step.h / Value(6.0), longest.sixth);
      part.stands = length <= none;
      plan_effects(part, p);
    }
  }
  /// Effect quantities that follow from the length of a part.
  TILLER_INLINE void plan_effects(Part<Model, S>& part, const Parameters<Model, S>& p) const {
    constexpr int kList = static_cast<int>(Hook::input);
    if constexpr (InlinedEffect<ActuatorLag<S>, S>::value)
      for (std::uint32_t e = 0; e < slot_count[kList]; ++e)
        if (slots[kList][e].kind == tiller_effect_actuator_lag)
          part.lag[lag_of[e]] = ActuatorLag<S>::shares(part.step.h, effect_params(p, slots[kList][e]));
  }

  // ---- the period --------------------------------------------------------------------------------

  /// The inputs of a period with delays; past(trajectory, i, port): the command of input `port` i periods
  /// ago.
  template <int kCount, int kSets, class Past>
  TILLER_INLINE void split_at_switch(CommandSwitch<Model, S>* turns, const Plan<kCount, kSets>& plan,
                                     const Past& past) const {
    for (int r = 0; r < kCount; ++r)
      each(inputs(), [&](auto i) TILLER_INLINED {
        InputDelay<Value>::split_at_switch([&](int age) TILLER_INLINED { return past(r, age, static_cast<int>(i)); },
                                           static_cast<int>(setup.delay_steps),
                                           plan.registers[kSets == 1 ? 0 : r].delay[i], element(turns[r].older, i),
                                           element(turns[r].newer, i));
      });
  }

  template <class J>
  TILLER_INLINE S drive_force(const Input& u, J j) const {
    if constexpr (std::is_same<J, int>::value) {
      const int input = model.drive(j);
      return input > 0 ? element(u, input - 1) : S(0.0);
    } else {
      S drive = S(0.0);
      each(model.nu(), [&](auto i) TILLER_INLINED {
        if (model.drive(j) == static_cast<int>(i) + 1) drive = u[i];
      });
      return drive;
    }
  }
  template <class J>
  TILLER_INLINE void set_drive_force(Input& u, J j, const S& force) const {
    at_port(inputs(), model.drive(j) - 1, [&](auto i) TILLER_INLINED { element(u, i) = force; });
  }
  /// Takes goals out of the commands: their forces are not known yet.
  __attribute__((noinline)) void take_goals(Input& u, Input& goals, const Parameters<Model, S>& p) const {
    goals = u;
    constexpr int kList = static_cast<int>(Hook::dissipation);
    for (std::uint32_t e = 0; e < slot_count[kList]; ++e) {
      if (swept_as[e] != kServes) continue;
      at_port(model.joints(), slots[kList][e].port, [&](auto j) TILLER_INLINED {
        set_drive_force(u, j, PositionServo<S>::free_command(drive_force(u, j), effect_params(p, slots[kList][e])));
      });
    }
  }
  /// Inputs as effects go through them: as the joints.
  TILLER_INLINE auto inputs() const {
    if constexpr (std::is_same<decltype(model.joints()), int>::value)
      return static_cast<int>(model.nu());
    else
      return model.nu();
  }
  /// f(port), as the constant of `count` that it is or as a number.
  template <int N, class F>
  static TILLER_INLINE void at_port(Index<N> count, int port, F&& f) {
    each(count, [&](auto j) TILLER_INLINED {
      if (static_cast<int>(j) == port) f(j);
    });
  }
  template <class F>
  static TILLER_INLINE void at_port(int, int port, F&& f) {
    f(port);
  }

  /// Input effects and force effects, before the free step.
  template <int kCount, int kSets>
  TILLER_INLINE void act(Trajectory<Model, S>* t, Input* u, Force* f, const Parameters<Model, S>* p,
                         const PartOfAll<Model, S, kSets>& part) const {
    if constexpr (kSloped)
      ByArguments(*this).act(*t, *u, *f, *p, part[0].step);
    else
      act_one_by_one<kCount, kSets>(t, u, f, p, part);
    if (slot_count[static_cast<int>(Hook::joints)] > 0)
      for (int r = 0; r < kCount; ++r) add_learnt(t[r].x, u[r], p[kSets == 1 ? 0 : r], f[r]);
  }
  template <int kCount, int kSets>
  TILLER_INLINE void act_one_by_one(Trajectory<Model, S>* t, Input* u, Force* f, const Parameters<Model, S>* p,
                                    const PartOfAll<Model, S, kSets>& part) const {
    for_effects<Hook::input>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      at_port(inputs(), slot.port, [&](auto i) TILLER_INLINED {
        for (int r = 0; r < kCount; ++r) {
          S& command = element(u[r], i);
          S* const state = t[r].effect_state + slot.state;
          const S* const params = effect_params(p[kSets == 1 ? 0 : r], slot);
          if constexpr (std::is_same<decltype(effect), Called>::value)
            command = called_input<S>(slot.kind, {command, S(part[r].step.h)}, state, params);
          else
            command =
                effect.apply(command, part[r].lag[lag_of[&slot - slots[static_cast<int>(Hook::input)]]], state, params);
        }
      });
    });
    for_effects<Hook::force>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
      at_port(model.joints(), slot.port, [&](auto j) TILLER_INLINED {
        const auto k = model.force_index(j);
        for (int r = 0; r < kCount; ++r) {
          S* q = model.template position<S>(t[r].x, j);
          const S position = q ? *q : S(0.0), velocity = model.template velocity<S>(t[r].x, j);
          const JointStep<S> in = {position,         velocity, position, velocity, S(0.0), drive_force(u[r], j),
                                   S(part[r].step.h)};
          element(f[r], k) =
              element(f[r], k) + call_force<decltype(effect), S>(slot.kind, in, t[r].effect_state + slot.state,
                                                                 effect_params(p[kSets == 1 ? 0 : r], slot));
        }
      });
    });
  }

  /// Forces of the network at all joints: its inputs as network_input_count() has them.
  __attribute__((noinline)) void add_learnt(State& x, const Input& u, const Parameters<Model, S>& p, Force& f) const {
    S in[3 * TILLER_MAX_JOINTS + TILLER_MAX_INPUTS], out[TILLER_MAX_NETWORK_OUTPUTS];
    int count = 0;
    each(model.joints(), [&](auto j) {
      if (const S* q = model.template position<S>(x, j)) {
        if ((setup.network_angles >> static_cast<int>(j)) & 1u) {
          sincos(*q, in[count], in[count + 1]);
          count += 2;
        } else {
          in[count++] = *q;
        }
      }
      in[count++] = model.template velocity<S>(x, j);
    });
    each(model.nu(), [&](auto i) { in[count++] = u[i]; });
    const EffectSlot& slot = slots[static_cast<int>(Hook::joints)][0];
    called_network<S>(*setup.network, *effect_params(p, slot), in, out);
    each(model.joints(), [&](auto j) {
      const auto k = model.force_index(j);
      element(f, k) = element(f, k) + out[static_cast<int>(j)];
    });
  }

  /// An entry of the inverse inertia: without derivatives where respond_still() leaves them out.
  using Share = std::conditional_t<kSloped, Value, S>;

  /// Accelerations for unit forces of a model that knows its slopes, on dual numbers: how the inverse inertia itself
  /// changes with the pose is left out of derivatives. It would act through what reacts at the joints alone, to the
  /// second order of the step.
  template <class D>
  __attribute__((noinline)) void respond_still(const typename Model::template State<D>& begin,
                                               const typename Model::template State<D>& end, const Body<D>& dual_body,
                                               const typename Model::template Params<D>& p,
                                               Share (*response)[Model::kMostForces]) const {
    using V = typename D::value_type;
    typename Model::template State<V> xv;
    typename Model::template Params<V> pv;
    each(model.nx(), [&](auto i) { xv[i] = V(0.5) * (begin[i].v + end[i].v); });
    each(model.np(), [&](auto i) { pv[i] = p[i].v; });
    V column[Model::kMostForces][Model::kMostForces];
    model.template responses<V>(
        xv, {dual_body.gravity_x_m_s2.v, dual_body.gravity_z_m_s2.v, dual_body.payload_kg.v, dual_body.payload_kgm2.v},
        pv, column);
    for (int j = 0; j < Model::kMostForces; ++j)
      for (int i = 0; i < Model::kMostForces; ++i) response[j][i] = Share(column[j][i]);
  }

  /// Accelerations for unit forces at the joints where something reacts, in the middle of the step: the inertia at
  /// its start would cost an order. response[r][j][i]: of joint i for a force at j.
  using Response = Share[Model::kMostForces][Model::kMostForces];
  template <int kCount, int kSets>
  TILLER_INLINE void respond(Response* response, const State* begin, const Trajectory<Model, S>* t, const Input* u,
                             const Force* f, const Parameters<Model, S>* p, const Body<S>* bodies) const {
    if constexpr (Model::kKnowsResponses) {
      for (int r = 0; r < kCount; ++r) {
        const auto& params = p[kSets == 1 ? 0 : r].model;
        const Body<S>& acting = bodies[kSets == 1 ? 0 : r];
        if constexpr (Model::kKnowsSlopes && IsDual<S>::value) {
          respond_still(begin[r], t[r].x, acting, params, response[r]);
        } else {
          State middle;
          each(states(), [&](auto i) { element(middle, i) = S(0.5) * (element(begin[r], i) + element(t[r].x, i)); });
          model.template responses<S>(middle, acting, params, response[r]);
        }
      }
    } else {
      each(model.joints(), [&](auto j) TILLER_INLINED {
        if ((reacting >> static_cast<int>(j)) & 1u)
          return respond_at<kCount, kSets>(response, begin, t, u, f, p, bodies, j);
        // nobody reads it; compilers cannot know
        for (int r = 0; r < kCount; ++r) each(model.joints(), [&](auto i) { response[r][j][i] = S(0.0); });
      });
    }
  }
  /// Out of line, so that all registers share its constants.
  template <int kCount, int kSets, class J>
  TILLER_FLATTENED void respond_at(Response* response, const State* begin, const Trajectory<Model, S>* t,
                                   const Input* u, const Force* f, const Parameters<Model, S>* p, const Body<S>* bodies,
                                   J j) const {
    for (int r = 0; r < kCount; ++r) {
      State middle;
      each(model.nx(), [&](auto i) { middle[i] = S(0.5) * (begin[r][i] + t[r].x[i]); });
      model.template force_response<S>(middle, u[r], f[r], bodies[kSets == 1 ? 0 : r], p[kSets == 1 ? 0 : r].model, j,
                                       response[r][j]);
    }
  }

  template <class I>
  TILLER_INLINE void change_velocity(State& next, I i, const S& change, const Length<S>& step) const {
    const S share = S(setup.integrator == tiller_integrator_semi_implicit_euler ? step.h : step.half);
    const auto change_of = [&](State& x) TILLER_INLINED {
      model.template velocity<S>(x, i) = model.template velocity<S>(x, i) + change;
      if (S* q = model.template position<S>(x, i)) *q = *q + share * change;
    };
    change_of(next);
    if constexpr (kTracks) change_of(*moved);
  }

  static TILLER_INLINE Share share_of(const S& parameter) {
    if constexpr (kSloped)
      return ValueOf<S>::of(parameter);
    else
      return parameter;
  }

  /// More inertia at joints: the inverse inertia R loses J R_j R_j' / (1 + J R_jj) (Sherman and Morrison), and so do
  /// the accelerations of the free step and what later effects feel.
  template <int kCount, int kSets>
  TILLER_INLINE void weigh_down(State* begin, Trajectory<Model, S>* t, Response* response,
                                const Parameters<Model, S>* p, const PartOfAll<Model, S, kSets>& part) const {
    constexpr int kList = static_cast<int>(Hook::inertia);
    for (std::uint32_t e = 0; e < slot_count[kList]; ++e) {
      const EffectSlot& slot = slots[kList][e];
      at_port(model.joints(), slot.port, [&](auto j) TILLER_INLINED {
        for (int r = 0; r < kCount; ++r) {
          Share column[Model::kMostForces];
          each(model.joints(), [&](auto i) { column[i] = response[r][j][i]; });
          const Share inertia = share_of(*effect_params(p[kSets == 1 ? 0 : r], slot));
          const Share share = JointInertia<Share>::per_acceleration(column[j], &inertia);
          const S lost = S(share) * (model.template velocity<S>(t[r].x, j) - model.template velocity<S>(begin[r], j));
          each(model.joints(), [&](auto i) { change_velocity(t[r].x, i, -(S(column[i]) * lost), part[r].step); });
          each(model.joints(), [&](auto c) {
            if (!((reacting >> static_cast<int>(c)) & 1u)) return;
            const Share felt = share * response[r][c][j];
            each(model.joints(), [&](auto i) { response[r][c][i] = response[r][c][i] - column[i] * felt; });
          });
        }
      });
    }
  }

  /// Sweeps over what dissipates at several joints. What one joint's friction does to its neighbours' velocities is
  /// known after these have had theirs: a single sweep leaves a joint that should stick creeping, an error of the first
  /// order of the step that is tens of times that of the rest. Successive over-relaxation of the complementarity
  /// problem (Cottle, Golub and Sacher 1978) comes within a tenth of the exact solution's own error in five sweeps for
  /// an arm of two links; the first and the last are not relaxed, so that no force ends beyond its level.
  static constexpr int kSweeps = 5;
  static constexpr double kRelaxation = 1.35;

  /// Servos, drive train, elastic and dissipating effects, in this order.
  template <int kCount, int kSets>
  TILLER_INLINE void react(State* begin, Trajectory<Model, S>* t, Input* u, const Input* goals,
                           const Response* response, const Parameters<Model, S>* p,
                           const PartOfAll<Model, S, kSets>& part) const {
    const int sweeps = (dissipating & (dissipating - 1)) != 0 ? kSweeps : 1;  // two joints or more
    S pushes[kCount][kMostSwept];                                             // of the sweeps so far
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      const S relaxation = S(sweep == 0 || sweep == sweeps - 1 ? 1.0 : kRelaxation);
      for_effects<Hook::dissipation>([&](auto effect, const EffectSlot& slot) TILLER_INLINED {
        const std::uint8_t e = swept_as[&slot - slots[static_cast<int>(Hook::dissipation)]];
        constexpr bool kMayServe = std::is_same<decltype(effect), Called>::value;
        const bool serves = kMayServe && e == kServes;
        if (sweep > 0 && e >= kServes) return;
        at_port(model.joints(), slot.port, [&](auto j) TILLER_INLINED {
          for (int r = 0; r < kCount; ++r) {
            const Length<S>& step = part[r].step;
            const S h = S(step.h);
            const S* column = response[r][j];
            JointStep<S> in;
            S *q = model.template position<S>(begin[r], j), *q_free = model.template position<S>(t[r].x, j);
            in.position = q ? *q : S(0.0);
            in.middle = in.position;
            if (q && setup.integrator != tiller_integrator_semi_implicit_euler)
              in.middle = S(0.5) * (in.position + *q_free);
            in.velocity = model.template velocity<S>(begin[r], j);
            in.free = model.template velocity<S>(t[r].x, j);
            in.gain = h * column[j];
            in.drive = drive_force(serves ? goals[r] : u[r], j);
            in.dt_s = h;
            if (sweep > 0) in.free = in.free - in.gain * pushes[r][e];
            S push = call_force<decltype(effect), S>(slot.kind, in, t[r].effect_state + slot.state,
                                                     effect_params(p[kSets == 1 ? 0 : r], slot));
            if (serves) set_drive_force(u[r], j, drive_force(u[r], j) + push);
            if (sweeps > 1 && e < kServes) {
              const S before = sweep > 0 ? pushes[r][e] : S(0.0);
              push = relaxation * (push - before);
              pushes[r][e] = before + push;
            }
            each(model.joints(),
                 [&](auto i) TILLER_INLINED { change_velocity(t[r].x, i, h * column[i] * push, step); });
          }
        });
      });
    }
  }

  /// States that are no joint's, such as the force of a spring behind a joint or the place of a vehicle, with what the
  /// step did to the velocities: the mean of the rates before and after, as positions have it. free: the free step's
  /// end. Cost: two evaluations of the dynamics.
  template <int kCount, int kSets>
  __attribute__((noinline)) void carry_others(const State* free, Trajectory<Model, S>* t, const Input* u,
                                              const Force* f, const Parameters<Model, S>* p, const Body<S>* bodies,
                                              const PartOfAll<Model, S, kSets>& part) const {
    const std::uint32_t others = model.others();
    if (others == 0) return;
    for (int r = 0; r < kCount; ++r) {
      const Length<S>& step = part[r].step;
      const S share = S(setup.integrator == tiller_integrator_semi_implicit_euler ? step.h : step.half);
      const auto& params = p[kSets == 1 ? 0 : r].model;
      const Body<S>& acting = bodies[kSets == 1 ? 0 : r];
      State before = t[r].x, end = free[r];
      each(model.joints(), [&](auto j) { model.template velocity<S>(before, j) = model.template velocity<S>(end, j); });
      const State now = model.template dynamics<S>(t[r].x, u[r], f[r], acting, params),
                  was = model.template dynamics<S>(before, u[r], f[r], acting, params);
      each(model.nx(), [&](auto i) {
        if (!((others >> static_cast<int>(i)) & 1u)) return;
        const S change = share * (now[i] - was[i]);
        t[r].x[i] = t[r].x[i] + change;
        if constexpr (kTracks) (*moved)[i] = (*moved)[i] + change;
      });
    }
  }

  template <int kCount, int kSets, tiller_integrator_t kIntegrator>
  TILLER_INLINE void free_steps(State* begin, Trajectory<Model, S>* t, const Input* u, const Force* f,
                                const Parameters<Model, S>* p, const Body<S>* bodies,
                                const PartOfAll<Model, S, kSets>& part) const {
    if constexpr (kIntegrator == tiller_integrator_rk4 && kSets < kCount) {
      for (int r = 0; r < kCount; ++r) assign(begin[r], t[r].x);
      rk4_together<kCount>(
          t,
          [&](const State& x, int r) TILLER_INLINED {
            return model.template dynamics<S>(x, u[r], f[r], bodies[kSets == 1 ? 0 : r], p[kSets == 1 ? 0 : r].model);
          },
          [&](int r) TILLER_INLINED -> const Length<S>& { return part[r].step; });
      return;
    }
    for (int r = 0; r < kCount; ++r) {
      assign(begin[r], t[r].x);
      const auto end = [&]() TILLER_INLINED {
        return free_step(kIntegrator, begin[r], u[r], f[r], bodies[kSets == 1 ? 0 : r], p[kSets == 1 ? 0 : r].model,
                         part[r].step);
      };
      if constexpr (kSloped)
        ::new (static_cast<void*>(&t[r].x)) State(end());  // in its place: an assignment would copy twenty kilobytes
      else
        assign(t[r].x, end());
    }
  }

  /// Derivatives in many directions are long arithmetic: each stage of a step then has a function and a frame of its
  /// own. In one function their temporaries would lie side by side, 600 kB of stack for an arm of six joints.
  static constexpr bool kApart = IsDual<S>::directions > 8;
  template <class Stage>
  static __attribute__((noinline)) void run_apart(const Stage& stage) {
    stage();
  }
  template <class Stage>
  static TILLER_INLINE void run_stage(const Stage& stage) {
    if constexpr (kApart)
      run_apart(stage);
    else
      stage();
  }

  /// One part of a substep with effects. u: the commands, of which input effects make what acts; bodies: (kSets);
  /// free(begin, u, f): the free steps, which leave in `begin` where they began.
  template <int kCount, int kSets, class Free>
  TILLER_INLINE void substep_with(Trajectory<Model, S>* t, Input* u, const Parameters<Model, S>* p,
                                  const Body<S>* bodies, const PartOfAll<Model, S, kSets>& part,
                                  const Free& free) const {
    Force f[kCount];
    State begin[kCount];
    for (int r = 0; r < kCount; ++r) f[r] = no_force();
    run_stage([&]() TILLER_INLINED { act<kCount, kSets>(t, u, f, p, part); });
    Input goals[kCount];
    for (int r = 0; serving && r < kCount; ++r) take_goals(u[r], goals[r], p[kSets == 1 ? 0 : r]);
    free(begin, u, f);
    if (reacting == 0) return;
    constexpr bool kCarries = Model::kMayHaveOthers;
    [[maybe_unused]] State end[kCarries ? kCount : 1];
    for (int r = 0; kCarries && r < kCount; ++r) end[r] = t[r].x;
    Response response[kCount];
    run_stage([&]() TILLER_INLINED { respond<kCount, kSets>(response, begin, t, u, f, p, bodies); });
    run_stage([&]() TILLER_INLINED { weigh_down<kCount, kSets>(begin, t, response, p, part); });
    if constexpr (kSloped)
      ByArguments(*this).react(*begin, *t, *u, *goals, *response, *p, part[0].step);
    else
      run_stage([&]() TILLER_INLINED { react<kCount, kSets>(begin, t, u, goals, response, p, part); });
    if constexpr (kCarries) carry_others<kCount, kSets>(end, t, u, f, p, bodies, part);
  }
  template <int kCount, int kSets>
  TILLER_INLINE void substep_all(Trajectory<Model, S>* t, Input* u, const Parameters<Model, S>* p,
                                 const Body<S>* bodies, const PartOfAll<Model, S, kSets>& part) const {
    substep_with<kCount, kSets>(t, u, p, bodies, part, [&](State* begin, const Input*, const Force* f) TILLER_INLINED {
      const auto take = [&](auto integrator) TILLER_INLINED {
        constexpr auto kIntegrator = static_cast<tiller_integrator_t>(integrator.value);
        run_stage([&]() TILLER_INLINED { free_steps<kCount, kSets, kIntegrator>(begin, t, u, f, p, bodies, part); });
      };
      switch (setup.integrator) {
        case tiller_integrator_semi_implicit_euler: return take(Index<tiller_integrator_semi_implicit_euler>{});
        case tiller_integrator_midpoint: return take(Index<tiller_integrator_midpoint>{});
        default: return take(Index<tiller_integrator_rk4>{});
      }
    });
  }
  /// The same, one text for all who step an imported mechanism, whose equations are long.
  template <int kCount, int kSets>
  __attribute__((noinline)) void substep_apart(Trajectory<Model, S>* t, Input* u, const Parameters<Model, S>* p,
                                               const Body<S>* bodies, const PartOfAll<Model, S, kSets>& part) const {
    substep_all<kCount, kSets>(t, u, p, bodies, part);
  }
  template <int kCount, int kSets>
  TILLER_INLINE void substep(Trajectory<Model, S>* t, Input* u, const Parameters<Model, S>* p, const Body<S>* bodies,
                             const PartOfAll<Model, S, kSets>& part) const {
    if constexpr (Model::kKnowsSlopes && !IsDual<S>::value)
      substep_apart<kCount, kSets>(t, u, p, bodies, part);
    else
      substep_all<kCount, kSets>(t, u, p, bodies, part);
  }
  /// States of effects beyond those that there are hold nothing worth copying.
  TILLER_INLINE void keep(const Trajectory<Model, S>& t, Trajectory<Model, S>& before) const {
    before.x = t.x;
    for (std::uint32_t s = 0; s < setup.effect_state_count; ++s) before.effect_state[s] = t.effect_state[s];
  }
  /// Lanes whose part is empty stand where they stood.
  TILLER_INLINE void keep_still(const MaskOf<S>& stands, const Trajectory<Model, S>& before,
                                Trajectory<Model, S>& t) const {
    each(states(), [&](auto i) { element(t.x, i) = select(stands, element(before.x, i), element(t.x, i)); });
    for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
      t.effect_state[s] = select(stands, before.effect_state[s], t.effect_state[s]);
  }
  /// Calls visit(part) for the parts of a period, one after the other.
  template <int kCount, int kSets, class Visit>
  TILLER_INLINE void for_parts(Plan<kCount, kSets>& plan, const Parameters<Model, S>* p, const Visit& visit) const {
    for (std::uint32_t k = 0; k < setup.substeps; ++k) {
      const int kept = plan.turning ? kept_as(k) : 0;
      int count = 0;
      for (int r = 0; r < kSets; ++r) {
        if (plan.turning && plans_anew()) plan_parts(plan.registers[r], p[r], k);
        if (plan.registers[r].part_count[kept] > count) count = plan.registers[r].part_count[kept];
      }
      for (int i = 0; i < count; ++i) visit(PartOfAll<Model, S, kSets>{plan.registers, kept * OnePlan::kMostParts + i});
    }
  }
  /// One period, as planned. `past` as in split_at_switch(), or NoPast: no input is delayed.
  template <int kCount, int kSets, class Past>
  TILLER_INLINE void advance_all(Trajectory<Model, S>* t, const Input* commands, const Parameters<Model, S>* p,
                                 Plan<kCount, kSets>& plan, const Past& past) const {
    Input acting[kCount];
    if constexpr (std::is_same<Past, NoPast>::value) {
      for (std::uint32_t k = 0; k < setup.substeps; ++k) {
        for (int r = 0; r < kCount; ++r) acting[r] = commands[r];
        substep<kCount, kSets>(t, acting, p, plan.body, {plan.registers, 0});
      }
    } else {
      CommandSwitch<Model, S> turns[kCount];
      Trajectory<Model, S> before[kCount];
      if (plan.turning) split_at_switch<kCount, kSets>(turns, plan, past);
      for_parts(plan, p, [&](const PartOfAll<Model, S, kSets>& part) TILLER_INLINED {
        bool stand = false;
        for (int r = 0; r < kCount; ++r) {
          acting[r] = plan.turning ? chosen(turns[r], part[r]) : commands[r];
          stand = stand || (plan.turning && any(part[r].stands));
        }
        for (int r = 0; stand && r < kCount; ++r) keep(t[r], before[r]);
        substep<kCount, kSets>(t, acting, p, plan.body, part);
        for (int r = 0; stand && r < kCount; ++r) keep_still(part[r].stands, before[r], t[r]);
      });
    }
    if constexpr (Model::kMaySlip)
      if (setup.slip_states != 0) slip<kCount, kSets>(t, p);
  }
  /// Out of line, so that periods without slips keep their registers to themselves.
  template <int kCount, int kSets>
  __attribute__((noinline)) void slip(Trajectory<Model, S>* t, const Parameters<Model, S>* p) const {
    const S period_s(Value(substep_s * setup.substeps));
    for (int r = 0; r < kCount; ++r) {
      const S* rate = p[kSets == 1 ? 0 : r].effect + (setup.fading_param - static_cast<int>(model.np()));
      each(model.nx(), [&](auto i) {
        if ((setup.slip_states >> i) & 1u) t[r].x[i] = t[r].x[i] + period_s * *rate++;
      });
    }
  }
  /// The commands that act in a part.
  TILLER_INLINE Input chosen(const CommandSwitch<Model, S>& turns, const Part<Model, S>& part) const {
    Input acting;
    each(inputs(), [&](auto i) TILLER_INLINED {
      element(acting, i) = select(part.older[i], element(turns.older, i), element(turns.newer, i));
    });
    return acting;
  }
  /// One period in which no input is delayed.
  TILLER_INLINE void advance(Trajectory<Model, S>& t, const Input& command, const Parameters<Model, S>& p) const {
    Plan<1, 1> plan;
    plan_bodies(plan, &p);
    plan_steps(plan, &p, false);
    advance_all(&t, &command, &p, plan, NoPast{});
  }
  /// past(i, port): the command of input `port` i periods ago; nobody asks where `remembers` is false.
  template <class Past>
  TILLER_INLINE void advance(Trajectory<Model, S>& t, const Input& command, const Parameters<Model, S>& p,
                             const Past& past, bool remembers = true) const {
    Plan<1, 1> plan;
    plan_bodies(plan, &p);
    plan_steps(plan, &p, remembers);
    advance_all(&t, &command, &p, plan, [&](int, int age, int port) { return past(age, port); });
  }

  /// One period without effects; the integrator is a constant.
  template <tiller_integrator_t kIntegrator>
  TILLER_INLINE void advance_bare(State& x, const Input& u, const Params& p) const {
    const Force f = no_force();
    for (std::uint32_t k = 0; k < setup.substeps; ++k) x = free_step(kIntegrator, x, u, f, p);
  }
  /// The first `count` of kCount registers.
  template <tiller_integrator_t kIntegrator, int kCount>
  TILLER_INLINE void advance_bare(Trajectory<Model, S>* t, const Input* u, const Params& p, int count) const {
    if constexpr (kIntegrator == tiller_integrator_rk4 && kCount > 1) {
      for (std::uint32_t k = 0; k < setup.substeps; ++k)
        rk4_together<kCount>(
            t,
            [&](const State& x, int r)
                TILLER_INLINED { return model.template dynamics<S>(x, u[r], no_force(), body, p); },
            [&](int) TILLER_INLINED { return whole(); }, count);
    } else {
      for (int r = 0; r < count; ++r) advance_bare<kIntegrator>(t[r].x, u[r], p);
    }
  }
};

}  // namespace tiller
