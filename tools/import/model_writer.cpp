#include "tools/import/model_writer.hpp"

#include <algorithm>
#include <map>

#include "tools/base/frame_names.hpp"
#include "tools/base/text.hpp"
#include "tools/import/articulated_body.hpp"
#include "tools/import/contact_law.hpp"
#include "tools/import/expression.hpp"
#include "tools/import/force_slopes.hpp"
#include "tools/import/model_text.hpp"

namespace tiller::tools {
namespace {

/// Distances are sqrt(d^2 + this^2), which has a slope where centres meet; 5 micrometres are added at 0.1 m.
constexpr double kSoftDistance_m = 0.001;

/// The equations' unknown quantities as symbols, and what follows from them for every body.
class Equations {
 public:
  Equations(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& names, int payload_frame)
      : mechanism_(mechanism), unknowns_(unknowns), names_(names), payload_frame_(payload_frame) {}

  /// Accelerations of the joints with states.
  std::vector<Expression> accelerations() {
    ArticulatedBody<Expression> tree(mechanism_, inertias());
    tree.place(positions());
    tree.weigh();
    std::vector<Expression> found = tree.accelerate(speeds(), forces(), base_acceleration());
    const std::vector<int> followers = mimicking();
    if (!followers.empty()) hold(tree, followers, found);
    std::vector<Expression> out;
    for (const int body : names_.bodies) out.push_back(found[at(body)]);
    return mechanism_.contacts.empty() ? out : contacts(out).acceleration;
  }

  /// Forces along normal and tangents of every place of contact, then the gaps.
  std::vector<Expression> contact_forces() {
    const std::vector<Expression> touching = accelerations();  // of the same graph: what is shared is one
    std::vector<Expression> out = answer_.force;
    out.insert(out.end(), answer_.gap.begin(), answer_.gap.end());
    return out;
  }

  /// (joints x joints), lower triangle: accelerations for unit forces.
  std::vector<std::vector<Expression>> responses() {
    ArticulatedBody<Expression> tree(mechanism_, inertias());
    tree.place(positions());
    tree.weigh();
    const std::vector<std::vector<Expression>> all = inverse_inertia(tree);
    const std::vector<int> followers = mimicking();
    const std::size_t n = names_.bodies.size();
    std::vector<std::vector<Expression>> out(n, std::vector<Expression>(n));
    const Holding holding = hold_matrix(all, followers);
    for (std::size_t r = 0; r < n; ++r)
      for (std::size_t c = 0; c <= r; ++c) {
        Expression w = all[at(names_.bodies[r])][at(names_.bodies[c])];
        if (!followers.empty()) {
          std::vector<Expression> pull;
          for (std::size_t k = 0; k < followers.size(); ++k) pull.push_back(holding.reach[k][at(names_.bodies[c])]);
          const std::vector<Expression> force = solve(holding.matrix, pull);
          for (std::size_t k = 0; k < followers.size(); ++k) w -= holding.reach[k][at(names_.bodies[r])] * force[k];
        }
        out[r][c] = w;
      }
    return out;
  }

  /// Accelerations (joints), the inverse inertia's lower triangle, and the slopes of the joints' forces at these
  /// accelerations, (joints x joints) by positions, then by speeds; row: force. Of a robot whose joints follow no
  /// others.
  std::vector<Expression> slopes() {
    const std::size_t n = mechanism_.bodies.size();
    const std::vector<BodyInertia<Expression>> inertia = inertias();
    ArticulatedBody<Expression> tree(mechanism_, inertia);
    tree.place(positions());
    tree.weigh();
    const std::vector<Expression> found = tree.accelerate(speeds(), forces(), base_acceleration());
    std::vector<Expression> out = found;
    const std::vector<std::vector<Expression>> inverse = inverse_inertia(tree);
    for (std::size_t r = 0; r < n; ++r)
      out.insert(out.end(), inverse[r].begin(), inverse[r].begin() + std::ptrdiff_t(r + 1));
    const ForceSlopes<Expression> by =
        SlopeRecursion<Expression>(mechanism_, inertia).slopes(positions(), speeds(), found, base_acceleration());
    for (const auto* matrix : {&by.by_position, &by.by_speed})
      for (const std::vector<Expression>& row : *matrix) out.insert(out.end(), row.begin(), row.end());
    return out;
  }

