#pragma once

#include <cmath>
#include <vector>

#include "tools/description/linear.hpp"
#include "tools/import/mechanism.hpp"

namespace tiller::tools {

/// Forward dynamics of a tree by the articulated-body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008,
/// chapter 7), over any number: plain ones compute, symbolic ones write equations. Everything is in the bodies' own
/// frames, whose z is the joint's axis, and goes from frame to frame by turns about one axis and shifts along axes, so
/// that what is zero by construction is never touched.

/// Inertial parameters of a body about its frame's origin.
template <class T>
struct BodyInertia {
  T mass{};
  Vec3<T> moment{};  ///< mass times centre
  Mat3<T> inertia;   ///< about the origin
};

/// Of all bodies, with what hangs on them by fixed joints.
std::vector<BodyInertia<double>> body_inertias(const Mechanism& mechanism);

namespace articulated {

/// An angular and a linear part: of a motion, or of a force (moment and force).
template <class T>
struct Spatial {
  Vec3<T> angular{}, linear{};
};

/// [I H; H' M]
template <class T>
struct Inertia {
  Mat3<T> i, h, m;
};

/// A turn about axis k by an angle whose sine and cosine are known.
template <class T>
struct Turn {
  int axis = 2;
  T sine{}, cosine = T(1.0);
  bool is_none = true;
};

template <class T>
Vec3<T> turned(const Turn<T>& t, const Vec3<T>& v) {  // from the turned frame to the one before
  if (t.is_none) return v;
  const auto a = static_cast<std::size_t>((t.axis + 1) % 3), b = static_cast<std::size_t>((t.axis + 2) % 3);
  Vec3<T> out = v;
  out[a] = t.cosine * v[a] - t.sine * v[b];
  out[b] = t.sine * v[a] + t.cosine * v[b];
  return out;
}
template <class T>
Vec3<T> turned_back(const Turn<T>& t, const Vec3<T>& v) {
  return turned(Turn<T>{t.axis, -t.sine, t.cosine, t.is_none}, v);
}

/// R A R', of any A: the plane's part by its symmetric and its other half.
template <class T>
Mat3<T> turned(const Turn<T>& t, const Mat3<T>& m, bool symmetric) {
  if (t.is_none) return m;
  const int a = (t.axis + 1) % 3, b = (t.axis + 2) % 3, k = t.axis;
  Mat3<T> out = m;
  const T both = symmetric ? m(a, b) + m(a, b) : m(a, b) + m(b, a);
  const T swing = t.sine * (m(a, a) - m(b, b)) + t.cosine * both;
  const T lift = t.sine * swing;
  out(a, a) = m(a, a) - lift;
  out(b, b) = m(b, b) + lift;
  out(a, b) = t.cosine * swing - m(b, a);
  out(b, a) = symmetric ? out(a, b) : t.cosine * swing - m(a, b);
  out(a, k) = t.cosine * m(a, k) - t.sine * m(b, k);
  out(b, k) = t.sine * m(a, k) + t.cosine * m(b, k);
  if (symmetric) {
    out(k, a) = out(a, k);
    out(k, b) = out(b, k);
  } else {
    out(k, a) = t.cosine * m(k, a) - t.sine * m(k, b);
    out(k, b) = t.sine * m(k, a) + t.cosine * m(k, b);
  }
  return out;
}

/// One step from a frame to the next: a shift in the frame above, then a turn.
template <class T>
struct Step {
  Vec3<T> shift{};
  Turn<T> turn;
};

template <class T>
Spatial<T> motion_down(const Step<T>& s, const Spatial<T>& v) {
  return {turned_back(s.turn, v.angular), turned_back(s.turn, v.linear + cross(v.angular, s.shift))};
}
template <class T>
Spatial<T> force_up(const Step<T>& s, const Spatial<T>& f) {
  const Vec3<T> force = turned(s.turn, f.linear);
  return {turned(s.turn, f.angular) + cross(s.shift, force), force};
}

template <class T>
void mirror(Mat3<T>& m) {
  for (int r = 1; r < 3; ++r)
    for (int c = 0; c < r; ++c) m(r, c) = m(c, r);
}

template <class T>
Inertia<T> inertia_up(const Step<T>& s, const Inertia<T>& below) {
  Inertia<T> up{turned(s.turn, below.i, true), turned(s.turn, below.h, false), turned(s.turn, below.m, true)};
  const Mat3<T> across = skew(s.shift);
  const Mat3<T> h = up.h + across * up.m;
  // I - H [r] + [r] (H' - M [r]) = I - H [r] + [r] h', symmetric as a whole
  Mat3<T> i = up.i - up.h * across + across * h.transposed();
  mirror(i);
  return {i, h, up.m};
}

}  // namespace articulated

template <class T>
class ArticulatedBody {
 public:
  /// (bodies): inertia as the caller has it, state of every joint, mimicking ones too.
  ArticulatedBody(const Mechanism& mechanism, std::vector<BodyInertia<T>> inertia)
      : mechanism_(mechanism), inertia_(std::move(inertia)), n_(mechanism.bodies.size()) {}

