#pragma once

#include "scalar/inline.hpp"
#include "tiller/scalar.hpp"

namespace tiller {

/// Arguments of an input effect in a substep.
template <class S>
struct InputStep {
  S command;  ///< what comes in: the command, or what the effect before made of it
  S dt_s;
};

/// What an effect at a sensor sees of the state that the sensor reads. A caller that knows no derivative leaves it 0.
template <class S>
struct SensorSight {
  S state{};
  S rate{};
  S acceleration{};
};

/// Arguments of an effect at a joint in a substep. Those that act before the free step (Hook::force) see position,
/// velocity and drive; the others all of it.
template <class S>
struct JointStep {
  S position;  ///< at the start; 0 for a joint without one
  S velocity;  ///< at the start
  S middle;    ///< position in the middle of the step as far as it is known; at the start for semi-implicit Euler
  S free;      ///< velocity after the step with all forces so far
  S gain;      ///< dt times the inverse inertia: a force F more changes `free` by gain F
  S drive;     ///< force of the input that drives the joint, after the input's effects; 0 for none
  S dt_s;
};

/// Position, velocity and force of a mass, integrated together: with `middle` as above an implicit force -k x of
/// stiffness k is -k middle / (1 + k yield(step)). That is the implicit midpoint rule, which keeps a spring's energy at
/// any step, and for semi-implicit Euler its equal in frequency.
template <class S>
S yield(const JointStep<S>& in) {
  return S(0.25) * in.dt_s * in.gain;
}

/// Dry friction over a step of constant force otherwise: level(direction, speed) is its size, of the direction +-1.
///   - the joint slides on: the level of the mean speed, against the motion;
///   - it comes to rest within the step: that level up to there, and from there either it holds (the force that stops
///     the joint exactly, so that v becomes 0 and not a small number) or it slides on the way that the other forces
///     push.
/// Second order through the reversal too; the projection of the stopping force onto [-level, level] alone (Moreau's
/// time stepping) errs there by level dt, which in a record of 10 ms periods is what a fit sees. Bounded by the level,
/// so stable at any step. A level that is the constant 0 gives 0, without derivatives, at rest as well.
template <class S, class Level>
TILLER_INLINE S dry_friction(const JointStep<S>& in, const Level& level) {
  const S way = copysign(S(1.0), in.velocity), speed = abs(in.velocity), forward = way * in.free;
  const S first = level(way, speed);
  const S against = level(way, S(0.5) * (speed + max(forward - in.gain * first, S(0.0))));
  const S sliding = forward - in.gain * against;  // speed at the end, if it does not come to rest
  const S change = in.free - in.velocity;
  const S push = copysign(S(1.0), change), holding = level(push, S(0.0));
  const auto holds = abs(change) < in.gain * holding;
  // one division for both: the share of the step until it rests, or the force that stops it
  const S quotient = select(holds, -in.free, speed) / select(holds, in.gain, max(speed - sliding, S(1e-30)));
  const S &until = quotient, rest = S(1.0) - until;
  const S then = level(push, S(0.5) * rest * max(abs(change) - in.gain * holding, S(0.0)));
  const S turned = -(way * against * until) - push * then * rest;
  return select(sliding > S(0.0), -(way * against), select(holds, quotient, turned));
}

/// A fraction of a turn of something periodic in x, within half a turn to either side: lanes' sine and cosine want
/// small arguments. A spatial_period that is not positive gives what a spatial_period of 1 gives.
template <class S>
S phase(const S& x, const S& spatial_period) {
  const S turns = x / select(spatial_period > S(0.0), spatial_period, S(1.0));
  return S(6.28318530717958647693) * (turns - nearest(turns));
}

/// Friction of a sliding contact against speed: `sliding` at speed, `extra` more at rest (Stribeck).
template <class S>
S stribeck_level(const S& speed, const S& sliding, const S& extra, const S& stribeck_velocity) {
  const S ratio = speed / max(stribeck_velocity, S(1e-6));
  return sliding + extra * exp(-min(ratio * ratio, S(60.0)));
}

}  // namespace tiller