  /// Where frames stand in the base's axes: origin, then rotation row by row.
  std::vector<Expression> poses(const std::vector<int>& frames) {
    ArticulatedBody<Expression> tree(mechanism_, {});
    tree.place(positions());
    std::vector<Expression> out;
    for (const int index : frames) {
      const NamedFrame& frame = mechanism_.frames[at(index)];
      const Vec3<double>& p = frame.pose.position;
      for (const Expression& value : tree.point(frame.body, {p[0], p[1], p[2]})) out.push_back(value);
      Vec3<Expression> axis[3];
      for (int c = 0; c < 3; ++c)
        axis[c] = tree.direction(frame.body,
                                 {frame.pose.rotation(0, c), frame.pose.rotation(1, c), frame.pose.rotation(2, c)});
      for (std::size_t r = 0; r < 3; ++r)
        for (const Vec3<Expression>& a : axis) out.push_back(a[r]);
    }
    return out;
  }

  /// Squares of the distances of centres, and heights.
  std::vector<Expression> distances(const SphereOutputs& spheres) {
    ArticulatedBody<Expression> tree(mechanism_, {});
    tree.place(positions());
    std::vector<Vec3<Expression>> centres;
    for (const PlacedSphere& s : spheres.placed) centres.push_back(tree.point(s.body, {s.at[0], s.at[1], s.at[2]}));
    std::vector<Expression> out;
    for (const SphereOutput& output : spheres.outputs) {
      const Vec3<Expression>& a = centres[at(output.a)];
      if (output.b < 0) {
        out.push_back(a[2]);
        continue;
      }
      const Vec3<Expression> apart = a - centres[at(output.b)];
      out.push_back(dot(apart, apart));
    }
    return out;
  }

  /// Turning and moving of points, of which three values each.
  std::vector<Expression> motions(const std::vector<MotionOutput>& points) {
    ArticulatedBody<Expression> tree(mechanism_, {});
    tree.place(positions());
    const auto velocity = tree.velocities(speeds());
    std::vector<Expression> out;
    for (const MotionOutput& point : points) {
      const articulated::Spatial<Expression>& v = velocity[at(point.body)];
      const Vec3<double>& p = point.pose.position;
      const Mat3<double>& r = point.pose.rotation;
      const Vec3<Expression> along =
          point.kind == MotionOutput::Kind::moving
              ? v.linear + cross(v.angular, Vec3<Expression>{Expression(p[0]), Expression(p[1]), Expression(p[2])})
              : v.angular;
      const Vec3<Expression> in_base =
          point.kind == MotionOutput::Kind::turning_in_base ? tree.direction(point.body, along) : Vec3<Expression>{};
      for (int k = 0; k < 3; ++k)
        out.push_back(
            point.kind == MotionOutput::Kind::turning_in_base
                ? in_base[at(k)]
                : dot(Vec3<Expression>{Expression(r(0, k)), Expression(r(1, k)), Expression(r(2, k))}, along));
    }
    return out;
  }

  ExpressionGraph graph;

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  /// Gravity as an acceleration of the base.
  Vec3<Expression> base_acceleration() {
    return {-graph.symbol("body.gravity_x_m_s2"), 0.0, -graph.symbol("body.gravity_z_m_s2")};
  }

  Expression parameter(ModelParameter::Kind kind, const std::string& about, int slot, const Expression& otherwise) {
    for (const ModelParameter& p : unknowns_.parameters)
      if (p.kind == kind && p.about == about && p.slot == slot) return graph.symbol("p." + p.name);
    return otherwise;
  }
  bool is_unknown(ModelParameter::Kind kind, const std::string& about) const {
    return std::any_of(unknowns_.parameters.begin(), unknowns_.parameters.end(),
                       [&](const ModelParameter& p) { return p.kind == kind && p.about == about; });
  }