  /// Positions: lays out the frames. The first thing to call.
  void place(const std::vector<T>& position) {
    steps_.assign(n_, {});
    for (std::size_t i = 0; i < n_; ++i) steps_[i] = steps_of(mechanism_.bodies[i], position[i]);
  }

  /// Articulated inertias, from the leaves to the base.
  void weigh() {
    using namespace articulated;
    articulated_.assign(n_, {});
    for (std::size_t i = 0; i < n_; ++i) {
      const BodyInertia<T>& b = inertia_[i];
      Mat3<T> m;
      for (int k = 0; k < 3; ++k) m(k, k) = b.mass;
      articulated_[i] = {b.inertia, skew(b.moment), m};
    }
    reach_.assign(n_, {});
    inverse_.assign(n_, T(0.0));
    for (std::size_t i = n_; i-- > 0;) {
      const MovingBody& body = mechanism_.bodies[i];
      const Inertia<T>& a = articulated_[i];
      Spatial<T>& u = reach_[i];
      for (int k = 0; k < 3; ++k) {
        const auto at = static_cast<std::size_t>(k);
        u.angular[at] = body.prismatic ? a.h(k, 2) : a.i(k, 2);
        u.linear[at] = body.prismatic ? a.m(k, 2) : a.h(2, k);
      }
      inverse_[i] = T(1.0) / ((body.prismatic ? u.linear[2] : u.angular[2]) + T(body.armature));
      if (body.parent < 0) continue;
      Inertia<T> rest = eliminated(body, a, u, inverse_[i]);
      for (std::size_t s = steps_[i].size(); s-- > 0;) rest = inertia_up(steps_[i][s], rest);
      Inertia<T>& above = articulated_[static_cast<std::size_t>(body.parent)];
      above.i = above.i + rest.i;
      above.h = above.h + rest.h;
      above.m = above.m + rest.m;
    }
  }

  /// Accelerations of the joints (bodies) under forces, speeds and gravity.
  std::vector<T> accelerate(const std::vector<T>& speed, const std::vector<T>& force,
                            const Vec3<T>& base_acceleration) {
    using namespace articulated;
    force_ = force;
    const std::vector<Spatial<T>> velocity = velocities(speed);
    std::vector<Spatial<T>> bias(n_), load(n_);
    for (std::size_t i = 0; i < n_; ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      const Spatial<T>& v = velocity[i];
      // v x S qd, with v before or after the joint's own speed: their cross product is the same
      if (!body.prismatic) bias[i].angular = {v.angular[1] * speed[i], -(v.angular[0] * speed[i]), T(0.0)};
      const Vec3<T>& across = body.prismatic ? v.angular : v.linear;
      bias[i].linear = {across[1] * speed[i], -(across[0] * speed[i]), T(0.0)};
      load[i] = gyroscopic(inertia_[i], v);
    }
    std::vector<T> left(n_);
    for (std::size_t i = n_; i-- > 0;) {
      const MovingBody& body = mechanism_.bodies[i];
      left[i] = force[i] - (body.prismatic ? load[i].linear[2] : load[i].angular[2]);
      if (body.parent < 0) continue;
      pass_up(i, body, bias[i], left[i], load);
    }
    std::vector<T> out(n_);
    std::vector<Spatial<T>> acceleration(n_);
    for (std::size_t i = 0; i < n_; ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      Spatial<T> a{{}, base_acceleration};
      if (body.parent >= 0) a = acceleration[static_cast<std::size_t>(body.parent)];
      for (const Step<T>& step : steps_[i]) a = motion_down(step, a);
      a = {a.angular + bias[i].angular, a.linear + bias[i].linear};
      out[i] = (left[i] - dot(reach_[i].angular, a.angular) - dot(reach_[i].linear, a.linear)) * inverse_[i];
      T& along = body.prismatic ? a.linear[2] : a.angular[2];
      along = along + out[i];
      acceleration[i] = a;
    }
    return out;
  }

