#pragma once

// Effects of a model that knows its slopes, on dual numbers of many directions. A force at a joint follows from five
// numbers and up to three states of its own, so it is differentiated by these alone; the chain rule then goes along all
// directions, past arguments that do not matter. The sweeps over what dissipates go by values alone; what they lead to
// is differentiated once, behind the last.
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

  template <class T>
  TILLER_INLINE void load_params(const EffectSlot& slot, const Parameters<Model, D>& p, T* params) const {
    const D* const given = step.effect_params(p, slot);
    for (int i = 0; i < effect_info(slot.kind).param_count; ++i) params[i] = T(given[i].v);
  }

  /// Parameters and states of one effect's call.
  struct Call {
    L params[kMaxEffectParams], states[kMostStates];
    D before[kMostStates];  // the states with all their derivatives
    D* kept;
    int state_count;

    TILLER_INLINE Call(const Step& of, const EffectSlot& slot, Trajectory<Model, D>& t, const Parameters<Model, D>& p)
        : kept(t.effect_state + slot.state), state_count(effect_info(slot.kind).state_count) {
      SlopedEffects(of).load_params(slot, p, params);
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
      load_params(slot, p, params);
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

  /// Forces at the joints: their derivatives, and what these make of a joint's velocity.
  struct Moved {
    Derivatives at[kJoints];
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

  /// The force alone of an effect without states.
  static TILLER_INLINE V force_value(std::uint32_t kind, const JointStep<V>& in, const V* params) {
    switch (kind) {
#define TILLER_INLINED_CASE(name, Type)                                                                         \
  case tiller_effect_##name:                                                                                    \
    if constexpr (Type<V>::hook == Hook::dissipation) return call_force<Type<V>, V>(kind, in, nullptr, params); \
    break;
      TILLER_INLINED_EFFECTS(TILLER_INLINED_CASE)
#undef TILLER_INLINED_CASE
      default: break;
    }
    return called_force<V>(kind, in, nullptr, params);
  }

  /// Derivatives of the swept forces where the sweeps lead to, which costs less than to follow them: every force is
  /// linear in what the others make of its joint's velocity. Two that stick at one joint are known by their sum alone:
  /// the first has it.
  struct Swept {
    V matrix[Step::kMostSwept][Step::kMostSwept];
    Derivatives force[Step::kMostSwept];  // before solve(): at the velocities without what is swept
    std::uint8_t joint[Step::kMostSwept];

    __attribute__((noinline)) void solve(int count) {
      for (int i = 0; i < count; ++i) {
        V& pivot = matrix[i][i];
        pivot = select(pivot > V(1e-9), V(1.0) / pivot, V(0.0));
        for (int r = i + 1; r < count; ++r) {
          const V share = -(matrix[r][i] * pivot);
          for (int c = i + 1; c < count; ++c) matrix[r][c] = matrix[r][c] + share * matrix[i][c];
          force[r].add(share, force[i].d);
        }
      }
      for (int i = count - 1; i >= 0; --i) {
        for (int c = i + 1; c < count; ++c) force[i].add(-matrix[i][c], force[c].d);
        each_direction<kN>([&](int k) TILLER_INLINED { force[i].d[k] = matrix[i][i] * force[i].d[k]; });
      }
    }
  };

  /// Stepper::react().
  __attribute__((noinline)) void react(State& begin, Trajectory<Model, D>& t, Input& u, const Input& goals,
                                       const V (*response)[kJoints], const Parameters<Model, D>& p,
                                       const Length<D>& length) const {
    const int sweeps = (step.dissipating & (step.dissipating - 1)) != 0 ? Step::kSweeps : 1;
    const bool semi_implicit = step.setup.integrator == tiller_integrator_semi_implicit_euler;
    const V h = length.h, share = semi_implicit ? length.h : length.half;
    V pushes[Step::kMostSwept];  // of the sweeps so far
    V speeds[kJoints], places[kJoints];
    each(step.model.joints(), [&](auto i) {
      speeds[i] = step.model.template velocity<D>(t.x, i).v;
      if (const D* place = step.model.template position<D>(t.x, i)) places[i] = place->v;
    });
    const auto change_values = [&](int j, const V& push) TILLER_INLINED {
      for (int i = 0; i < kJoints; ++i) {
        const V change = h * response[j][i] * push;
        speeds[i] = speeds[i] + change;
        places[i] = places[i] + share * change;
      }
    };
    Swept swept;
    // `now`: with what is swept, as the first sweep leaves it, for those that are not and come later
    Moved known, now;
    bool anything = false, anything_now = false;
    const auto remember = [&](Moved& moved, bool& moves, int j, const Derivatives& slopes) {
      if (!moves)
        for (auto& joint : moved.at) joint.clear();
      moves = true;
      moved.at[j].add(slopes.d);
    };
    std::uint32_t unswept = 0;  // slots from the last that is not swept on are swept
    for_slots<Hook::dissipation>([&](const EffectSlot&, std::uint32_t at) {
      if (step.swept_as[at] >= Step::kServes) unswept = at + 1;
    });
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      const bool last = sweep == sweeps - 1;
      const V relaxation(sweep == 0 || last ? 1.0 : Step::kRelaxation);
      for_slots<Hook::dissipation>([&](const EffectSlot& slot, std::uint32_t at) {
        const std::uint8_t e = step.swept_as[at];
        const bool serves = e == Step::kServes, again = sweeps > 1 && e < Step::kServes;
        if (sweep > 0 && !again) return;
        const int j = slot.port;
        D* const q = step.model.template position<D>(begin, j);
        const D *const q_free = step.model.template position<D>(t.x, j),
                       &velocity = step.model.template velocity<D>(begin, j),
                       &free = step.model.template velocity<D>(t.x, j);
        const int input = step.model.drive(j);
        const Input& commands = serves ? goals : u;
        const D* const drive = input > 0 ? &element(commands, input - 1) : nullptr;  // a copy would be a kilobyte
        const V gain = h * response[j][j];
        const auto arguments = [&](const auto& seed) TILLER_INLINED {
          JointStep<std::decay_t<decltype(seed(gain, kPosition))>> in;
          in.position = seed(q ? q->v : V(0.0), kPosition);
          in.middle = in.position;
          if (q && !semi_implicit) in.middle = seed(V(0.5) * (q->v + places[j]), kMiddle);
          in.velocity = seed(velocity.v, kVelocity);
          in.free = seed(sweep > 0 ? speeds[j] - gain * pushes[e] : speeds[j], kFree);
          in.gain = gain;
          in.drive = seed(drive ? drive->v : V(0.0), kDrive);
          in.dt_s = h;
          return in;
        };
        const auto over_relax = [&](const V& force) TILLER_INLINED {
          const V before = sweep > 0 ? pushes[e] : V(0.0), push = relaxation * (force - before);
          pushes[e] = before + push;
          change_values(j, push);
        };
        if (again && !last && (sweep > 0 || at >= unswept)) {
          V params[kMaxEffectParams];
          load_params(slot, p, params);
          const auto in = arguments([](const V& value, int) { return value; });
          return over_relax(force_value(slot.kind, in, params));
        }
        Call call(step, slot, t, p);
        const L out = called_force<L>(slot.kind, arguments(seeded), call.states, call.params);

        const Moved& moved = again && last ? known : now;
        const bool moves = again && last ? anything : anything_now;
        const auto add = [&](int argument, const V& weight, Derivatives& sum) {
          Derivatives change;
          if (moves && (argument == kFree || argument == kMiddle)) moved.velocity(response, h, j, change);
          switch (argument) {
            case kPosition:
              if (q) sum.add(weight, q->d);
              return;
            case kVelocity: return sum.add(weight, velocity.d);
            case kMiddle:
              sum.add(V(0.5) * weight, q->d);
              sum.add(V(0.5) * weight, q_free->d);
              if (moves) sum.add(V(0.5) * weight * share, change.d);
              return;
            case kFree:
              sum.add(weight, free.d);
              if (moves) sum.add(weight, change.d);
              return;
            default:
              if (drive) sum.add(weight, drive->d);
          }
        };
        if (again && last) {
          swept.joint[e] = static_cast<std::uint8_t>(j);
          call.spread(out, swept.force[e], add);
          const V middle = V(0.5) * share * out.d[kMiddle], reach = h * (out.d[kFree] + middle);
          for_slots<Hook::dissipation>([&](const EffectSlot& by, std::uint32_t of) {
            if (step.swept_as[of] < Step::kServes) swept.matrix[e][step.swept_as[of]] = -(reach * response[by.port][j]);
          });
          swept.matrix[e][e] = V(1.0) - gain * middle;
        } else {
          Derivatives slopes;
          call.spread(out, slopes, add);
          call.keep_states(add);
          if (serves) {
            D force = step.drive_force(u, j);
            force.v = force.v + out.v;
            each_direction<kN>([&](int k) TILLER_INLINED { force.d[k] = force.d[k] + slopes.d[k]; });
            step.set_drive_force(u, j, force);
          }
          remember(now, anything_now, j, slopes);
          if (!again) remember(known, anything, j, slopes);
        }
        if (again)
          over_relax(out.v);
        else
          change_values(j, out.v);
      });
    }
    if (sweeps > 1) {
      swept.solve(step.swept);
      for (int e = 0; e < step.swept; ++e) remember(known, anything, swept.joint[e], swept.force[e]);
    }
    each(step.model.joints(), [&](auto i) {
      Derivatives change;
      change.clear();
      if (anything) known.velocity(response, h, static_cast<int>(i), change);
      D& speed = step.model.template velocity<D>(t.x, i);
      D* const place = step.model.template position<D>(t.x, i);
      speed.v = speeds[i];
      if (place) place->v = places[i];
      each_direction<kN>([&](int k) TILLER_INLINED {
        speed.d[k] = speed.d[k] + change.d[k];
        if (place) place->d[k] = place->d[k] + share * change.d[k];
      });
    });
  }
};

}  // namespace tiller
