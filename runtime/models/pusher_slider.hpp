#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// A round finger that pushes a box over a plane, quasi-static: friction stops the box where nothing pushes it.
/// Kinematic: the finger goes where its velocity says. Positions and velocities are in the world's axes, which is what
/// a camera sees and an arm takes; the box's x axis goes through its faces at +- half_length, its y axis through those
/// at +- half_width, and the finger may push at each of them.
///
/// Ellipsoidal limit surface (Goyal 1991; Lynch, Maekawa and Tanie 1992): a contact force f moves the box with
/// velocity f and rate (p x f) / c^2, all up to one factor, where p is the contact and c, `limit_length_m`, is the most
/// moment of the plane's friction over its most force. So the contact moves with Q f, Q = 1 + r r' / c^2, where
/// r = (-p_y, p_x). In the axes of the contact (i into the box, t along its face) the force that takes the contact
/// along with the finger is f = inverse(Q) u; where that leaves the cone |f_t| <= friction f_i, the finger slides with
/// f_t = +- friction f_i (Hogan and Rodriguez 2016). Between the two nothing jumps.
///
/// Contact comes and goes without stiffness: the box yields with max(0, u_i + 20/s penetration). From afar that is 0;
/// within a few millimetres before and after the touch the gap decays at 20/s. So no step needs to find the touch.
///
/// friction |p_i p_t| must stay below c^2 + p_t^2, or a finger that slides would wedge itself in. So it does for every
/// contact of a box that bears evenly and a friction below 1.
template <class S>
struct PusherSlider {
  static constexpr const char* name = "pusher_slider";
  TILLER_FIELDS(State, S, x_m, y_m, angle_rad, pusher_x_m, pusher_y_m);
  TILLER_FIELDS(Input, S, pusher_x_m_s, pusher_y_m_s);
  TILLER_FIELDS(Params, S, friction, limit_length_m, half_length_m, half_width_m, pusher_radius_m);
  static constexpr unsigned angles = 1u << 2;
  static constexpr bool long_dynamics = true;
  static constexpr double kGapRate_per_s = 20.0;

  static State dynamics(const State& x, const Input& u, const Body<S>&, const Params& p) {
    S sine, cosine;
    sincos(x.angle_rad, sine, cosine);
    const Vector finger = to_box(x.pusher_x_m - x.x_m, x.pusher_y_m - x.y_m, sine, cosine);
    const Vector speed = to_box(u.pusher_x_m_s, u.pusher_y_m_s, sine, cosine);
    const Touch touch = touch_of(finger, p);
    const Vector i = {-touch.outward.x, -touch.outward.y}, t = {touch.outward.y, -touch.outward.x};
    const S wanted = speed.x * i.x + speed.y * i.y + touch.depth * kGapRate_per_s;
    const auto apart = wanted <= S(0.0);  // these comparisons let a NaN through
    const S into = select(apart, S(0.0), wanted);
    const S along = speed.x * t.x + speed.y * t.y;

    // moments of unit forces, over c; Q in the contact's axes has the determinant 1 + |p|^2 / c^2
    const S inverse_c = S(1.0) / p.limit_length_m;
    const S mi = (touch.point.x * i.y - touch.point.y * i.x) * inverse_c;
    const S mt = (touch.point.x * t.y - touch.point.y * t.x) * inverse_c;
    const S qii = mi * mi + 1.0, qit = mi * mt, qtt = mt * mt + 1.0;
    const S inverse = S(1.0) / (mi * mi + mt * mt + 1.0);
    const S stick_i = (qtt * into - qit * along) * inverse, stick_t = (qii * along - qit * into) * inverse;

    const S side = select(stick_t < S(0.0), -p.friction, p.friction);
    const S slide_i = into / max(qii + side * qit, qii * 0.05);  // the bound is where a finger would wedge itself in
    const auto sticks = abs(stick_t) <= p.friction * stick_i;
    const S fi = select(apart, S(0.0), select(sticks, stick_i, slide_i));
    const S ft = select(apart, S(0.0), select(sticks, stick_t, side * slide_i));

    const S vx = fi * i.x + ft * t.x, vy = fi * i.y + ft * t.y;
    return {cosine * vx - sine * vy, sine * vx + cosine * vy, (fi * mi + ft * mt) * inverse_c, u.pusher_x_m_s,
            u.pusher_y_m_s};
  }

 private:
  struct Vector {
    S x, y;
  };
  struct Touch {
    Vector point, outward;  // of the box's rim, nearest to the finger; unit
    S depth;                // of the finger in the box
  };

  static Vector to_box(const S& x, const S& y, const S& sine, const S& cosine) {
    return {cosine * x + sine * y, cosine * y - sine * x};
  }

  static Touch touch_of(const Vector& finger, const Params& p) {
    const S px = min(max(finger.x, -p.half_length_m), p.half_length_m);
    const S py = min(max(finger.y, -p.half_width_m), p.half_width_m);
    const S ex = finger.x - px, ey = finger.y - py;
    const S squared = ex * ex + ey * ey;
    const auto inside = !(squared > S(0.0));
    const S distance = sqrt(select(inside, S(1.0), squared));
    const S inverse = S(1.0) / distance;
    // a finger whose centre is in the box, which no push brings about, comes out at the nearest face
    const S to_x = p.half_length_m - abs(finger.x), to_y = p.half_width_m - abs(finger.y);
    const S by_x = select(to_x < to_y, S(1.0), S(0.0));
    const S sx = select(finger.x < S(0.0), S(-1.0), S(1.0)), sy = select(finger.y < S(0.0), S(-1.0), S(1.0));
    const S in_x = sx * by_x, in_y = sy * (S(1.0) - by_x);
    return {{select(inside, finger.x + in_x * to_x, px), select(inside, finger.y + in_y * to_y, py)},
            {select(inside, in_x, ex * inverse), select(inside, in_y, ey * inverse)},
            p.pusher_radius_m - select(inside, -min(to_x, to_y), distance)};
  }
};

}  // namespace tiller