  /// The place among the joints with states of a body's own joint, or of the one it follows.
  std::size_t joint_of(std::size_t body) const {
    const int leader = mechanism_.bodies[body].mimics;
    const int wanted = leader < 0 ? static_cast<int>(body) : leader;
    return static_cast<std::size_t>(std::find(names_.bodies.begin(), names_.bodies.end(), wanted) -
                                    names_.bodies.begin());
  }
  std::vector<Expression> positions() {
    std::vector<Expression> out;
    for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i) {
      const MovingBody& b = mechanism_.bodies[i];
      const Expression q = graph.symbol("x." + names_.positions[joint_of(i)]);
      out.push_back(b.mimics < 0 ? q : Expression(b.mimic_ratio) * q + Expression(b.mimic_offset));
    }
    return out;
  }
  std::vector<Expression> speeds() {
    std::vector<Expression> out;
    for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i) {
      const MovingBody& b = mechanism_.bodies[i];
      const Expression v = graph.symbol("x." + names_.velocities[joint_of(i)]);
      out.push_back(b.mimics < 0 ? v : Expression(b.mimic_ratio) * v);
    }
    return out;
  }
  std::vector<Expression> forces() {
    const std::vector<Expression> speed = speeds();
    std::vector<Expression> out;
    for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i) {
      const MovingBody& b = mechanism_.bodies[i];
      Expression force;
      if (b.mimics < 0) {
        const std::size_t j = joint_of(i);
        force = graph.symbol("f." + names_.forces[j]);
        if (names_.input_of[j] >= 0)
          force += parameter(ModelParameter::Kind::gain, b.joint, 0, 1.0) *
                   graph.symbol("u." + names_.inputs[at(names_.input_of[j])]);
      }
      // a follower has no joint of its own that an effect could act at
      if (b.mimics >= 0) force -= Expression(b.damping) * speed[i];
      out.push_back(force);
    }
    return out;
  }

  // ---- inertias ----

  /// About the body's origin, of a mass, its first moment and its second moment about the centre `c` of before.
  static BodyInertia<Expression> about_origin(const Expression& mass, const Vec3<Expression>& first,
                                              const Mat3<Expression>& second, const Vec3<double>& c) {
    // second moment about the origin: S + h c' + c h' + m c c', with h about c
    Mat3<Expression> s = second;
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 3; ++k)
        s(r, k) = s(r, k) + first[at(r)] * Expression(c[at(k)]) + Expression(c[at(r)]) * first[at(k)] +
                  mass * Expression(c[at(r)] * c[at(k)]);
    BodyInertia<Expression> b;
    b.mass = mass;
    for (int k = 0; k < 3; ++k) b.moment[at(k)] = first[at(k)] + mass * Expression(c[at(k)]);
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 3; ++k) {
        if (r == k)
          b.inertia(r, k) = s((r + 1) % 3, (r + 1) % 3) + s((r + 2) % 3, (r + 2) % 3);
        else
          b.inertia(r, k) = -s(r, k);
      }
    return b;
  }

  BodyInertia<Expression> known(const RigidBody& b, const Expression& scale) const {
    const RigidBody origin = together(b, {});
    BodyInertia<Expression> out;
    out.mass = scale * Expression(b.mass_kg);
    for (std::size_t k = 0; k < 3; ++k) out.moment[k] = scale * Expression(b.mass_kg * b.com_m[k]);
    const double square = dot(b.com_m, b.com_m);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c)
        out.inertia(r, c) = scale * Expression(origin.inertia_kgm2(r, c) +
                                               b.mass_kg * ((r == c ? square : 0.0) - b.com_m[at(r)] * b.com_m[at(c)]));
    return out;
  }

  /// An inertia of log-Cholesky coordinates, which is that of some distribution of mass whatever they are.
  BodyInertia<Expression> deformed(const LinkShare& share) {
    using Kind = ModelParameter::Kind;
    const auto p = [&](int slot) { return parameter(Kind::inertia, share.link, slot, 0.0); };
    const Expression size = exp(p(0) + p(0));
    Mat3<Expression> b;
    for (int k = 0; k < 3; ++k) b(k, k) = exp(p(1 + k));
    b(0, 1) = p(4), b(1, 2) = p(5), b(0, 2) = p(6);
    const Vec3<Expression> shift{p(7), p(8), p(9)};
    Mat3<Expression> second;
    const Mat3<double>& inertia = share.body.inertia_kgm2;
    const double half = 0.5 * (inertia(0, 0) + inertia(1, 1) + inertia(2, 2));
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) second(r, c) = (r == c ? half : 0.0) - inertia(r, c);
    Mat3<Expression> moved = b * second * b.transposed();
    const Expression mass(share.body.mass_kg);
    Vec3<Expression> first;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) moved(r, c) = size * (moved(r, c) + mass * shift[at(r)] * shift[at(c)]);
      first[at(r)] = size * mass * shift[at(r)];
    }
    return about_origin(size * mass, first, moved, share.body.com_m);
  }

  /// What a body that turns about its z can give to its parent without changing any motion: its mass as if it stood on
  /// the axis, and as much inertia about x as about y (Gautier and Khalil's regrouping, 1990). The rest has neither
  /// mass nor inertia about y, so that much of the recursion vanishes. What the base gets moves nothing.
  void hand_down(std::vector<BodyInertia<Expression>>& bodies) const {
    using namespace articulated;
    for (std::size_t i = bodies.size(); i-- > 0;) {
      const MovingBody& body = mechanism_.bodies[i];
      if (body.prismatic) continue;
      BodyInertia<Expression>& b = bodies[i];
      Inertia<Expression> given;
      for (int k = 0; k < 3; ++k) given.m(k, k) = b.mass;
      given.h = skew(Vec3<Expression>{0.0, 0.0, b.moment[2]});
      given.i(0, 0) = given.i(1, 1) = b.inertia(1, 1);
      b.inertia(0, 0) -= b.inertia(1, 1);
      b.inertia(1, 1) = b.moment[2] = b.mass = 0.0;
      if (body.parent < 0) continue;
      const auto steps = ArticulatedBody<Expression>::steps_of(body, 0.0);
      for (std::size_t s = steps.size(); s-- > 0;) given = inertia_up(steps[s], given);
      BodyInertia<Expression>& above = bodies[at(body.parent)];
      above.mass += given.m(0, 0);
      above.moment = above.moment + Vec3<Expression>{given.h(2, 1), given.h(0, 2), given.h(1, 0)};
      above.inertia = above.inertia + given.i;
    }
  }

  std::vector<BodyInertia<Expression>> inertias() {
    std::vector<BodyInertia<Expression>> out(mechanism_.bodies.size());
    const auto add = [](BodyInertia<Expression>& to, const BodyInertia<Expression>& b) {
      to.mass += b.mass;
      to.moment = to.moment + b.moment;
      to.inertia = to.inertia + b.inertia;
    };
    for (std::size_t i = 0; i < out.size(); ++i) {
      RigidBody rest;
      for (const LinkShare& share : mechanism_.bodies[i].links) {
        if (is_unknown(ModelParameter::Kind::inertia, share.link))
          add(out[i], deformed(share));
        else if (is_unknown(ModelParameter::Kind::mass, share.link))
          add(out[i], known(share.body, parameter(ModelParameter::Kind::mass, share.link, 0, 0.0) /
                                            Expression(share.body.mass_kg)));
        else
          rest = together(rest, share.body);
      }
      add(out[i], known(rest, 1.0));
    }
    if (payload_frame_ >= 0) {
      const NamedFrame& frame = mechanism_.frames[at(payload_frame_)];
      if (frame.body >= 0) {
        Mat3<Expression> second;  // an inertia J about every axis is second moments of J / 2
        for (int k = 0; k < 3; ++k) second(k, k) = Expression(0.5) * graph.symbol("body.payload_kgm2");
        add(out[at(frame.body)], about_origin(graph.symbol("body.payload_kg"), {}, second, frame.pose.position));
      }
    }
    hand_down(out);
    return out;
  }

  // ---- contacts ----

  /// What the contacts make of the accelerations without them.
  const ContactAnswer& contacts(const std::vector<Expression>& free) {
    std::vector<std::vector<Expression>> inverse = responses();
    for (std::size_t r = 0; r < inverse.size(); ++r)
      for (std::size_t c = r + 1; c < inverse.size(); ++c) inverse[r][c] = inverse[c][r];
    ArticulatedBody<Expression> tree(mechanism_, {});
    tree.place(positions());
    const std::vector<Expression> speed = speeds();
    const BodyMotions<Expression> motions(mechanism_, tree, speed);
    std::vector<ContactTerms> terms;
    std::vector<ContactRows<Expression>> rows;
    for (const ContactPair& pair : mechanism_.contacts) {
      using Kind = ModelParameter::Kind;
      terms.push_back({parameter(Kind::contact, pair.name, 0, pair.law.friction),
                       parameter(Kind::contact, pair.name, 1, pair.law.settle_s),
                       parameter(Kind::contact, pair.name, 2, pair.law.damping_ratio)});
      for (const ContactPoint& place : pair.points) rows.push_back(of_joints(motions.rows(place)));
    }
    answer_ = answer_contacts(mechanism_.contacts, terms, rows, inverse, free);
    return answer_;
  }

  /// What follows a joint goes along with it.
  ContactRows<Expression> of_joints(ContactRows<Expression> rows) const {
    for (std::vector<Expression>& reach : rows.reach) {
      std::vector<Expression> joints(names_.bodies.size());
      for (std::size_t i = 0; i < reach.size(); ++i) {
        const MovingBody& b = mechanism_.bodies[i];
        joints[joint_of(i)] += b.mimics < 0 ? reach[i] : Expression(b.mimic_ratio) * reach[i];
      }
      reach = joints;
    }
    return rows;
  }

  // ---- joints that follow others ----

  std::vector<int> mimicking() const {
    std::vector<int> out;
    for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i)
      if (mechanism_.bodies[i].mimics >= 0) out.push_back(static_cast<int>(i));
    return out;
  }

  std::vector<std::vector<Expression>> inverse_inertia(ArticulatedBody<Expression>& tree) const {
    const std::size_t n = mechanism_.bodies.size();
    std::vector<std::vector<Expression>> all(n, std::vector<Expression>(n));
    for (std::size_t j = 0; j < n; ++j) {
      const std::vector<Expression> column = tree.respond(j);
      for (std::size_t i = 0; i <= j; ++i) all[i][j] = all[j][i] = column[i];
    }
    return all;
  }

  /// A force that holds follower m to its leader: 1 at m, minus the ratio at the leader.
  struct Holding {
    std::vector<std::vector<Expression>> reach;   // (followers x bodies) accelerations for each such force
    std::vector<std::vector<Expression>> matrix;  // (followers x followers) how far they part for each
  };
  Holding hold_matrix(const std::vector<std::vector<Expression>>& all, const std::vector<int>& followers) const {
    Holding h;
    const std::size_t n = mechanism_.bodies.size();
    for (const int m : followers) {
      const MovingBody& b = mechanism_.bodies[at(m)];
      std::vector<Expression> row(n);
      for (std::size_t i = 0; i < n; ++i) row[i] = all[i][at(m)] - Expression(b.mimic_ratio) * all[i][at(b.mimics)];
      h.reach.push_back(row);
    }
    for (std::size_t r = 0; r < followers.size(); ++r) {
      std::vector<Expression> row;
      for (std::size_t c = 0; c < followers.size(); ++c) row.push_back(parting(h.reach[c], followers[r]));
      h.matrix.push_back(row);
    }
    return h;
  }
  Expression parting(const std::vector<Expression>& acceleration, int follower) const {
    const MovingBody& b = mechanism_.bodies[at(follower)];
    return acceleration[at(follower)] - Expression(b.mimic_ratio) * acceleration[at(b.mimics)];
  }
  void hold(ArticulatedBody<Expression>& tree, const std::vector<int>& followers, std::vector<Expression>& found) {
    const Holding h = hold_matrix(inverse_inertia(tree), followers);
    std::vector<Expression> apart;
    apart.reserve(followers.size());
    for (const int m : followers) apart.push_back(parting(found, m));
    const std::vector<Expression> force = solve(h.matrix, apart);
    for (std::size_t i = 0; i < found.size(); ++i)
      for (std::size_t k = 0; k < followers.size(); ++k) found[i] -= h.reach[k][i] * force[k];
  }
  /// A symmetric positive system by elimination without pivots.
  static std::vector<Expression> solve(std::vector<std::vector<Expression>> a, std::vector<Expression> b) {
    const std::size_t n = b.size();
    for (std::size_t k = 0; k < n; ++k) {
      const Expression inverse = Expression(1.0) / a[k][k];
      for (std::size_t r = k + 1; r < n; ++r) {
        const Expression factor = a[r][k] * inverse;
        for (std::size_t c = k; c < n; ++c) a[r][c] -= factor * a[k][c];
        b[r] -= factor * b[k];
      }
    }
    for (std::size_t k = n; k-- > 0;) {
      for (std::size_t c = k + 1; c < n; ++c) b[k] -= a[k][c] * b[c];
      b[k] = b[k] / a[k][k];
    }
    return b;
  }

  const Mechanism& mechanism_;
  const Unknowns& unknowns_;
  const ModelNames& names_;
  const int payload_frame_;
  ContactAnswer answer_;
};

