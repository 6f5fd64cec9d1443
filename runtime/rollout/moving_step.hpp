#pragma once

// One period from a state that all lanes share, with whatever a setup may hold: effects, substeps, commands that change
// within the period. Beside where a state is it keeps how far it has moved: in single precision the change over a
// period cannot be recovered from two nearly equal numbers.

#include "rollout/step.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <template <class> class M>
struct MovingStep {
  using Model = StaticModel<M>;
  using P = Pack<float>;
  using Step = Stepper<Model, P, P, true>;
  using State = typename Model::template State<P>;
  using Input = typename Model::template Input<P>;
  using Force = typename Model::template Force<P>;
  using Params = typename Model::template Params<P>;
  using Plan = typename Step::template Plan<1, 1>;

  State begin, moved;
  Trajectory<Model, P> t;  // t.x: begin + moved, to rounding

  TILLER_INLINE void start() {
    each(Model::nx(), [&](auto i) {
      t.x[i] = begin[i];
      moved[i] = P(0.0);
    });
  }

  /// Out of line: every integrator's calls share this text.
  static __attribute__((noinline)) void dynamics(const State& x, const Input& u, const Force& f, const Body<P>& body,
                                                 const Params& p, State& dx) {
    dx = Model::template dynamics<P>(x, u, f, body, p);
  }
  /// Quaternions come back to unit length; `moved` goes along.
  TILLER_INLINE void normalise() {
    if constexpr (Model::kMayTurn) {
      const State before = t.x;
      normalise_quaternions<Model, P>(Model{}, t.x);
      each(Model::nx(), [&](auto i) { moved[i] = moved[i] + (t.x[i] - before[i]); });
    }
  }
  TILLER_INLINE void place(const State& dx, const P& time, State& x) const {
    each(Model::nx(), [&](auto i) { x[i] = begin[i] + (moved[i] + time * dx[i]); });
  }
  /// The free step from t.x; `moved` goes on with it.
  __attribute__((noinline)) void free_step(tiller_integrator_t integrator, const Input& u, const Force& f,
                                           const Body<P>& body, const Params& p, const Length<P>& step) {
    State k1, k2, k3, k4, x;
    dynamics(t.x, u, f, body, p, k1);
    if (integrator == tiller_integrator_semi_implicit_euler) {
      each(Model::nf(), [&](auto j) {
        if (P* q = Model::template position<P>(k1, j))
          *q = Model::template velocity<P>(t.x, j) + step.h * Model::template velocity<P>(k1, j);
      });
    } else {
      place(k1, step.half, x);
      dynamics(x, u, f, body, p, k2);
      if (integrator == tiller_integrator_midpoint) {
        k1 = k2;
      } else {
        place(k2, step.half, x);
        dynamics(x, u, f, body, p, k3);
        place(k3, step.h, x);
        dynamics(x, u, f, body, p, k4);
        each(Model::nx(), [&](auto i) {
          moved[i] = moved[i] + step.sixth * (k1[i] + P(2.0) * (k2[i] + k3[i]) + k4[i]);
          t.x[i] = begin[i] + moved[i];
        });
        normalise();
        return;
      }
    }
    each(Model::nx(), [&](auto i) {
      moved[i] = moved[i] + step.h * k1[i];
      t.x[i] = begin[i] + moved[i];
    });
    normalise();
  }

  __attribute__((noinline)) void substep(Step& step, Input u, const Parameters<Model, P>& p, const Body<P>& body,
                                         const PartOfAll<Model, P>& part) {
    step.moved = &moved;
    step.template substep_with<1, 1>(&t, &u, &p, &body, part, [&](State* from, const Input*, const Force* f) {
      *from = t.x;
      free_step(step.setup.integrator, u, *f, body, p.model, part[0].step);
    });
  }

  /// plan.body is the caller's; the rest follows from the step's length, which may be another one each time. past(age,
  /// port): the command of input `port` `age` periods ago.
  template <class Past>
  TILLER_INLINE void advance(Step& step, const Input& command, const Parameters<Model, P>& p, Plan& plan,
                             const Past& past) {
    start();
    if (!step.delayed()) {
      step.plan_whole(plan.registers[0], p);
      for (std::uint32_t k = 0; k < step.setup.substeps; ++k)
        substep(step, command, p, plan.body[0], {plan.registers, 0});
      return;
    }
    CommandSwitch<Model, P> turns;
    step.plan_steps(plan, &p, true);
    step.template split_at_switch<1, 1>(&turns, plan, [&](int, int age, int port) { return past(age, port); });
    step.for_parts(plan, &p, [&](const PartOfAll<Model, P>& part) {
      Trajectory<Model, P> before;
      step.keep(t, before);
      const State moved_before = moved;
      substep(step, step.chosen(turns, part[0]), p, plan.body[0], part);
      const auto& stands = part[0].stands;
      if (!any(stands)) return;
      step.keep_still(stands, before, t);
      each(Model::nx(), [&](auto i) { moved[i] = select(stands, moved_before[i], moved[i]); });
    });
  }
};

TILLER_ISA_NAMESPACE_END
