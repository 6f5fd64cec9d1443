#pragma once

#include <cmath>
#include <vector>

#include "tools/import/articulated_body.hpp"

namespace tiller::tools {

/// How far apart two places are, and how joints move them against each other: along the normal and two tangents.
template <class T>
struct ContactRows {
  T gap{};
  T past_edge{};  ///< how far beyond the face's nearest edge; -1 where there is none
  bool has_edge = false;
  Vec3<T> direction[3];     ///< normal, then tangents, in the base's axes
  std::vector<T> reach[3];  ///< (bodies) speed along each direction for a unit speed of a joint
  T speed[3]{};             ///< of a against b
  T drift[3]{};             ///< their acceleration when no joint accelerates
};

/// Bodies' motions in the base's axes.
template <class T>
class BodyMotions {
 public:
  BodyMotions(const Mechanism& mechanism, const ArticulatedBody<T>& tree, const std::vector<T>& speed)
      : mechanism_(mechanism), tree_(tree), speed_(speed) {
    for (std::size_t i = 0; i < mechanism.bodies.size(); ++i) add(static_cast<int>(i));
  }

  /// Of one place: `a` is always above the surface of `b`.
  ContactRows<T> rows(const ContactPoint& place) const {
    ContactRows<T> out;
    const Vec3<T> centre = tree_.point(place.body_a, constant(place.at));
    const Vec3<T> origin = tree_.point(place.body_b, constant(place.face.position));
    Vec3<T>* d = out.direction;
    const Vec3<T> apart = centre - origin;
    for (int k = 0; k < 3; ++k) d[(k + 1) % 3] = tree_.direction(place.body_b, constant(column(place.face, k)));
    if (place.is_ball) {
      ball_directions(apart, d);
      out.gap = dot(d[0], apart) - T(place.radius_m + place.ball_m);
    } else {
      out.gap = dot(d[0], apart) - T(place.radius_m);
      edges(place, out, dot(d[1], apart), dot(d[2], apart));
    }
    const Vec3<T> arm = scaled(T(-place.radius_m), d[0]), point = centre + arm;
    const Motion a = motion(place.body_a), b = motion(place.body_b);
    const Vec3<T> v_centre = speed_at(a, centre - a.o), v_a = v_centre + cross(a.w, arm);
    const Vec3<T> v_point = v_centre + cross(b.w, arm);
    const Vec3<T> v = v_a - (b.v + cross(b.w, point - b.o));
    const Vec3<T> acc_a = drift_at(a, centre - a.o) + cross(a.al, arm) + cross(a.w, cross(b.w, arm));
    const Vec3<T> acc_b = b.a + cross(b.al, point - b.o) + cross(b.w, v_point - b.v);
    for (int k = 0; k < 3; ++k) {
      out.speed[k] = dot(d[k], v);
      out.drift[k] = dot(d[k], acc_a - acc_b) + dot(cross(b.w, d[k]), v);
      out.reach[k].assign(mechanism_.bodies.size(), T(0.0));
      for (std::size_t j = 0; j < mechanism_.bodies.size(); ++j) {
        const int side = (carries(j, place.body_a) ? 1 : 0) - (carries(j, place.body_b) ? 1 : 0);
        if (side == 0) continue;
        const Vec3<T> moves = mechanism_.bodies[j].prismatic ? axis_[j] : cross(axis_[j], point - motion_[j].o);
        out.reach[k][j] = side > 0 ? dot(d[k], moves) : -dot(d[k], moves);
      }
    }
    // the line of centres turns by itself
    if (place.is_ball) out.drift[0] = centres_drift(a, b, centre, origin, d[0], apart);
    return out;
  }

 private:
  struct Motion {
    Vec3<T> o{}, w{}, v{}, al{}, a{};  // origin, its speeds and, while no joint accelerates, accelerations
  };

  static Vec3<T> speed_at(const Motion& m, const Vec3<T>& r) { return m.v + cross(m.w, r); }
  static Vec3<T> drift_at(const Motion& m, const Vec3<T>& r) {
    return m.a + cross(m.al, r) + cross(m.w, cross(m.w, r));
  }
  static T centres_drift(const Motion& a, const Motion& b, const Vec3<T>& centre, const Vec3<T>& origin,
                         const Vec3<T>& normal, const Vec3<T>& apart) {
    const Vec3<T> v = speed_at(a, centre - a.o) - speed_at(b, origin - b.o);
    const T along = dot(normal, v);
    return dot(normal, drift_at(a, centre - a.o) - drift_at(b, origin - b.o)) +
           (dot(v, v) - along * along) / dot(normal, apart);
  }

  static Vec3<T> constant(const Vec3<double>& v) { return {T(v[0]), T(v[1]), T(v[2])}; }
  static Vec3<double> column(const Pose& pose, int k) {
    return {pose.rotation(0, k), pose.rotation(1, k), pose.rotation(2, k)};
  }
  Motion motion(int body) const { return body < 0 ? Motion{} : motion_[static_cast<std::size_t>(body)]; }
  bool carries(std::size_t joint, int body) const {
    for (int i = body; i >= 0; i = mechanism_.bodies[static_cast<std::size_t>(i)].parent)
      if (i == static_cast<int>(joint)) return true;
    return false;
  }

  void add(int i) {
    const auto at = static_cast<std::size_t>(i);
    const MovingBody& body = mechanism_.bodies[at];
    const Motion above = motion(body.parent);
    const Vec3<T> z = tree_.direction(i, {T(0.0), T(0.0), T(1.0)}), turn = scaled(speed_[at], z);
    axis_.push_back(z);
    Motion m = above;
    m.o = tree_.point(i, {T(0.0), T(0.0), T(0.0)});
    const Vec3<T> r = m.o - above.o;
    m.v = above.v + cross(above.w, r);
    m.a = above.a + cross(above.al, r) + cross(above.w, cross(above.w, r));
    if (body.prismatic) {
      m.v = m.v + turn;
      m.a = m.a + scaled(T(2.0), cross(above.w, turn));
    } else {
      m.w = above.w + turn;
      m.al = above.al + cross(above.w, turn);
    }
    motion_.push_back(m);
  }

  /// The normal along the line of centres; d[1] is b's own x, which gives the tangents their direction.
  static void ball_directions(const Vec3<T>& apart, Vec3<T>* d) {
    using std::sqrt;
    const Vec3<T> along = d[1];
    d[0] = scaled(T(1.0) / sqrt(dot(apart, apart) + T(1e-12)), apart);
    const Vec3<T> side = cross(d[0], along);
    d[2] = scaled(T(1.0) / sqrt(dot(side, side) + T(1e-12)), side);
    d[1] = cross(d[2], d[0]);
  }

  static void edges(const ContactPoint& place, ContactRows<T>& out, const T& x, const T& y) {
    using std::abs;
    using std::max;
    out.has_edge = place.half_x_m > 0.0;
    if (!out.has_edge) return;
    out.past_edge = max(max(abs(x) - T(place.half_x_m), abs(y) - T(place.half_y_m)), -out.gap - T(place.depth_m));
  }

  const Mechanism& mechanism_;
  const ArticulatedBody<T>& tree_;
  const std::vector<T>& speed_;
  std::vector<Motion> motion_;
  std::vector<Vec3<T>> axis_;
};

}  // namespace tiller::tools
