#pragma once

#include <vector>

#include "tools/import/articulated_body.hpp"

namespace tiller::tools {

/// Slopes of the joints' forces at given accelerations, and the inertia, (bodies x bodies); row: force.
template <class T>
struct ForceSlopes {
  using Matrix = std::vector<std::vector<T>>;
  Matrix by_position, by_speed, inertia;
};

/// By recursions on composite bodies (Singh, Russell and Wensing 2022, Efficient analytical derivatives of rigid-body
/// dynamics using spatial vector algebra), in the bodies' own frames. What a joint does to the composite body behind it
/// is four forces, which go up to the base once; every joint on the way reads its entries from them. A derivative along
/// one joint after the other costs the whole recursion of Newton and Euler each time.
///
/// With v, a a body's velocity and acceleration, S a joint's axis, up = v_parent x S and upper = a_parent x S +
/// v_parent x up, I a composite inertia, f its force and B its Coriolis matrix, B y = sum of m [c x; 1] (y_angular x
/// speed of the point):
///
///     d force_i / d q_j = S_i' (2 B_i up_j + I_i upper_j)                  d force_i / d v_j = 2 S_i' (B_i S_j + I_i up_j)
///     d force_j / d q_i = S_j' (2 B_i up_i + I_i upper_i + S_i x* f_i)     d force_j / d v_i = 2 S_j' (B_i S_i + I_i up_i)
///
/// for j that carries i, or is it.
template <class T>
class SlopeRecursion {
 public:
  SlopeRecursion(const Mechanism& mechanism, const std::vector<BodyInertia<T>>& inertia)
      : mechanism_(mechanism), inertia_(inertia), n_(mechanism.bodies.size()) {}

  ForceSlopes<T> slopes(const std::vector<T>& position, const std::vector<T>& speed, const std::vector<T>& acceleration,
                        const Vec3<T>& base_acceleration) {
    move(position, speed, acceleration, base_acceleration);
    const typename ForceSlopes<T>::Matrix none(n_, std::vector<T>(n_, T(0.0)));
    ForceSlopes<T> out{none, none, none};
    for (std::size_t i = n_; i-- > 0;) {
      weigh(i);
      tell(i, out);
      if (mechanism_.bodies[i].parent >= 0) hand_up(i);
    }
    return out;
  }

 private:
  using Spatial = articulated::Spatial<T>;

  /// Velocities doubled, as all but the forces have them.
  struct Body {
    Spatial velocity, velocity2, acceleration;
    Spatial up, up2, upper;  // v_parent x S; twice this; a_parent x S + v_parent x (v_parent x S)
  };
  /// A body with those that it carries.
  struct Composite {
    BodyInertia<T> inertia;
    Spatial force;
    Mat3<T> turning2;     // 2 B: the moment by the angular part
    Vec3<T> momentum2{};  // and the force, y x this
  };
  /// What joint i does to its composite body.
  struct Pulls {
    Spatial inertia, by_position, by_speed;
    Vec3<T> moment2{};  // 2 B' S, which has no force
  };

  static T along(const MovingBody& body, const Spatial& f) { return body.prismatic ? f.linear[2] : f.angular[2]; }
  /// m x S of an axis along z.
  static Spatial across(const MovingBody& body, const Spatial& m) {
    const auto turned = [](const Vec3<T>& a) { return Vec3<T>{a[1], -a[0], T(0.0)}; };
    if (body.prismatic) return {{}, turned(m.angular)};
    return {turned(m.angular), turned(m.linear)};
  }
  static Spatial push(const BodyInertia<T>& b, const Spatial& m) {
    return {b.inertia * m.angular + cross(b.moment, m.linear), scaled(b.mass, m.linear) + cross(m.angular, b.moment)};
  }