  /// Accelerations of joints 0 to j for a unit force at joint j, everything at rest: the inverse inertia, whose other
  /// half is the same.
  std::vector<T> respond(std::size_t j) {
    using namespace articulated;
    std::vector<Spatial<T>> load(n_);
    std::vector<T> left(n_, T(0.0));
    left[j] = T(1.0);
    force_ = left;
    for (int at = static_cast<int>(j); at >= 0;) {
      const auto i = static_cast<std::size_t>(at);
      const MovingBody& body = mechanism_.bodies[i];
      if (i != j) left[i] = -(body.prismatic ? load[i].linear[2] : load[i].angular[2]);
      if (body.parent >= 0) pass_up(i, body, {}, left[i], load);
      at = body.parent;
    }
    std::vector<T> out(n_, T(0.0));
    std::vector<Spatial<T>> acceleration(n_);
    for (std::size_t i = 0; i <= j; ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      Spatial<T> a{};
      if (body.parent >= 0) a = acceleration[static_cast<std::size_t>(body.parent)];
      for (const Step<T>& step : steps_[i]) a = motion_down(step, a);
      out[i] = (left[i] - dot(reach_[i].angular, a.angular) - dot(reach_[i].linear, a.linear)) * inverse_[i];
      T& along = body.prismatic ? a.linear[2] : a.angular[2];
      along = along + out[i];
      acceleration[i] = a;
    }
    return out;
  }

  /// Where a point of a body's frame is in the base's axes.
  Vec3<T> point(int body, const Vec3<T>& at) const {
    using namespace articulated;
    Vec3<T> p = at;
    for (int i = body; i >= 0; i = mechanism_.bodies[static_cast<std::size_t>(i)].parent) {
      const auto& steps = steps_[static_cast<std::size_t>(i)];
      for (std::size_t s = steps.size(); s-- > 0;) p = turned(steps[s].turn, p) + steps[s].shift;
    }
    return p;
  }
  /// A direction likewise.
  Vec3<T> direction(int body, const Vec3<T>& along) const {
    using namespace articulated;
    Vec3<T> d = along;
    for (int i = body; i >= 0; i = mechanism_.bodies[static_cast<std::size_t>(i)].parent) {
      const auto& steps = steps_[static_cast<std::size_t>(i)];
      for (std::size_t s = steps.size(); s-- > 0;) d = turned(steps[s].turn, d);
    }
    return d;
  }

  /// How the bodies move: about their origins and along, in their own axes.
  std::vector<articulated::Spatial<T>> velocities(const std::vector<T>& speed) const {
    using namespace articulated;
    std::vector<Spatial<T>> velocity(n_);
    for (std::size_t i = 0; i < n_; ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      Spatial<T> v = body.parent < 0 ? Spatial<T>{} : velocity[static_cast<std::size_t>(body.parent)];
      for (const Step<T>& step : steps_[i]) v = motion_down(step, v);
      T& along = body.prismatic ? v.linear[2] : v.angular[2];
      along = along + speed[i];
      velocity[i] = v;
    }
    return velocity;
  }

  using StepList = std::vector<articulated::Step<T>>;
  /// From the parent's frame to the body's, the joint standing at `position`.
  static StepList steps_of(const MovingBody& body, const T& position) {
    using namespace articulated;
    using std::cos;
    using std::sin;
    const JointFrame& f = body.frame;
    StepList steps;
    if (f.azimuth_rad != 0.0) steps.push_back({{}, constant_turn(2, f.azimuth_rad)});
    if (f.x_m != 0.0 || f.tilt_rad != 0.0) steps.push_back({{T(f.x_m), T(0.0), T(0.0)}, constant_turn(0, f.tilt_rad)});
    const T along = body.prismatic ? T(f.z_m) + position : T(f.z_m);
    Turn<T> turn = constant_turn(2, f.turn_rad);
    if (!body.prismatic) {
      // a quarter turn before the joint's own only changes the names of its sine and cosine
      const double quarters = f.turn_rad / (M_PI / 2);
      const double whole = std::round(quarters);
      const bool is_whole = std::fabs(quarters - whole) < 1e-13;
      const T angle = is_whole ? position : position + T(f.turn_rad);
      const T s = sin(angle), c = cos(angle);
      switch (is_whole ? (static_cast<int>(whole) + 4) % 4 : 0) {
        case 1: turn = {2, c, -s, false}; break;
        case 2: turn = {2, -s, -c, false}; break;
        case 3: turn = {2, -c, s, false}; break;
        default: turn = {2, s, c, false}; break;
      }
    }
    steps.push_back({{T(0.0), T(f.y_m), along}, turn});
    return steps;
  }

