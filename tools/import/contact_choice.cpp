#include "tools/import/contact_choice.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/import/contact_rows.hpp"
#include "tools/import/unknowns.hpp"

namespace tiller::tools {
namespace {

/// Places of all pairs: their equations are solved together, and grow with the square.
constexpr std::size_t kMostPlaces = 8;
/// Corners of maximum and clamp are as wide as this share of the weight that a place feels.
constexpr double kCornerShare = 0.02;
constexpr double kGravity_m_s2 = 9.81;
/// What a ground that the file does not have is taken for.
const char* const kGround = "plane";

/// A shape on a body of the mechanism.
struct Placed {
  const ShapeText* shape = nullptr;
  int body = -1;
  Pose pose;    // in the body's frame
  Pose stands;  // in the base's axes, where the robot starts
};

Pose face_pose(const Pose& shape, int axis, double sign, double at) {
  Pose face;
  const auto k = static_cast<std::size_t>(axis);
  Vec3<double> z{}, x{};
  z[k] = sign;
  x[(k + 1) % 3] = 1.0;
  const Vec3<double> y = cross(z, x);
  for (int r = 0; r < 3; ++r) {
    const auto i = static_cast<std::size_t>(r);
    face.rotation(r, 0) = x[i];
    face.rotation(r, 1) = y[i];
    face.rotation(r, 2) = z[i];
  }
  face.position = scaled(at, z);
  return shape * face;
}

/// The face of a box that looks at a point or along a direction.
struct Face {
  int axis = 0;
  double sign = 1.0;
};
Face face_towards(const Placed& box, const Vec3<double>& point) {
  const Vec3<double> p = inverse(box.stands).rotation * (point - box.stands.position);
  Face best;
  double most = -INFINITY;
  for (std::size_t k = 0; k < 3; ++k)
    if (const double out = std::fabs(p[k]) - box.shape->size[k]; out > most) {
      most = out;
      best = {static_cast<int>(k), p[k] < 0.0 ? -1.0 : 1.0};
    }
  return best;
}
Face face_along(const Placed& box, const Vec3<double>& direction) {
  const Vec3<double> d = inverse(box.stands).rotation * direction;
  Face best;
  for (std::size_t k = 0; k < 3; ++k)
    if (std::fabs(d[k]) > std::fabs(d[static_cast<std::size_t>(best.axis)]) + 1e-9) best.axis = static_cast<int>(k);
  best.sign = d[static_cast<std::size_t>(best.axis)] < 0.0 ? -1.0 : 1.0;
  return best;
}
double half(const Placed& box, const Face& face, int next) {
  return box.shape->size[static_cast<std::size_t>((face.axis + next) % 3)];
}
double area(const Placed& box, const Face& face) { return half(box, face, 1) * half(box, face, 2); }

class Chooser {
 public:
  Chooser(const Description& robot, Mechanism& mechanism, std::vector<std::string>& errors)
      : robot_(robot), mechanism_(mechanism), errors_(errors), tree_(mechanism, {}) {
    tree_.place(start_position(mechanism));
    ground_.name = kGround;
    ground_.type = "plane";
  }

  void choose(const std::vector<std::string>& words) {
    for (const std::string& word : words) add(word);
    std::size_t places = 0;
    for (const ContactPair& pair : mechanism_.contacts) places += pair.points.size();
    if (places > kMostPlaces)
      errors_.push_back("--contact: " + std::to_string(places) + " places of contact where a model may have " +
                        std::to_string(kMostPlaces) +
                        " (a sphere has 1, a capsule 2, a box 4); name fewer, or put spheres in place of boxes");
  }

 private:
  void fail(const std::string& word, const std::string& text) { errors_.push_back("--contact " + word + ": " + text); }