  void move(const std::vector<T>& position, const std::vector<T>& speed, const std::vector<T>& acceleration,
            const Vec3<T>& base_acceleration) {
    using namespace articulated;
    steps_.assign(n_, {});
    bodies_.assign(n_, {});
    composites_.assign(n_, {});
    for (std::size_t i = 0; i < n_; ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      steps_[i] = ArticulatedBody<T>::steps_of(body, position[i]);
      Spatial v{}, a{{}, base_acceleration};
      if (body.parent >= 0) {
        v = bodies_[static_cast<std::size_t>(body.parent)].velocity;
        a = bodies_[static_cast<std::size_t>(body.parent)].acceleration;
      }
      for (const Step<T>& step : steps_[i]) {
        v = motion_down(step, v);
        a = motion_down(step, a);
      }
      Body& b = bodies_[i];
      const Spatial up = b.up = across(body, v), lift = across(body, a);
      b.upper = {lift.angular + cross(v.angular, up.angular),
                 lift.linear + cross(v.angular, up.linear) + cross(v.linear, up.angular)};
      a = {a.angular + scaled(speed[i], up.angular), a.linear + scaled(speed[i], up.linear)};
      T &turn = body.prismatic ? v.linear[2] : v.angular[2], &gained = body.prismatic ? a.linear[2] : a.angular[2];
      turn = turn + speed[i];
      gained = gained + acceleration[i];
      b.velocity = v;
      b.velocity2 = {v.angular + v.angular, v.linear + v.linear};
      b.acceleration = a;
      b.up2 = across(body, b.velocity2);
    }
  }
  /// Adds the body itself to those that it carries: 2 B, with the sum of m v_point c' = v h' + w x E, E the second
  /// moments, and the force.
  void weigh(std::size_t i) {
    const BodyInertia<T>& of = inertia_[i];
    const Body& body = bodies_[i];
    const Vec3<T>&h = of.moment, &w2 = body.velocity2.angular, &v2 = body.velocity2.linear;
    const Mat3<T> spin = skew(w2), swung = spin * of.inertia;
    const T half = T(0.5) * (of.inertia(0, 0) + of.inertia(1, 1) + of.inertia(2, 2)), drift = dot(v2, h);
    Composite own;
    own.inertia = of;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) {
        const T entry = swung(r, c) - v2[at(r)] * h[at(c)];
        own.turning2(r, c) = r == c ? entry + drift : entry - half * spin(r, c);
      }
    own.momentum2 = scaled(of.mass, v2) + cross(w2, h);
    // v x* I v as the articulated-body algorithm has it
    const Vec3<T>& w = body.velocity.angular;
    const Vec3<T> k = cross(w, body.velocity.linear);
    const Spatial gyroscopic{cross(w, of.inertia * w) + cross(h, k), scaled(of.mass, k) + cross(w, cross(w, h))};
    const Spatial pushed = push(of, body.acceleration);
    own.force = {pushed.angular + gyroscopic.angular, pushed.linear + gyroscopic.linear};
    add(own, composites_[i]);
  }
  static void add(const Composite& part, Composite& to) {
    to.inertia.mass = to.inertia.mass + part.inertia.mass;
    to.inertia.moment = to.inertia.moment + part.inertia.moment;
    to.inertia.inertia = to.inertia.inertia + part.inertia.inertia;
    to.force = {to.force.angular + part.force.angular, to.force.linear + part.force.linear};
    to.turning2 = to.turning2 + part.turning2;
    to.momentum2 = to.momentum2 + part.momentum2;
  }