std::string entry(const char* matrix, std::size_t row, std::size_t column) {
  return std::string(matrix) + "[" + std::to_string(row) + "][" + std::to_string(column) + "]";
}
/// Where the entries of the inverse inertia's lower triangle go, and their images.
std::vector<std::string> lower_entries(std::size_t joints) {
  std::vector<std::string> targets;
  for (std::size_t r = 0; r < joints; ++r)
    for (std::size_t c = 0; c <= r; ++c)
      targets.push_back(r == c ? entry("column", r, c) : entry("column", c, r) + " = " + entry("column", r, c));
  return targets;
}

/// The body of `slopes`.
std::string slopes_text(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& n, int payload_frame,
                        int& operations) {
  const std::size_t joints = n.joints.size();
  std::vector<std::string> targets;
  for (std::size_t j = 0; j < joints; ++j) targets.push_back("acceleration[" + std::to_string(j) + "]");
  for (const std::string& place : lower_entries(joints)) targets.push_back(place);
  for (const char* matrix : {"by_position", "by_speed"})
    for (std::size_t r = 0; r < joints; ++r)
      for (std::size_t c = 0; c < joints; ++c) targets.push_back(entry(matrix, r, c));
  Equations equations(mechanism, unknowns, n, payload_frame);
  std::string text = emit_assignments(equations.graph, equations.slopes(), targets, "    ", &operations);
  for (std::size_t j = 0; j < joints; ++j) {
    std::string gain = n.input_of[j] < 0 ? "0.0" : "1.0";
    for (const ModelParameter& p : unknowns.parameters)
      if (p.kind == ModelParameter::Kind::gain &&
          p.about == mechanism.bodies[static_cast<std::size_t>(n.bodies[j])].joint)
        gain = "p." + p.name;
    text += "    input_gain[" + std::to_string(j) + "] = S(" + gain + ");\n";
  }
  return text;
}

}  // namespace

