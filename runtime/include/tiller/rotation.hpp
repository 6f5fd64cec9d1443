#pragma once

// Rotations in space, for models that turn in more than one plane. A template over the scalar, as models are: numbers,
// lanes and derivatives.
//
// Conventions. A quaternion is Hamilton's, (w, x, y, z) = w + x i + y j + z k with i j = k (Sola, Quaternion kinematics
// for the error-state Kalman filter, 2017, section 1). The attitude of a body takes vectors of the body to the world:
// world = rotate(attitude, body). Rates are the body's own. q and -q are the same rotation.
//
//   q (x) p          product: first p, then q
//   q'               conjugate; of a unit quaternion the inverse rotation
//   dq/dt            1/2 q (x) (0, rate)                                  (Sola, equation 198)
//   exp v            (cos |v|/2, sin(|v|/2) v/|v|), v a rotation vector in rad
//   log q            its inverse, with |log q| <= pi
//
// Near no rotation exp and log are polynomials, chosen by select(): they and their derivatives have no 0/0 there.

#include "tiller/scalar.hpp"

namespace tiller {

template <class S>
struct Vector3 {
  S x, y, z;
  friend Vector3 operator+(const Vector3& a, const Vector3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Vector3 operator-(const Vector3& a, const Vector3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Vector3 operator*(const S& s, const Vector3& a) { return {s * a.x, s * a.y, s * a.z}; }
};

template <class S>
S dot(const Vector3<S>& a, const Vector3<S>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class S>
Vector3<S> cross(const Vector3<S>& a, const Vector3<S>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// at[r][c]: row r, column c.
template <class S>
struct Matrix3 {
  S at[3][3];
  friend Vector3<S> operator*(const Matrix3& m, const Vector3<S>& v) {
    return {m.at[0][0] * v.x + m.at[0][1] * v.y + m.at[0][2] * v.z,
            m.at[1][0] * v.x + m.at[1][1] * v.y + m.at[1][2] * v.z,
            m.at[2][0] * v.x + m.at[2][1] * v.y + m.at[2][2] * v.z};
  }
};

/// skew(a) b = a x b.
template <class S>
Matrix3<S> skew(const Vector3<S>& a) {
  const S zero = S(0.0);
  return {{{zero, -a.z, a.y}, {a.z, zero, -a.x}, {-a.y, a.x, zero}}};
}

template <class S>
struct Quaternion {
  S w, x, y, z;
  friend Quaternion operator*(const Quaternion& a, const Quaternion& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
  }
};

template <class S>
Quaternion<S> conjugate(const Quaternion<S>& q) {
  return {q.w, -q.x, -q.y, -q.z};
}
template <class S>
S dot(const Quaternion<S>& a, const Quaternion<S>& b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}

/// q at unit length. Zero stays zero, what is not a number stays that.
template <class S>
Quaternion<S> normalised(const Quaternion<S>& q) {
  const S square = dot(q, q);
  const auto some = square > S(0.0);
  const S inverse = S(1.0) / sqrt(select(some, square, S(1.0)));
  return {q.w * inverse, q.x * inverse, q.y * inverse, q.z * inverse};
}

/// The vector of a body in the world: q v q', for a unit quaternion. v + 2 w (r x v) + 2 r x (r x v), r = (x, y, z).
template <class S>
Vector3<S> rotate(const Quaternion<S>& q, const Vector3<S>& v) {
  const Vector3<S> r = {q.x, q.y, q.z};
  const Vector3<S> t = S(2.0) * cross(r, v);
  return v + q.w * t + cross(r, t);
}

/// R with R v = rotate(q, v); its columns are the body's axes in the world.
template <class S>
Matrix3<S> to_matrix(const Quaternion<S>& q) {
  const S one = S(1.0), two = S(2.0);
  return {{{one - two * (q.y * q.y + q.z * q.z), two * (q.x * q.y - q.w * q.z), two * (q.x * q.z + q.w * q.y)},
           {two * (q.x * q.y + q.w * q.z), one - two * (q.x * q.x + q.z * q.z), two * (q.y * q.z - q.w * q.x)},
           {two * (q.x * q.z - q.w * q.y), two * (q.y * q.z + q.w * q.x), one - two * (q.x * q.x + q.y * q.y)}}};
}

/// dq/dt of a body that turns at `rate` (rad/s, along its own axes).
template <class S>
Quaternion<S> attitude_rate(const Quaternion<S>& q, const Vector3<S>& rate) {
  const Quaternion<S> change = q * Quaternion<S>{S(0.0), rate.x, rate.y, rate.z};
  const S half = S(0.5);
  return {half * change.w, half * change.x, half * change.y, half * change.z};
}

/// The rotation about v by |v| rad.
template <class S>
Quaternion<S> exp(const Vector3<S>& v) {
  const S square = dot(v, v);
  // the next terms are below 1e-17 there
  const auto small = square < S(1e-4);
  const S angle = sqrt(select(small, S(1.0), square));
  S sine, cosine;
  sincos(S(0.5) * angle, sine, cosine);
  const S share = select(small, S(0.5) - square * (S(1.0 / 48.0) - square * S(1.0 / 3840.0)), sine / angle);
  const S near_one = S(1.0) - square * (S(0.125) - square * (S(1.0 / 384.0) - square * S(1.0 / 46080.0)));
  const S w = select(small, near_one, cosine);
  return {w, share * v.x, share * v.y, share * v.z};
}

/// The rotation vector of q, the short way round; q of any length but zero.
template <class S>
Vector3<S> log(const Quaternion<S>& q) {
  const Vector3<S> r = {q.x, q.y, q.z};
  const S square = dot(r, r), w = abs(q.w), whole = q.w * q.w + square;
  const auto small = square < S(1e-4) * whole;
  const S length = sqrt(select(small, S(1.0), square));
  const S near_w = select(small, w, S(1.0));  // not zero: q is not
  const S t = select(small, square, S(0.0)) / (near_w * near_w);
  const S series = S(2.0) / near_w * (S(1.0) - t * (S(1.0 / 3.0) - t * (S(0.2) - t * S(1.0 / 7.0))));
  const S share = select(small, series, S(2.0) * atan2(length, w) / length);
  return copysign(S(1.0), q.w) * share * r;
}

/// The attitude after a turn about the world's z (yaw), then the new y (pitch), then the new x (roll), in rad.
template <class S>
Quaternion<S> from_roll_pitch_yaw(const S& roll, const S& pitch, const S& yaw) {
  S sr, cr, sp, cp, sy, cy;
  sincos(S(0.5) * roll, sr, cr);
  sincos(S(0.5) * pitch, sp, cp);
  sincos(S(0.5) * yaw, sy, cy);
  return {cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
          cr * cp * sy - sr * sp * cy};
}

/// Roll, pitch and yaw of a unit quaternion as x, y and z, pitch within +-pi/2. At a pitch of +-pi/2 roll and yaw are
/// not told apart, and derivatives do not exist: angles are for people, not for equations.
template <class S>
Vector3<S> to_roll_pitch_yaw(const Quaternion<S>& q) {
  const S sine = S(2.0) * (q.w * q.y - q.x * q.z);
  const S cosine = sqrt(max(S(1.0) - sine * sine, S(0.0)));
  return {atan2(S(2.0) * (q.w * q.x + q.y * q.z), S(1.0) - S(2.0) * (q.x * q.x + q.y * q.y)), atan2(sine, cosine),
          atan2(S(2.0) * (q.w * q.z + q.x * q.y), S(1.0) - S(2.0) * (q.y * q.y + q.z * q.z))};
}

// ---- differences of attitudes -------------------------------------------------------------------------
//
// What costs, filters and residuals take for a - b: the rotation from b to a along b's own axes, in the units of the
// components, which are half radians: 2 tan(angle / 4) along the axis of the rotation b' (x) a, the short way round
// (modified Rodrigues parameters, Markley and Crassidis 2014, section 2.9.5, times two). It is half the angle up to
// the third order, grows with the angle up to half a turn, costs no arc tangent, and its derivative by a at b is a
// rotation of the tangent plane: a deviation of the components is one of the difference.

/// a - b; of any lengths but zero.
template <class S>
Vector3<S> attitude_difference(const Quaternion<S>& a, const Quaternion<S>& b) {
  const Quaternion<S> turn = conjugate(b) * a;
  const S sum = sqrt(dot(turn, turn)) + abs(turn.w);
  // not copysign: what is not a number has to come through
  const S twice = select(turn.w < S(0.0), S(-2.0), S(2.0));
  const S gain = twice / select(sum > S(0.0), sum, S(1.0));
  return {gain * turn.x, gain * turn.y, gain * turn.z};
}
/// The a whose difference from b is d: unit, where b is.
template <class S>
Quaternion<S> attitude_sum(const Quaternion<S>& b, const Vector3<S>& d) {
  const S square = S(0.25) * dot(d, d), inverse = S(1.0) / (S(1.0) + square);
  return b * Quaternion<S>{(S(1.0) - square) * inverse, d.x * inverse, d.y * inverse, d.z * inverse};
}

}  // namespace tiller
