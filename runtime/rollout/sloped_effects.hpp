#pragma once

// Effects of a model that knows its slopes, on dual numbers of many directions. A force at a joint follows from five
// numbers and up to three states of its own, so it is differentiated by these alone; the chain rule then goes along all
// directions, past arguments that do not matter. While the sweeps over what dissipates go on, the velocities have their
// values alone: they are linear in the forces, whose derivatives are what is kept.
//
// Parameters, the body and the inverse inertia are constants here (StaticModel::sloped_dynamics,
// Stepper::respond_still).

#include "rollout/effect_calls.hpp"
#include "rollout/model_adapter.hpp"
#include "rollout/period_plan.hpp"
#include "scalar/dual.hpp"

namespace tiller {

template <class Model, class S>
struct Trajectory;
template <class Model, class S>
struct Parameters;

template <class Step>
struct SlopedEffects {
  using D = typename Step::Scalar;
  using V = typename D::value_type;
  using Model = typename Step::ModelType;
  using State = typename Step::State;
  using Input = typename Step::Input;
  using Force = typename Step::Force;
  static constexpr int kN = D::directions, kJoints = Model::kMostForces;

  /// Arguments that a force is differentiated by; an effect's states stand behind them.
  enum Argument { kPosition, kVelocity, kMiddle, kFree, kDrive, kStates };
  static constexpr int kMostStates = 3;
  using L = Dual<V, kStates + kMostStates>;

  const Step& step;
  explicit SlopedEffects(const Step& of) : step(of) {}

  struct Derivatives {
    V d[kN];
    TILLER_INLINE void clear() {
      each_direction<kN>([&](int k) TILLER_INLINED { d[k] = V(0.0); });
    }
    TILLER_INLINE void add(const V& weight, const V* of) {
      each_direction<kN>([&](int k) TILLER_INLINED { d[k] = d[k] + weight * of[k]; });
    }
    TILLER_INLINE void add(const V* of) {
      each_direction<kN>([&](int k) TILLER_INLINED { d[k] = d[k] + of[k]; });
    }
  };

  static TILLER_INLINE L seeded(const V& value, int argument) {
    L x(value);
    x.d[argument] = V(1.0);
    return x;
  }
  static TILLER_INLINE bool matters(const V& weight) { return any(weight != V(0.0)); }

  /// Parameters and states of one effect's call.
  struct Call {
    L params[kMaxEffectParams], states[kMostStates];
    D before[kMostStates];  // the states with all their derivatives
    D* kept;
    int state_count;

    TILLER_INLINE Call(const Step& of, const EffectSlot& slot, Trajectory<Model, D>& t, const Parameters<Model, D>& p)
        : kept(t.effect_state + slot.state), state_count(effect_info(slot.kind).state_count) {
      const D* const given = of.effect_params(p, slot);
      for (int i = 0; i < effect_info(slot.kind).param_count; ++i) params[i] = L(given[i].v);
      for (int s = 0; s < state_count; ++s) {
        before[s] = kept[s];
        states[s] = seeded(kept[s].v, kStates + s);
      }
    }
    /// value with all derivatives; add(argument, weight, sum) adds those of an argument before the states.
    template <class Add>
    TILLER_INLINE void spread(const L& value, Derivatives& sum, const Add& add) const {
      sum.clear();
      for (int a = 0; a < kStates; ++a)
        if (matters(value.d[a])) add(a, value.d[a], sum);
      for (int s = 0; s < state_count; ++s)
        if (matters(value.d[kStates + s])) sum.add(value.d[kStates + s], before[s].d);
    }
    template <class Add>
    TILLER_INLINE void keep_states(const Add& add) const {
      for (int s = 0; s < state_count; ++s) {
        Derivatives sum;
        spread(states[s], sum, add);
        put(states[s].v, sum, kept[s]);
      }
    }
  };
  static TILLER_INLINE void put(const V& value, const Derivatives& from, D& to) {
    to.v = value;
    each_direction<kN>([&](int k) TILLER_INLINED { to.d[k] = from.d[k]; });
  }
  template <Hook kHook, class Visit>
  TILLER_INLINE void for_slots(const Visit& visit) const {
    constexpr int kList = static_cast<int>(kHook);
    for (std::uint32_t e = 0; e < step.slot_count[kList]; ++e) visit(step.slots[kList][e], e);
  }

  /// Body effects.
  __attribute__((noinline)) void change(Body<D>& body, const Parameters<Model, D>& p) const {
    Body<V> b = {body.gravity_x_m_s2.v, body.gravity_z_m_s2.v, body.payload_kg.v, body.payload_kgm2.v};
    for_slots<Hook::body>([&](const EffectSlot& slot, std::uint32_t) {
      V params[kMaxEffectParams];
      const D* const given = step.effect_params(p, slot);
      for (int i = 0; i < effect_info(slot.kind).param_count; ++i) params[i] = given[i].v;
      called_body<V>(slot.kind, b, params);
    });
    body = {D(b.gravity_x_m_s2), D(b.gravity_z_m_s2), D(b.payload_kg), D(b.payload_kgm2)};
  }