ModelNames name_model(const Mechanism& mechanism) {
  ModelNames names;
  names.type = type_name(mechanism.name);
  names.bodies = mechanism.free_joints();
  std::map<std::string, int> taken;
  for (const int index : names.bodies) {
    const MovingBody& body = mechanism.bodies[static_cast<std::size_t>(index)];
    std::string name = identifier(body.joint);
    if (const int before = taken[name]++; before > 0) name += "_" + std::to_string(before + 1);
    names.joints.push_back(name);
    names.positions.push_back(name + (body.prismatic ? "_m" : "_rad"));
    names.velocities.push_back(name + (body.prismatic ? "_m_s" : "_rad_s"));
    names.forces.push_back(name + (body.prismatic ? "_N" : "_Nm"));
    names.input_of.push_back(body.actuated ? static_cast<int>(names.inputs.size()) : -1);
    if (body.actuated) names.inputs.push_back(names.forces.back());
  }
  return names;
}

namespace {

// What every function of the text is written from.
struct Source {
  const Mechanism& mechanism;
  const Unknowns& unknowns;
  const ModelNames& n;
  int payload_frame;

  Equations equations() const { return {mechanism, unknowns, n, payload_frame}; }
  std::size_t joints() const { return n.joints.size(); }
  bool has_params() const { return !unknowns.parameters.empty(); }
};

std::string using_text(const ExpressionGraph& graph, const std::vector<Expression>& outputs) {
  std::string text = "    using tiller::sincos;\n";
  for (const std::string& name : called_functions(graph, outputs))
    if (name != "sin" && name != "cos" && name != "sincos") text += "    using tiller::" + name + ";\n";
  return text;
}

std::string dynamics_text(const Source& s, int& operations) {
  Equations dynamics = s.equations();
  std::vector<std::string> values;
  const std::vector<Expression> accelerations = dynamics.accelerations();
  const std::string code = emit_code(dynamics.graph, accelerations, "    ", values, &operations);
  std::vector<std::string> derivatives;
  for (const std::string& v : s.n.velocities) derivatives.push_back("x." + v);
  derivatives.insert(derivatives.end(), values.begin(), values.end());
  return "  // one text for all who call it: these equations are long, and a call costs nothing beside them\n"
         "  __attribute__((noinline)) static State dynamics(const State& x, [[maybe_unused]] const Input& u, const Force& f,\n"
         "                        [[maybe_unused]] const tiller::Body<S>& body" +
         std::string(s.has_params() ? ", const Params& p" : "") + ") {\n" + using_text(dynamics.graph, accelerations) +
         code + "    return {" + listed(derivatives, "            ") + "};\n  }\n\n";
}

/// For tests, plots and whoever wants to know: no other function calls it.
std::string contact_forces_text(const Source& s) {
  if (s.mechanism.contacts.empty()) return "";
  Equations equations = s.equations();
  std::vector<std::string> values;
  const std::vector<Expression> told = equations.contact_forces();
  const std::string code = emit_code(equations.graph, told, "    ", values);
  Words places;
  for (const ContactPair& pair : s.mechanism.contacts)
    for (std::size_t k = 0; k < pair.points.size(); ++k)
      places.push_back("\"" + pair.spelled + (pair.points.size() > 1 ? "/" + std::to_string(k + 1) : "") + "\"");
  const std::string count = std::to_string(places.size());
  std::string text =
      "  static constexpr const char* contacts[] = {" + join(places) +
      "};\n  /// Forces on the first of each pair, along the normal and two tangents, and how far apart the two are.\n"
      "  static void contact_forces(const State& x, [[maybe_unused]] const Input& u, const Force& f,\n"
      "                             [[maybe_unused]] const tiller::Body<S>& body, const Params& p, S (*force)[3],\n"
      "                             S* gap) {\n" +
      using_text(equations.graph, told) + code;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::string at = "[" + std::to_string(i) + "]";
    for (std::size_t k = 0; k < 3; ++k)
      text += "    force" + at + "[" + std::to_string(k) + "] = " + values[3 * i + k] + ";\n";
    text += "    gap" + at + " = " + values[3 * places.size() + i] + ";\n";
  }
  return text + "  }\n\n";
}

