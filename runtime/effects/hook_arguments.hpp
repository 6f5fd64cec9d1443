#pragma once

namespace tiller {

/// What an input effect sees in a substep.
template <class S>
struct InputStep {
  S command;  ///< what comes in: the command, or what the effect before made of it
  S dt_s;
};

/// What an effect at a joint sees in a substep. Those that act before the free step (Hook::force) see position,
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

/// Coulomb's law in time-stepping form: the projection of the force that stops the joint onto [-backward, forward].
/// In this order a tie goes to the constant: no friction has no derivative either, at rest as well.
template <class S>
S stop_within(const JointStep<S>& in, const S& against_forward, const S& against_backward) {
  const S stopping = -in.free / in.gain;
  return max(min(stopping, against_backward), -against_forward);
}

/// A fraction of a turn of something periodic in x, within half a turn to either side: lanes' sine and cosine want
/// small arguments. A pitch that is not positive gives what a pitch of 1 gives.
template <class S>
S phase(const S& x, const S& pitch) {
  const S turns = x / select(pitch > S(0.0), pitch, S(1.0));
  return S(6.28318530717958647693) * (turns - nearest(turns));
}

/// Friction of a sliding contact against speed: `sliding` at speed, `extra` more at rest (Stribeck).
template <class S>
S stribeck_level(const S& velocity, const S& sliding, const S& extra, const S& stribeck_velocity) {
  const S ratio = velocity / max(stribeck_velocity, S(1e-6));
  return sliding + extra * exp(-min(ratio * ratio, S(60.0)));
}

}  // namespace tiller