  void add(const std::string& word) {
    const std::size_t colon = word.find(':');
    if (colon == std::string::npos || colon == 0 || colon + 1 == word.size())
      return fail(word, "write GEOM:plane or GEOM:GEOM2");
    Placed a, b;
    if (!find(word, word.substr(0, colon), a) || !find(word, word.substr(colon + 1), b)) return;
    for (const auto& [one, other] : taken_)
      if ((one == a.shape && other == b.shape) || (one == b.shape && other == a.shape))
        return fail(word, "these two geoms are named twice");
    taken_.emplace_back(a.shape, b.shape);
    ContactPair pair;
    pair.spelled = word;
    pair.name = name_of(word.substr(0, colon), word.substr(colon + 1));
    if (!take_law(word, *a.shape, *b.shape, pair)) return;
    if (a.body == b.body)
      return fail(word, "both are on one body ('" + a.shape->link + "' and '" + b.shape->link +
                            "'), so that nothing moves between them");
    const std::string& kind_a = a.shape->type;
    if (kind_a == "plane" || (kind_a == "box" && b.shape->type != "plane" && b.shape->type != "box")) std::swap(a, b);
    if (b.shape->type == "plane" && b.body >= 0)
      return fail(word, "plane '" + b.shape->name + "' is on '" + b.shape->link +
                            "', which moves; only a plane that stands on the world can be touched");
    if (!place(a, b, pair)) {
      const auto told = [](const Placed& p) { return "'" + p.shape->name + "' is a " + p.shape->type; };
      return fail(word, told(a) + ", " + told(b) +
                            "; contacts are between a sphere, capsule or box and a plane or box, or two spheres: put a "
                            "small sphere or box where they touch, and name it");
    }
    soften(pair);
    mechanism_.contacts.push_back(pair);
  }

  std::string name_of(const std::string& a, const std::string& b) const {
    const auto taken = [this](const std::string& name) {
      return std::any_of(mechanism_.contacts.begin(), mechanism_.contacts.end(),
                         [&](const ContactPair& pair) { return pair.name == name; });
    };
    std::string name = identifier(a);
    if (taken(name)) name += "_" + identifier(b);
    for (const std::string pairs = name + "_"; taken(name);) name = pairs + std::to_string(mechanism_.contacts.size());
    return name;
  }

  bool find(const std::string& word, const std::string& name, Placed& out) {
    Words names, planes;
    for (const ShapeText& shape : robot_.shapes) {
      if (shape.name == name) out.shape = &shape;
      names.push_back(shape.name);
      if (shape.type == "plane") planes.push_back(shape.name);
    }
    if (out.shape == nullptr && name == kGround) {
      if (planes.size() > 1) {
        fail(word, "the file has " + std::to_string(planes.size()) + " planes; name one: " + join(planes));
        return false;
      }
      if (planes.empty()) {
        out.shape = &ground_;
        return true;
      }
      return find(word, planes[0], out);
    }
    if (out.shape == nullptr) {
      const std::string near = nearest(name, names);
      fail(word, robot_.path + " has no geom '" + name + "'" +
                     (near.empty() ? "; there are " + join(names) : "; is '" + near + "' meant?"));
      return false;
    }
    const int frame = mechanism_.find_frame(out.shape->link);
    if (frame < 0) {
      fail(word, "geom '" + name + "' is on '" + out.shape->link +
                     "', which floats beside the robot and is no part of it; give it slides and hinges in place of "
                     "the free joint");
      return false;
    }
    const NamedFrame& on = mechanism_.frames[static_cast<std::size_t>(frame)];
    // what stands on the world stays where it is while a base moves
    out.body = out.shape->link == "world" ? -1 : on.body;
    out.pose = out.shape->link == "world" ? out.shape->pose : on.pose * out.shape->pose;
    out.stands = world_pose(out.body, out.pose);
    return true;
  }

  Pose world_pose(int body, const Pose& pose) const {
    Pose out;
    out.position = tree_.point(body, pose.position);
    for (int c = 0; c < 3; ++c) {
      const Vec3<double> axis = tree_.direction(body, {pose.rotation(0, c), pose.rotation(1, c), pose.rotation(2, c)});
      for (int r = 0; r < 3; ++r) out.rotation(r, c) = axis[static_cast<std::size_t>(r)];
    }
    return out;
  }