std::string responses_text(const Source& s, int& operations) {
  Equations inverse = s.equations();
  const std::size_t joints = s.joints();
  std::vector<Expression> entries;
  for (const std::vector<Expression>& row : inverse.responses())
    for (std::size_t c = 0; c < joints && entries.size() < joints * joints; ++c) entries.push_back(row[c]);
  std::vector<Expression> lower;
  for (std::size_t r = 0; r < joints; ++r)
    for (std::size_t c = 0; c <= r; ++c) lower.push_back(entries[r * joints + c]);
  const std::string code = emit_assignments(inverse.graph, lower, lower_entries(joints), "    ", &operations);
  return "  /// The inverse inertia: " + std::to_string(operations) +
         " operations.\n"
         "  static void responses([[maybe_unused]] const State& x, [[maybe_unused]] const tiller::Body<S>& body,\n"
         "                        " +
         (s.has_params() ? "[[maybe_unused]] const Params& p, " : std::string()) + "S (*column)[" +
         std::to_string(joints) + "]) {\n    using tiller::sincos;\n" + code + "  }\n";
}

std::string slopes_function_text(const Source& s, const WrittenModel& out, const std::string& code) {
  const std::string joints = std::to_string(s.joints());
  return "\n  /// Accelerations of the joints with what they follow from: the inverse inertia (column), and the slopes of the\n"
         "  /// joints' forces by positions and speeds at these accelerations. " +
         std::to_string(out.slope_operations) +
         " operations.\n"
         "  __attribute__((noinline)) static void slopes(const State& x, [[maybe_unused]] const Input& u, const Force& f,\n"
         "                     const tiller::Body<S>& body" +
         std::string(s.has_params() ? ", const Params& p" : "") + ", S* acceleration, S (*column)[" + joints +
         "],\n                     S (*by_position)[" + joints + "], S (*by_speed)[" + joints +
         "], S* input_gain) {\n    using tiller::sincos;\n" + code + "  }\n";
}