  /// The entries of joint i with itself and with those that carry it.
  void tell(std::size_t i, ForceSlopes<T>& out) const {
    using namespace articulated;
    const MovingBody& body = mechanism_.bodies[i];
    Pulls pulls = pulls_of(i);
    out.inertia[i][i] = along(body, pulls.inertia);
    if (body.armature > 0.0) out.inertia[i][i] = out.inertia[i][i] + T(body.armature);
    out.by_position[i][i] = along(body, pulls.by_position);
    out.by_speed[i][i] = along(body, pulls.by_speed);
    for (std::size_t from = i; mechanism_.bodies[from].parent >= 0;) {
      for (std::size_t s = steps_[from].size(); s-- > 0;) {
        const Step<T>& step = steps_[from][s];
        pulls.inertia = force_up(step, pulls.inertia);
        pulls.by_position = force_up(step, pulls.by_position);
        pulls.by_speed = force_up(step, pulls.by_speed);
        pulls.moment2 = turned(step.turn, pulls.moment2);
      }
      from = static_cast<std::size_t>(mechanism_.bodies[from].parent);
      const MovingBody& carrier = mechanism_.bodies[from];
      const Body& b = bodies_[from];
      out.inertia[i][from] = out.inertia[from][i] = along(carrier, pulls.inertia);
      out.by_position[from][i] = along(carrier, pulls.by_position);
      out.by_speed[from][i] = along(carrier, pulls.by_speed);
      out.by_position[i][from] = dot(b.upper.angular, pulls.inertia.angular) +
                                 dot(b.upper.linear, pulls.inertia.linear) + dot(b.up.angular, pulls.moment2);
      out.by_speed[i][from] = dot(b.up2.angular, pulls.inertia.angular) + dot(b.up2.linear, pulls.inertia.linear);
      if (!carrier.prismatic) out.by_speed[i][from] = out.by_speed[i][from] + pulls.moment2[2];
    }
  }
  Pulls pulls_of(std::size_t i) const {
    const MovingBody& body = mechanism_.bodies[i];
    const Body& moving = bodies_[i];
    const Composite& b = composites_[i];
    const Vec3<T> z{T(0.0), T(0.0), T(1.0)};
    const Spatial axis = body.prismatic ? Spatial{{}, z} : Spatial{z, {}};
    const Vec3<T>& column = b.momentum2;
    Pulls p;
    p.inertia = push(b.inertia, axis);
    p.by_speed = push(b.inertia, moving.up2);
    p.by_position = push(b.inertia, moving.upper);
    if (body.prismatic) {
      p.moment2 = cross(column, z);
      p.by_position.angular = p.by_position.angular + cross(z, b.force.linear);
      return p;
    }
    for (int k = 0; k < 3; ++k) {
      p.moment2[at(k)] = b.turning2(2, k);
      p.by_speed.angular[at(k)] = p.by_speed.angular[at(k)] + b.turning2(k, 2);
    }
    p.by_speed.linear = p.by_speed.linear + cross(z, column);
    const Vec3<T>& up = moving.up.angular;
    p.by_position.angular = p.by_position.angular + b.turning2 * up + cross(z, b.force.angular);
    p.by_position.linear = p.by_position.linear + cross(up, column) + cross(z, b.force.linear);
    return p;
  }

  /// The composite body becomes a part of the one that carries it.
  void hand_up(std::size_t i) {
    using namespace articulated;
    Composite b = composites_[i];
    for (std::size_t s = steps_[i].size(); s-- > 0;) {
      const Step<T>& step = steps_[i][s];
      const Mat3<T> shift = skew(step.shift);
      const Vec3<T> moment = turned(step.turn, b.inertia.moment);
      b.momentum2 = turned(step.turn, b.momentum2);
      b.force = force_up(step, b.force);
      b.inertia.moment = moment + scaled(b.inertia.mass, step.shift);
      b.inertia.inertia =
          turned(step.turn, b.inertia.inertia, true) - shift * skew(moment) - skew(b.inertia.moment) * shift;
      mirror(b.inertia.inertia);
      b.turning2 = turned(step.turn, b.turning2, false) - shift * skew(b.momentum2);
    }
    add(b, composites_[static_cast<std::size_t>(mechanism_.bodies[i].parent)]);
  }
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  const Mechanism& mechanism_;
  const std::vector<BodyInertia<T>>& inertia_;
  const std::size_t n_;
  std::vector<std::vector<articulated::Step<T>>> steps_;
  std::vector<Body> bodies_;
  std::vector<Composite> composites_;
};

}  // namespace tiller::tools