  /// Input effects, then force effects, before the free step.
  __attribute__((noinline)) void act(Trajectory<Model, D>& t, Input& u, Force& f, const Parameters<Model, D>& p,
                                     const Length<D>& length) const {
    for_slots<Hook::input>([&](const EffectSlot& slot, std::uint32_t) {
      D& command = element(u, static_cast<int>(slot.port));
      const D given = command;
      Call call(step, slot, t, p);
      const L out = called_input<L>(slot.kind, {seeded(given.v, kDrive), L(length.h)}, call.states, call.params);
      const auto add = [&](int, const V& weight, Derivatives& sum) TILLER_INLINED { sum.add(weight, given.d); };
      Derivatives sum;
      call.spread(out, sum, add);
      put(out.v, sum, command);
      call.keep_states(add);
    });
    for_slots<Hook::force>([&](const EffectSlot& slot, std::uint32_t) {
      const int j = slot.port;
      const D* const q = step.model.template position<D>(t.x, j);
      const D &velocity = step.model.template velocity<D>(t.x, j), drive = step.drive_force(u, j);
      const V place = q ? q->v : V(0.0);
      JointStep<L> in = {seeded(place, kPosition),
                         seeded(velocity.v, kVelocity),
                         seeded(place, kPosition),
                         seeded(velocity.v, kVelocity),
                         L(0.0),
                         seeded(drive.v, kDrive),
                         L(length.h)};
      Call call(step, slot, t, p);
      const L out = called_force<L>(slot.kind, in, call.states, call.params);
      const auto add = [&](int argument, const V& weight, Derivatives& sum) {
        if (argument == kPosition && q) sum.add(weight, q->d);
        if (argument == kVelocity) sum.add(weight, velocity.d);
        if (argument == kDrive) sum.add(weight, drive.d);
      };
      Derivatives sum;
      call.spread(out, sum, add);
      D& force = element(f, step.model.force_index(j));
      force.v = force.v + out.v;
      sum.add(force.d);
      put(force.v, sum, force);
      call.keep_states(add);
    });
  }

  /// How a force follows from the joint's velocities at the start and at the end, and which part of its change acts.
  struct ByVelocities {
    V start, end, gain, relaxation;
  };
  /// Forces at the joints, all that act so far: their derivatives, and what these make of a joint's velocity.
  struct Moved {
    Derivatives at[kJoints];
    /// Friction's case, in one pass: the force's slopes, `kept` from sweep to sweep, and their change in `at`.
    TILLER_INLINE void push(const V (*response)[kJoints], const V& h, int j, const ByVelocities& by, const V* start,
                            const V* end, bool first, V* kept) {
      V weight[kJoints];
      for (int m = 0; m < kJoints; ++m) weight[m] = h * response[m][j];
      each_direction<kN>([&](int k) TILLER_INLINED {
        V free = end[k];
        for (int m = 0; m < kJoints; ++m) free = free + weight[m] * at[m].d[k];
        const V before = first ? V(0.0) : kept[k];
        const V change = by.relaxation * (by.start * start[k] + by.end * (free - by.gain * before) - before);
        kept[k] = before + change;
        at[j].d[k] = at[j].d[k] + change;
      });
    }
    TILLER_INLINE void velocity(const V (*response)[kJoints], const V& h, int j, Derivatives& sum) const {
      V weight[kJoints];
      for (int m = 0; m < kJoints; ++m) weight[m] = h * response[m][j];
      each_direction<kN>([&](int k) TILLER_INLINED {
        V at_k = weight[0] * at[0].d[k];
        for (int m = 1; m < kJoints; ++m) at_k = at_k + weight[m] * at[m].d[k];
        sum.d[k] = at_k;
      });
    }
  };

  static TILLER_INLINE bool by_velocities(const L& force) {
    return !matters(force.d[kPosition]) && !matters(force.d[kMiddle]) && !matters(force.d[kDrive]);
  }
  TILLER_INLINE void change_values(Trajectory<Model, D>& t, const V* column, const V& h, const V& share,
                                   const V& push) const {
    each(step.model.joints(), [&](auto i) {
      const V change = h * column[i] * push;
      D& speed = step.model.template velocity<D>(t.x, i);
      speed.v = speed.v + change;
      if (D* place = step.model.template position<D>(t.x, i)) place->v = place->v + share * change;
    });
  }