// Poses of frames, distances of spheres and motions of points; nothing where there are none.
std::string outputs_text(const Source& s, const std::vector<int>& told, const SphereOutputs& spheres,
                         const std::vector<MotionOutput>& motions, int& operations) {
  std::vector<std::string> outputs, values;
  for (const int frame : told)
    for (const std::string& name :
         frame_output_names(identifier(s.mechanism.frames[static_cast<std::size_t>(frame)].name)))
      outputs.push_back(name);
  const std::size_t first_distance = outputs.size();
  for (const SphereOutput& output : spheres.outputs) outputs.push_back(output.name);
  for (const MotionOutput& motion : motions) outputs.insert(outputs.end(), motion.names.begin(), motion.names.end());
  if (outputs.empty()) return "";
  Equations kinematics = s.equations();
  std::vector<Expression> told_of = kinematics.poses(told);
  for (const Expression& distance : kinematics.distances(spheres)) told_of.push_back(distance);
  for (const Expression& along : kinematics.motions(motions)) told_of.push_back(along);
  const std::string code = emit_code(kinematics.graph, told_of, "    ", values, &operations);
  for (std::size_t i = 0; i < spheres.outputs.size(); ++i)
    if (spheres.outputs[i].b >= 0) {
      std::string& value = values[first_distance + i];
      value = "sqrt(" + value + " + S(" + number_text(kSoftDistance_m * kSoftDistance_m) + "))";
      operations += 2;
    }
  return "\n" + fields_text("Output", outputs) + "\n  /// Poses of frames in the base's axes" +
         (spheres.outputs.empty() ? std::string() : ", distances of spheres' centres") +
         (motions.empty() ? "" : ", what gyroscopes and the like read") + ": " + std::to_string(operations) +
         " operations.\n  static Output outputs([[maybe_unused]] const State& x" +
         (s.has_params() ? ", [[maybe_unused]] const Params& p" : std::string()) + ") {\n    using tiller::sincos;\n" +
         (spheres.outputs.empty() ? "" : "    using tiller::sqrt;\n") + code + "    return {" +
         listed(values, "            ") + "};\n  }\n";
}