  /// As MuJoCo mixes: the larger friction, the mean of the rest, but for a priority; or what the file says of the pair.
  bool take_law(const std::string& word, const ShapeText& a, const ShapeText& b, ContactPair& pair) {
    pair.grip_ratio = robot_.grip_ratio;
    const bool is_ground = &a == &ground_ || &b == &ground_;
    const ShapeText& first = &a == &ground_ ? b : a;
    const double sum = a.mix + b.mix, share = sum > 0.0 ? a.mix / sum : 0.5;
    const auto mixed = [&](double of_a, double of_b) { return share * of_a + (1.0 - share) * of_b; };
    pair.law = a.priority >= b.priority ? a.law : b.law;
    int condim = a.priority >= b.priority ? a.condim : b.condim;
    if (is_ground) {
      pair.law = first.law;
      condim = first.condim;
    } else if (a.priority == b.priority) {
      condim = std::max(a.condim, b.condim);
      pair.law.friction = std::max(a.law.friction, b.law.friction);
      pair.law.settle_s = mixed(a.law.settle_s, b.law.settle_s);
      pair.law.damping_ratio = mixed(a.law.damping_ratio, b.law.damping_ratio);
      pair.law.impedance = mixed(a.law.impedance, b.law.impedance);
    }
    if (condim == 1) pair.law.friction = 0.0;
    for (const PairText& stated : robot_.pairs)
      if ((stated.a == a.name && stated.b == b.name) || (stated.a == b.name && stated.b == a.name)) {
        pair.law = stated.law;
        condim = stated.condim;
      }
    if (pair.law.friction <= 0.0 && condim > 1)
      fail(word, "neither geom has friction; give one a friction, or condim=\"1\" where it is to slide freely");
    else if (!(pair.law.settle_s > 0.0) || !(pair.law.damping_ratio > 0.0) || !std::isfinite(pair.law.settle_s))
      fail(word,
           "solref has no damping or no stiffness, so that a contact rings for ever; write "
           "solref=\"0.02 1\", or both numbers of -stiffness -damping below 0");
    else
      return true;
    return false;
  }

  /// `b` is a plane where one of the two is one, else a box where one is.
  bool place(const Placed& a, const Placed& b, ContactPair& pair) {
    const std::string &kind_a = a.shape->type, &kind_b = b.shape->type;
    if (kind_b == "plane") return b.body < 0 && place_on_face(a, b, b.pose, nullptr, pair);
    if (kind_a == "sphere" && kind_b == "sphere") {
      ContactPoint point = ball_at(a, a.pose.position);
      point.body_b = b.body;
      point.face = b.pose;
      // the tangents' direction: an axis that the normal is far from
      const Vec3<double> apart = inverse(b.stands).rotation * (a.stands.position - b.stands.position);
      std::size_t least = 0;
      for (std::size_t k = 1; k < 3; ++k)
        if (std::fabs(apart[k]) < std::fabs(apart[least])) least = k;
      point.face = face_pose(b.pose, (static_cast<int>(least) + 2) % 3, 1.0, 0.0);
      point.is_ball = true;
      point.ball_m = b.shape->size[0];
      pair.points.push_back(point);
      return true;
    }
    if (kind_b != "box") return false;
    if (kind_a != "box") {
      const Face face = face_towards(b, a.stands.position);
      return place_on_face(a, b, pose_of(b, face), &face, pair);
    }
    // the smaller face lends its corners
    const Face of_a = face_towards(a, b.stands.position), of_b = face_towards(b, a.stands.position);
    if (area(a, of_a) > area(b, of_b)) return place_on_face(b, a, pose_of(a, of_a), &of_a, pair);
    return place_on_face(a, b, pose_of(b, of_b), &of_b, pair);
  }

  static Pose pose_of(const Placed& box, const Face& face) {
    return face_pose(box.pose, face.axis, face.sign, box.shape->size[static_cast<std::size_t>(face.axis)]);
  }
  static ContactPoint ball_at(const Placed& shape, const Vec3<double>& at) {
    ContactPoint point;
    point.body_a = shape.body;
    point.at = at;
    point.radius_m = shape.shape->type == "box" ? 0.0 : shape.shape->size[0];
    return point;
  }

  bool place_on_face(const Placed& a, const Placed& b, const Pose& face, const Face* of_box, ContactPair& pair) {
    std::vector<Vec3<double>> at;
    const Vec3<double>& size = a.shape->size;
    if (a.shape->type == "sphere") {
      at.push_back({});
    } else if (a.shape->type == "capsule") {
      at.push_back({0.0, 0.0, size[1]});
      at.push_back({0.0, 0.0, -size[1]});
    } else if (a.shape->type == "box") {
      const Pose stands = world_pose(b.body, face);
      const Face mine = face_along(a, {-stands.rotation(0, 2), -stands.rotation(1, 2), -stands.rotation(2, 2)});
      using Ends = std::vector<double>;
      const Ends ends = turns(a.body, b.body) ? Ends{-1.0, 1.0} : Ends{0.0};
      for (const double x : ends)
        for (const double y : ends) {
          Vec3<double> corner{};
          const auto k = static_cast<std::size_t>(mine.axis);
          corner[k] = mine.sign * size[k];
          corner[(k + 1) % 3] = x * size[(k + 1) % 3];
          corner[(k + 2) % 3] = y * size[(k + 2) % 3];
          at.push_back(corner);
        }
    } else {
      return false;
    }
    for (const Vec3<double>& p : at) {
      ContactPoint point = ball_at(a, a.pose.rotation * p + a.pose.position);
      point.body_b = b.body;
      point.face = face;
      if (of_box != nullptr) {
        point.half_x_m = half(b, *of_box, 1);
        point.half_y_m = half(b, *of_box, 2);
        point.depth_m = b.shape->size[static_cast<std::size_t>(of_box->axis)];
      }
      pair.points.push_back(point);
    }
    return true;
  }