 private:
  /// A turn by a constant angle: quarter turns are exact.
  static articulated::Turn<T> constant_turn(int axis, double angle_rad) {
    if (angle_rad == 0.0) return {axis, T(0.0), T(1.0), true};
    return {axis, T(exact(std::sin(angle_rad))), T(exact(std::cos(angle_rad))), false};
  }
  static double exact(double value) {
    for (const double whole : {-1.0, 0.0, 1.0})
      if (std::fabs(value - whole) < 1e-15) return whole;
    return value;
  }

  /// The inertia that is felt through a joint that gives way; what the joint takes over is zero, not a difference.
  static articulated::Inertia<T> eliminated(const MovingBody& body, const articulated::Inertia<T>& a,
                                            const articulated::Spatial<T>& u, const T& inverse) {
    articulated::Inertia<T> rest;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) {
        const auto i = static_cast<std::size_t>(r), j = static_cast<std::size_t>(c);
        if (c >= r) rest.i(r, c) = a.i(r, c) - u.angular[i] * (u.angular[j] * inverse);
        if (c >= r) rest.m(r, c) = a.m(r, c) - u.linear[i] * (u.linear[j] * inverse);
        rest.h(r, c) = a.h(r, c) - u.angular[i] * (u.linear[j] * inverse);
      }
    articulated::mirror(rest.i);
    articulated::mirror(rest.m);
    if (body.armature > 0.0) return rest;
    for (int k = 0; k < 3; ++k) {
      if (body.prismatic)
        rest.m(2, k) = rest.m(k, 2) = rest.h(k, 2) = T(0.0);
      else
        rest.i(2, k) = rest.i(k, 2) = rest.h(2, k) = T(0.0);
    }
    return rest;
  }

  /// v x* I v of a rigid body: with k = w x v, the moment w x (I w) + h x k and the force m k + w x (w x h).
  static articulated::Spatial<T> gyroscopic(const BodyInertia<T>& b, const articulated::Spatial<T>& v) {
    const Vec3<T>& w = v.angular;
    const Vec3<T> k = cross(w, v.linear);
    return {cross(w, b.inertia * w) + cross(b.moment, k), scaled(b.mass, k) + cross(w, cross(w, b.moment))};
  }

  /// pA + Ia c + U u / D, felt by the parent.
  void pass_up(std::size_t i, const MovingBody& body, const articulated::Spatial<T>& bias, const T& left,
               std::vector<articulated::Spatial<T>>& load) {
    using namespace articulated;
    const Inertia<T>& a = articulated_[i];
    const Spatial<T>& u = reach_[i];
    // Ia c = IA c - U (U' c) / D
    const T share = (left - dot(u.angular, bias.angular) - dot(u.linear, bias.linear)) * inverse_[i];
    Spatial<T> felt{load[i].angular + a.i * bias.angular + a.h * bias.linear + scaled(share, u.angular),
                    load[i].linear + a.h.transposed() * bias.angular + a.m * bias.linear + scaled(share, u.linear)};
    // a joint without armature hands on the force that acts in it, and nothing else
    if (body.armature <= 0.0) (body.prismatic ? felt.linear[2] : felt.angular[2]) = force_[i];
    for (std::size_t s = steps_[i].size(); s-- > 0;) felt = force_up(steps_[i][s], felt);
    Spatial<T>& above = load[static_cast<std::size_t>(body.parent)];
    above = {above.angular + felt.angular, above.linear + felt.linear};
  }
  const Mechanism& mechanism_;
  std::vector<BodyInertia<T>> inertia_;
  const std::size_t n_;
  std::vector<StepList> steps_;
  std::vector<articulated::Inertia<T>> articulated_;
  std::vector<articulated::Spatial<T>> reach_;
  std::vector<T> inverse_;
  std::vector<T> force_;  // in the joints, of the present call
};

}  // namespace tiller::tools