// Up to the first function: names of states, inputs, parameters and forces, the table of joints.
std::string fields_and_joints(const Source& s, int operations) {
  const ModelNames& n = s.n;
  const Mechanism& mechanism = s.mechanism;
  std::vector<std::string> params, states = n.positions;
  for (const ModelParameter& p : s.unknowns.parameters) params.push_back(p.name);
  states.insert(states.end(), n.velocities.begin(), n.velocities.end());
  std::string text = "#pragma once\n\n#include \"tiller/model.hpp\"\n\n";
  text += "/// " + mechanism.name + ", from " + mechanism.path.substr(mechanism.path.find_last_of('/') + 1) +
          " by `tiller import`, which writes it anew: forward dynamics of the tree by the\n"
          "/// articulated-body algorithm (Featherstone 2008), unrolled: " +
          std::to_string(operations) + " operations. ";
  text += s.payload_frame >= 0
              ? "The payload hangs at frame " + mechanism.frames[static_cast<std::size_t>(s.payload_frame)].name + ".\n"
              : "\n";
  text += "template <class S>\nstruct " + n.type + " {\n  static constexpr const char* name = \"" +
          identifier(mechanism.name) + "\";\n";
  text += fields_text("State", states) + fields_text("Input", n.inputs);
  if (s.has_params()) text += fields_text("Params", params);
  text += fields_text("Force", n.forces);
  text += "  static constexpr tiller_joint_t joints[] = {  // position, velocity, force, 1 + input\n";
  unsigned angles = 0;
  for (std::size_t j = 0; j < s.joints(); ++j) {
    text += "      {\"" + n.joints[j] + "\", " + std::to_string(j) + ", " + std::to_string(s.joints() + j) + ", " +
            std::to_string(j) + ", " + std::to_string(n.input_of[j] + 1) + "},\n";
    if (mechanism.bodies[static_cast<std::size_t>(n.bodies[j])].wraps) angles |= 1u << j;
  }
  text += "  };\n";
  if (angles != 0) text += "  static constexpr unsigned angles = " + format("0x%xu", angles) + ";\n";
  return text + "  static constexpr bool long_dynamics = true;\n\n";
}

}  // namespace

WrittenModel write_model(const Mechanism& mechanism, const Unknowns& unknowns, int payload_frame,
                         const std::vector<int>& told, const SphereOutputs& spheres,
                         const std::vector<MotionOutput>& motions) {
  WrittenModel out;
  out.names = name_model(mechanism);
  const Source source{mechanism, unknowns, out.names, payload_frame};
  const std::string dynamics = dynamics_text(source, out.operations);
  out.text = fields_and_joints(source, out.operations) + dynamics + contact_forces_text(source) +
             responses_text(source, out.response_operations);
  const bool has_slopes = mechanism.contacts.empty() && std::none_of(mechanism.bodies.begin(), mechanism.bodies.end(),
                                                                     [](const MovingBody& b) { return b.mimics >= 0; });
  if (has_slopes) {
    const std::string code = slopes_text(mechanism, unknowns, out.names, payload_frame, out.slope_operations);
    out.text += slopes_function_text(source, out, code);
  }
  out.text += outputs_text(source, told, spheres, motions, out.output_operations) + "};\n";
  return out;
}

}  // namespace tiller::tools