  /// Whether a body can turn against another; where it cannot, a face touches as its centre does.
  bool turns(int a, int b) const {
    const auto chain = [&](int body) {
      std::vector<int> out;
      for (int i = body; i >= 0; i = mechanism_.bodies[static_cast<std::size_t>(i)].parent) out.push_back(i);
      return out;
    };
    const std::vector<int> of_a = chain(a), of_b = chain(b);
    const auto any = [&](const std::vector<int>& own, const std::vector<int>& other) {
      return std::any_of(own.begin(), own.end(), [&](int i) {
        return !mechanism_.bodies[static_cast<std::size_t>(i)].prismatic &&
               std::find(other.begin(), other.end(), i) == other.end();
      });
    };
    return any(of_a, of_b) || any(of_b, of_a);
  }

  /// Corners as wide as a share of the weight of what a place accelerates, where the robot starts.
  void soften(ContactPair& pair) {
    ArticulatedBody<double> tree(mechanism_, body_inertias(mechanism_));
    tree.place(start_position(mechanism_));
    tree.weigh();
    const std::size_t n = mechanism_.bodies.size();
    std::vector<std::vector<double>> inverse(n, std::vector<double>(n));
    for (std::size_t j = 0; j < n; ++j) {
      const std::vector<double> column = tree.respond(j);
      for (std::size_t i = 0; i <= j; ++i) inverse[i][j] = inverse[j][i] = column[i];
    }
    const std::vector<double> still(n);
    const ContactRows<double> rows = BodyMotions<double>(mechanism_, tree, still).rows(pair.points[0]);
    double yields = 0.0;
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) yields += rows.reach[0][i] * inverse[i][j] * rows.reach[0][j];
    if (yields > 0.0) pair.smooth_N = kCornerShare * kGravity_m_s2 / yields;
  }

  const Description& robot_;
  Mechanism& mechanism_;
  std::vector<std::string>& errors_;
  ArticulatedBody<double> tree_;
  ShapeText ground_;
  std::vector<std::pair<const ShapeText*, const ShapeText*>> taken_;
};

/// What the description's reader said of contacts, without those that are read.
void tell_what_remains(const Words& words, Mechanism& mechanism) {
  const std::string head = "CONTACTS are not read: ";
  for (std::string& what : mechanism.left_out) {
    if (what.rfind("what carries the base: ", 0) == 0)
      what = "what carries the base beside its contacts: thrust is not read; `tiller models` lists robots that fly";
    if (what.rfind(head, 0) == 0)
      what = "CONTACTS beside " + join(words) +
             " are not read: " + what.substr(head.size(), what.find(';') - head.size()) +
             "; other shapes pass through each other";
  }
}

}  // namespace

bool choose_contacts(const Description& robot, const std::vector<std::string>& words, Mechanism& mechanism,
                     std::vector<std::string>& errors) {
  if (words.empty()) return true;
  const std::size_t before = errors.size();
  if (!robot.has_shapes)
    errors.push_back("--contact " + words[0] + ": of " + robot.path +
                     " no shapes are read; contacts are of an MJCF or .mjb (MuJoCo compiles a URDF into one), or of "
                     "the JSON of an import that has them");
  else
    Chooser(robot, mechanism, errors).choose(words);
  tell_what_remains(words, mechanism);
  return errors.size() == before;
}

unsigned contact_substeps(const Mechanism& mechanism, double period_s) {
  constexpr unsigned kMost = 64;
  double steps = 1.0;
  for (const ContactPair& pair : mechanism.contacts)
    steps = std::max(steps, period_s * std::max(2.0, 1.0 / pair.law.damping_ratio) / pair.law.settle_s);
  return steps <= kMost ? static_cast<unsigned>(std::ceil(steps - 1e-9)) : 0;
}

}  // namespace tiller::tools
