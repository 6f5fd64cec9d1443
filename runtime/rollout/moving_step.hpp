#pragma once

// One period from a state that all lanes share, with whatever a setup may hold: effects, substeps, commands that change
// within the period. Beside where a state is it keeps how far it has moved: in single precision the change over a period
// cannot be recovered from two nearly equal numbers.

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
  TILLER_INLINE void place(const State& dx, const P& time, State& x) const {
    each(Model::nx(), [&](auto i) { x[i] = begin[i] + (moved[i] + time * dx[i]); });
  }
  /// The free step from t.x; `moved` goes on with it.
  __attribute__((noinline)) void free_step(tiller_integrator_t integrator, const Input& u, const Force& f,
                                           const Body<P>& body, const Params& p, const Length<P>& step, State& next) {
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
          next[i] = begin[i] + moved[i];
        });
        return;
      }
    }
    each(Model::nx(), [&](auto i) {
      moved[i] = moved[i] + step.h * k1[i];
      next[i] = begin[i] + moved[i];
    });
  }

  __attribute__((noinline)) void substep(Step& step, const Input& acting, const Parameters<Model, P>& p,
                                         const Body<P>& body, const Length<P>& length) {
    step.moved = &moved;
    step.template substep_with<1, 1>(&t, &acting, &p, &body, &length, [&](State* next, const Input* u, const Force* f) {
      free_step(step.setup.integrator, *u, *f, body, p.model, length, *next);
    });
  }

  /// past(age, port): the command of input `port` `age` periods ago.
  template <class Past>
  TILLER_INLINE void advance(Step& step, const Input& command, const Parameters<Model, P>& p, const Body<P>& body,
                             const Past& past) {
    start();
    if (step.delayed()) return advance_delayed(step, command, p, body, past);
    const Length<P> whole = step.whole();
    for (std::uint32_t n = 0; n < step.setup.substeps; ++n) substep(step, command, p, body, whole);
  }
  /// With commands that change within the period, lane by lane at another time.
  template <class Past>
  TILLER_INLINE void advance_delayed(Step& step, const Input& command, const Parameters<Model, P>& p,
                                     const Body<P>& body, const Past& past) {
    Turns<Model, P> turns;
    step.template take_turns<1, 1>(&turns, &command, &p, [&](int, int age, int port) { return past(age, port); });
    for (std::uint32_t n = 0; n < step.setup.substeps; ++n) {
      P done(0.0), part;
      Input acting;
      Length<P> length;
      bool more = true;
      while (more) {
        more = step.next_part(n, turns, done, part, acting, length);
        Trajectory<Model, P> before;
        step.keep(t, before);
        const State moved_before = moved;
        substep(step, acting, p, body, length);
        step.keep_still(part, before, t);
        const auto stands = part <= P(0.0);
        each(Model::nx(), [&](auto i) { moved[i] = select(stands, moved_before[i], moved[i]); });
      }
    }
  }
};

TILLER_ISA_NAMESPACE_END