  /// Stepper::react().
  __attribute__((noinline)) void react(State& begin, Trajectory<Model, D>& t, Input& u, const Input& goals,
                                       const V (*response)[kJoints], const Parameters<Model, D>& p,
                                       const Length<D>& length) const {
    const int sweeps = (step.dissipating & (step.dissipating - 1)) != 0 ? Step::kSweeps : 1;
    const bool semi_implicit = step.setup.integrator == tiller_integrator_semi_implicit_euler;
    const V h = length.h, share = semi_implicit ? length.h : length.half;
    V pushes[Step::kMostSwept];  // of the sweeps so far
    Derivatives push_slopes[Step::kMostSwept];
    Moved moved;
    for (auto& joint : moved.at) joint.clear();
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      const V relaxation(sweep == 0 || sweep == sweeps - 1 ? 1.0 : Step::kRelaxation);
      for_slots<Hook::dissipation>([&](const EffectSlot& slot, std::uint32_t at) {
        const std::uint8_t e = step.swept_as[at];
        if (sweep > 0 && e >= Step::kServes) return;
        const bool serves = e == Step::kServes;
        const int j = slot.port;
        D* const q = step.model.template position<D>(begin, j);
        const D *const q_free = step.model.template position<D>(t.x, j),
                       &velocity = step.model.template velocity<D>(begin, j),
                       &free = step.model.template velocity<D>(t.x, j), drive = step.drive_force(serves ? goals : u, j);
        const V gain = h * response[j][j];
        JointStep<L> in;
        in.position = seeded(q ? q->v : V(0.0), kPosition);
        in.middle = in.position;
        if (q && !semi_implicit) in.middle = seeded(V(0.5) * (q->v + q_free->v), kMiddle);
        in.velocity = seeded(velocity.v, kVelocity);
        in.free = seeded(sweep > 0 ? free.v - gain * pushes[e] : free.v, kFree);
        in.gain = L(gain);
        in.drive = seeded(drive.v, kDrive);
        in.dt_s = L(h);
        Call call(step, slot, t, p);
        const L out = called_force<L>(slot.kind, in, call.states, call.params);

        const auto add = [&](int argument, const V& weight, Derivatives& sum) {
          Derivatives change;
          if (argument == kFree || argument == kMiddle) moved.velocity(response, h, j, change);
          switch (argument) {
            case kPosition:
              if (q) sum.add(weight, q->d);
              return;
            case kVelocity: return sum.add(weight, velocity.d);
            case kMiddle:
              sum.add(V(0.5) * weight, q->d);
              sum.add(V(0.5) * weight, q_free->d);
              return sum.add(V(0.5) * weight * share, change.d);
            case kFree:
              sum.add(weight, free.d);
              sum.add(weight, change.d);
              if (sweep > 0) sum.add(-(weight * gain), push_slopes[e].d);
              return;
            default: return sum.add(weight, drive.d);
          }
        };
        V push = out.v;
        if (sweeps > 1 && e < Step::kServes && call.state_count == 0 && by_velocities(out)) {
          const V before = sweep > 0 ? pushes[e] : V(0.0);
          push = relaxation * (push - before);
          pushes[e] = before + push;
          moved.push(response, h, j, {out.d[kVelocity], out.d[kFree], gain, relaxation}, velocity.d, free.d, sweep == 0,
                     push_slopes[e].d);
          return change_values(t, response[j], h, share, push);
        }
        Derivatives slopes;
        call.spread(out, slopes, add);
        call.keep_states(add);
        if (serves) {
          D force = step.drive_force(u, j);
          force.v = force.v + push;
          each_direction<kN>([&](int k) TILLER_INLINED { force.d[k] = force.d[k] + slopes.d[k]; });
          step.set_drive_force(u, j, force);
        }
        if (sweeps > 1 && e < Step::kServes) {
          const V before = sweep > 0 ? pushes[e] : V(0.0);
          push = relaxation * (push - before);
          pushes[e] = before + push;
          if (sweep == 0) push_slopes[e].clear();
          each_direction<kN>([&](int k) TILLER_INLINED {
            slopes.d[k] = relaxation * (slopes.d[k] - push_slopes[e].d[k]);
            push_slopes[e].d[k] = push_slopes[e].d[k] + slopes.d[k];
          });
        }
        moved.at[j].add(slopes.d);
        change_values(t, response[j], h, share, push);
      });
    }
    each(step.model.joints(), [&](auto i) {
      Derivatives change;
      moved.velocity(response, h, static_cast<int>(i), change);
      D& speed = step.model.template velocity<D>(t.x, i);
      D* const place = step.model.template position<D>(t.x, i);
      each_direction<kN>([&](int k) TILLER_INLINED {
        speed.d[k] = speed.d[k] + change.d[k];
        if (place) place->d[k] = place->d[k] + share * change.d[k];
      });
    });
  }
};

}  // namespace tiller
