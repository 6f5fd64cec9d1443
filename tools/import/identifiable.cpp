#include "tools/import/identifiable.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "tools/base/text.hpp"
#include "tools/import/inverse_dynamics.hpp"

namespace tiller::tools {
namespace {

using Inertia = BodyInertia<double>;
using Values = std::vector<double>;

/// What no other unknown does, as a share of an unknown's effect, below which it counts as nothing. Rounding leaves
/// some 1e-14; the weakest unknown that counts has 1e-4 and more on arms of six axes
/// (tests/import/identifiable_test.cpp).
constexpr double kNothing = 1e-8;
constexpr int kMotions = 40;
constexpr double kSpeed_rad_s = 3.0, kAcceleration_rad_s2 = 5.0, kRoom_m = 0.5;

/// Of a uniform prior from 0.
double sd_of_range(double most) { return most / std::sqrt(12.0); }

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// First moment m c and inertia about the origin from mass, centre and second moments about the centre.
Inertia of_moments(double mass, const Vec3<double>& first, const Mat3<double>& second) {
  Inertia b;
  b.mass = mass;
  b.moment = first;
  const double trace = second(0, 0) + second(1, 1) + second(2, 2);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) b.inertia(r, c) = (r == c ? trace : 0.0) - second(r, c);
  return b;
}

Mat3<double> outer(const Vec3<double>& a, const Vec3<double>& b) {
  Mat3<double> m;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) m(r, c) = a[at(r)] * b[at(c)];
  return m;
}
Mat3<double> times(double s, const Mat3<double>& m) {
  Mat3<double> out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out(r, c) = s * m(r, c);
  return out;
}

/// Second moments about the centre of mass.
Mat3<double> second_moments(const RigidBody& b) {
  const Mat3<double>& i = b.inertia_kgm2;
  const double half = 0.5 * (i(0, 0) + i(1, 1) + i(2, 2));
  Mat3<double> s;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) s(r, c) = (r == c ? half : 0.0) - i(r, c);
  return s;
}

Inertia whole(const RigidBody& b) {
  const Vec3<double> first = scaled(b.mass_kg, b.com_m);
  return of_moments(b.mass_kg, first, second_moments(b) + outer(first, b.com_m));
}

/// Derivative by a log-Cholesky coordinate at 0: with the centre c, second moments S about it and the deformation
/// x -> exp(size) (B (x - c) + shift) + c of the mass, B = exp(stretches) + shears (Rucker and Wensing 2022).
Inertia by_coordinate(const RigidBody& b, int slot) {
  const Mat3<double> s = second_moments(b);
  if (slot == 0) {  // exp(2 size) scales everything
    Inertia d = whole(b);
    d.mass *= 2.0;
    d.moment = scaled(2.0, d.moment);
    d.inertia = times(2.0, d.inertia);
    return d;
  }
  if (slot < 7) {
    static constexpr int kPlace[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {0, 2}};
    Mat3<double> e;
    e(kPlace[slot - 1][0], kPlace[slot - 1][1]) = 1.0;
    return of_moments(0.0, {}, e * s + s * e.transposed());
  }
  Vec3<double> shift{};
  shift[at(slot - 7)] = b.mass_kg;
  return of_moments(0.0, shift, outer(shift, b.com_m) + outer(b.com_m, shift));
}

/// Inertias of everything as described, and what each unknown changes of it or does beside it.
class Derivatives {
 public:
  Derivatives(const Mechanism& mechanism, const Unknowns& unknowns, int payload_frame)
      : mechanism_(mechanism), bare_(mechanism), joints_(mechanism.free_joints()), friction_(unknowns.friction) {
    for (MovingBody& body : bare_.bodies) body.armature = 0.0;
    described_.resize(mechanism.bodies.size());
    for (std::size_t i = 0; i < described_.size(); ++i)
      for (const LinkShare& share : mechanism.bodies[i].links) add(described_[i], whole(share.body));
    collect(unknowns, payload_frame);
  }

  const std::vector<Unknown>& unknowns() const { return unknowns_; }

  /// (joints x motions, unknowns): derivatives of the joints' forces.
  Eigen::MatrixXd sample(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    const auto n = static_cast<Eigen::Index>(joints_.size());
    Eigen::MatrixXd all(n * kMotions, static_cast<Eigen::Index>(unknowns_.size()));
    for (int k = 0; k < kMotions; ++k) {
      draw(random);
      for (std::size_t c = 0; c < unknowns_.size(); ++c)
        all.block(k * n, static_cast<Eigen::Index>(c), n, 1) = column(c);
    }
    return all;
  }

  /// The size of what an unknown moves by itself, whether or not the joints feel it.
  double reach(std::size_t c) const {
    if (changes_[c].body < 0) return 0.0;
    const Inertia& d = changes_[c].inertia;
    double sum = std::fabs(d.mass);
    for (int r = 0; r < 3; ++r) {
      sum += std::fabs(d.moment[at(r)]);
      for (int k = 0; k < 3; ++k) sum += std::fabs(d.inertia(r, k));
    }
    return 10.0 * sum;  // m/s2
  }

 private:
  struct Change {
    int body = -1;  // the inertia that it changes; -1: none
    Inertia inertia;
    int joint = -1;  // the place among the joints at which it acts otherwise
  };

  static void add(Inertia& to, const Inertia& b) {
    to.mass += b.mass;
    to.moment = to.moment + b.moment;
    to.inertia = to.inertia + b.inertia;
  }

  void collect(const Unknowns& unknowns, int payload_frame) {
    using Kind = Unknown::Kind;
    for (const ModelParameter& p : unknowns.parameters) {
      if (p.kind == ModelParameter::Kind::gain) {
        take({Kind::gain, p.name, p.about, p.sd}, {-1, {}, joint(p.about)});
        continue;
      }
      if (p.kind == ModelParameter::Kind::contact) continue;  // motions in the air tell nothing of it
      const bool is_mass = p.kind == ModelParameter::Kind::mass;
      for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i)
        for (const LinkShare& share : mechanism_.bodies[i].links) {
          if (share.link != p.about) continue;
          Inertia d = is_mass ? whole(share.body) : by_coordinate(share.body, p.slot);
          if (is_mass) {
            const double per_kg = 1.0 / share.body.mass_kg;
            d = {1.0, scaled(per_kg, d.moment), times(per_kg, d.inertia)};
          }
          take({is_mass ? Kind::mass : Kind::inertia, p.name, p.about, is_mass ? p.value * p.sd : p.sd},
               {static_cast<int>(i), d, -1});
        }
    }
    if (unknowns.payload && payload_frame >= 0) {
      const NamedFrame& frame = mechanism_.frames[at(payload_frame)];
      RigidBody unit;
      unit.mass_kg = 1.0;
      unit.com_m = frame.pose.position;
      if (frame.body >= 0)
        take({Kind::payload, "payload's mass_kg", frame.name, sd_of_range(unknowns.payload_kg)},
             {frame.body, whole(unit), -1});
    }
    const auto is_prior = [](const std::string& text) { return text.find('{') != std::string::npos; };
    for (const JointFriction& f : unknowns.friction) {
      const std::string name = identifier(f.joint);
      // the prior reaches 2.5 times as far as the simulated plant's friction, or twice the description's
      if (is_prior(f.viscous))
        take({Kind::viscous, name + ".damping_SI", f.joint, sd_of_range(2.0 * f.plant_viscous)},
             {-1, {}, joint(f.joint)});
      if (is_prior(f.dry))
        take({Kind::dry, name + ".friction_SI", f.joint, sd_of_range(2.0 * f.plant_dry)}, {-1, {}, joint(f.joint)});
    }
  }
  void take(Unknown unknown, Change change) {
    unknowns_.push_back(std::move(unknown));
    changes_.push_back(std::move(change));
  }
  int joint(const std::string& name) const {
    for (std::size_t j = 0; j < joints_.size(); ++j)
      if (mechanism_.bodies[at(joints_[j])].joint == name) return static_cast<int>(j);
    return -1;
  }

  /// Values of all bodies from those of the joints with states: followers follow.
  Values spread(const Eigen::VectorXd& of_joints, bool position) const {
    Values all(mechanism_.bodies.size());
    for (std::size_t j = 0; j < joints_.size(); ++j) all[at(joints_[j])] = of_joints[static_cast<Eigen::Index>(j)];
    for (std::size_t i = 0; i < all.size(); ++i) {
      const MovingBody& b = mechanism_.bodies[i];
      if (b.mimics >= 0) all[i] = b.mimic_ratio * all[at(b.mimics)] + (position ? b.mimic_offset : 0.0);
    }
    return all;
  }
  /// Virtual work: a follower's force works with its ratio.
  Eigen::VectorXd gather(const Values& of_bodies) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joints_.size()));
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      out[static_cast<Eigen::Index>(j)] = of_bodies[at(joints_[j])];
      for (std::size_t i = 0; i < of_bodies.size(); ++i)
        if (mechanism_.bodies[i].mimics == joints_[j])
          out[static_cast<Eigen::Index>(j)] += mechanism_.bodies[i].mimic_ratio * of_bodies[i];
    }
    return out;
  }
  Eigen::VectorXd forces(const Mechanism& mechanism, const std::vector<Inertia>& inertia,
                         const Eigen::VectorXd& acceleration) const {
    const Vec3<double>& g = mechanism_.gravity_m_s2;
    return gather(joint_forces<double>(mechanism, inertia, spread(position_, true), spread(speed_, false),
                                       spread(acceleration, false), {-g[0], -g[1], -g[2]}));
  }

  /// A motion that the robot can have: joints that nothing drives are moved by the others alone.
  void draw(std::mt19937_64& random) {
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    const auto n = static_cast<Eigen::Index>(joints_.size());
    position_.resize(n);
    speed_.resize(n);
    acceleration_.resize(n);
    for (Eigen::Index j = 0; j < n; ++j) {
      position_[j] = (body(j).prismatic ? kRoom_m : M_PI) * unit(random);
      speed_[j] = kSpeed_rad_s * unit(random);
      acceleration_[j] = kAcceleration_rad_s2 * unit(random);
    }
    force_ = forces(mechanism_, described_, acceleration_);
    for (Eigen::Index j = 0; j < n; ++j) force_[j] += friction(j);
    if (std::all_of(joints_.begin(), joints_.end(), [&](int b) { return mechanism_.bodies[at(b)].actuated; })) return;
    const Eigen::VectorXd bias = forces(mechanism_, described_, Eigen::VectorXd::Zero(n));
    Eigen::MatrixXd inertia(n, n);
    Eigen::VectorXd rest(n);
    for (Eigen::Index j = 0; j < n; ++j) {
      inertia.col(j) = forces(mechanism_, described_, Eigen::VectorXd::Unit(n, j)) - bias;
      if (!body(j).actuated) force_[j] = 0.0;
      rest[j] = force_[j] - friction(j) - bias[j];
    }
    acceleration_ = inertia.ldlt().solve(rest);
  }
  const MovingBody& body(Eigen::Index joint) const {
    return mechanism_.bodies[at(joints_[static_cast<std::size_t>(joint)])];
  }
  /// What the robot file has as effects: known or not, it takes part in what an input of unknown gain has to do.
  double friction(Eigen::Index joint) const {
    const MovingBody& b = body(joint);
    double force = b.stiffness > 0.0 ? b.stiffness * (position_[joint] - b.rest) : 0.0;
    for (const JointFriction& f : friction_)
      if (f.joint == b.joint)
        force += f.plant_viscous * speed_[joint] + f.plant_dry * std::copysign(1.0, speed_[joint]);
    return force;
  }

  Eigen::VectorXd column(std::size_t c) const {
    const Change& change = changes_[c];
    if (change.body >= 0) {
      std::vector<Inertia> one(described_.size());
      one[at(change.body)] = change.inertia;
      return forces(bare_, one, acceleration_);
    }
    Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joints_.size()));
    if (change.joint < 0) return out;
    switch (unknowns_[c].kind) {
      case Unknown::Kind::gain: out[change.joint] = -force_[change.joint]; break;
      case Unknown::Kind::viscous: out[change.joint] = speed_[change.joint]; break;
      default: out[change.joint] = std::copysign(1.0, speed_[change.joint]); break;
    }
    return out;
  }

  const Mechanism& mechanism_;
  Mechanism bare_;  // without rotors, which no unknown changes
  std::vector<int> joints_;
  std::vector<JointFriction> friction_;
  std::vector<Inertia> described_;
  std::vector<Unknown> unknowns_;
  std::vector<Change> changes_;
  Eigen::VectorXd position_, speed_, acceleration_, force_;  // of the present motion
};

/// Each joint's rows in units of what is typical of the joint, so that a light wrist counts beside a heavy shoulder.
void balance_rows(Eigen::MatrixXd& m, Eigen::Index joints) {
  for (Eigen::Index j = 0; j < joints; ++j) {
    double sum = 0.0;
    for (Eigen::Index r = j; r < m.rows(); r += joints) sum += m.row(r).squaredNorm();
    if (!(sum > 0.0)) continue;
    const double scale = 1.0 / std::sqrt(sum);
    for (Eigen::Index r = j; r < m.rows(); r += joints) m.row(r) *= scale;
  }
}

/// Effects of the robot file keep their priors, so they come first.
bool is_effect(const Unknown& u) {
  return u.kind == Unknown::Kind::payload || u.kind == Unknown::Kind::viscous || u.kind == Unknown::Kind::dry;
}

/// Columns that explain all others, by elimination with pivots: effects first, then whatever does most of what those
/// before it do not, by its prior. `unit` has columns of length 1.
std::vector<Eigen::Index> independent(const Eigen::MatrixXd& unit, const Eigen::VectorXd& norm,
                                      std::vector<Eigen::Index> candidates, Identifiability& out) {
  Eigen::MatrixXd rest = unit;
  std::vector<Eigen::VectorXd> basis;
  std::vector<Eigen::Index> kept;
  const auto unknown = [&](Eigen::Index c) -> const Unknown& { return out.unknowns[static_cast<std::size_t>(c)]; };
  while (!candidates.empty()) {
    std::size_t best = candidates.size();
    double most = 0.0;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const Eigen::Index c = candidates[i];
      const double own = rest.col(c).norm();
      if (own < kNothing) continue;
      const double strength = own * norm[c] * unknown(c).sd;
      const bool goes_first = best == candidates.size() || is_effect(unknown(c)) > is_effect(unknown(candidates[best]));
      const bool is_peer = best < candidates.size() && is_effect(unknown(c)) == is_effect(unknown(candidates[best]));
      if (goes_first || (is_peer && strength > 1.0000001 * most)) {
        best = i;
        most = strength;
      }
    }
    if (best == candidates.size()) break;
    const Eigen::Index c = candidates[best];
    out.smallest_kept = std::min(out.smallest_kept, rest.col(c).norm());
    // twice is enough (Kahan and Parlett)
    Eigen::VectorXd direction = rest.col(c).normalized();
    for (const Eigen::VectorXd& b : basis) direction -= b * b.dot(direction);
    direction.normalize();
    basis.push_back(direction);
    kept.push_back(c);
    candidates.erase(candidates.begin() + static_cast<std::ptrdiff_t>(best));
    for (const Eigen::Index other : candidates)
      for (int pass = 0; pass < 2; ++pass) rest.col(other) -= direction * direction.dot(rest.col(other));
  }
  for (const Eigen::Index c : candidates) out.largest_dropped = std::max(out.largest_dropped, rest.col(c).norm());
  return kept;
}

/// Coordinates of inertias by the links.
std::map<std::string, std::vector<int>> by_link(const Identifiability& found) {
  std::map<std::string, std::vector<int>> out;
  for (std::size_t i = 0; i < found.unknowns.size(); ++i)
    if (found.unknowns[i].kind == Unknown::Kind::inertia) out[found.unknowns[i].about].push_back(static_cast<int>(i));
  return out;
}

/// "shift_x_m" of "forearm_shift_x_m".
std::string coordinate_of(const Unknown& unknown) {
  const std::string head = identifier(unknown.about) + "_";
  return unknown.name.compare(0, head.size(), head) == 0 ? unknown.name.substr(head.size()) : unknown.name;
}

/// Changes of unknowns by which nothing changes: of one that is no head of a combination by 1, of the heads by what
/// makes up for it.
std::vector<Combination> idle_directions(const Identifiability& found) {
  std::map<int, Combination> by_tail;
  for (const Combination& c : found.shared)
    for (std::size_t k = 1; k < c.terms.size(); ++k) {
      Combination& direction = by_tail[c.terms[k].unknown];
      if (direction.terms.empty()) direction.terms.push_back({1.0, c.terms[k].unknown});
      direction.terms.push_back({-c.terms[k].factor, c.terms[0].unknown});
    }
  std::vector<Combination> out;
  for (auto& [tail, direction] : by_tail) out.push_back(std::move(direction));
  return out;
}

/// "a by 1, b by -2.5", of at most so many.
std::string direction_text(const Identifiability& found, const Combination& direction, std::size_t most) {
  std::string text;
  const std::size_t count = direction.terms.size(), told = std::min(count, most);
  for (std::size_t i = 0; i < told; ++i)
    text += (i > 0 ? ", " : "") + found.unknowns[at(direction.terms[i].unknown)].name + " by " +
            format("%.3g", direction.terms[i].factor);
  return text + (told < count ? " and " + std::to_string(count - told) + " more" : "");
}

}  // namespace

bool Identifiability::is_unseen(int unknown) const {
  return std::find(unseen.begin(), unseen.end(), unknown) != unseen.end();
}

Identifiability find_identifiable(const Mechanism& mechanism, const Unknowns& unknowns, int payload_frame) {
  Identifiability out;
  Derivatives derivatives(mechanism, unknowns, payload_frame);
  out.unknowns = derivatives.unknowns();
  const auto count = static_cast<Eigen::Index>(out.unknowns.size());
  if (count == 0) return out;
  Eigen::MatrixXd m = derivatives.sample(1);
  std::vector<Eigen::Index> seen;
  for (Eigen::Index c = 0; c < count; ++c) {
    const double rms = m.col(c).norm() / std::sqrt(static_cast<double>(kMotions));
    if (rms > kNothing * derivatives.reach(static_cast<std::size_t>(c)) && rms > 0.0)
      seen.push_back(c);
    else {
      out.unseen.push_back(static_cast<int>(c));
      m.col(c).setZero();
    }
  }
  balance_rows(m, static_cast<Eigen::Index>(mechanism.free_joints().size()));
  Eigen::VectorXd norm = m.colwise().norm();
  for (const Eigen::Index c : seen) m.col(c) /= norm[c];
  const std::vector<Eigen::Index> kept = independent(m, norm, seen, out);
  out.rank = kept.size();
  if (kept.size() == seen.size()) return out;

  Eigen::MatrixXd basis(m.rows(), static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k) basis.col(static_cast<Eigen::Index>(k)) = m.col(kept[k]);
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(basis);
  std::vector<Combination> all(kept.size());
  for (std::size_t k = 0; k < kept.size(); ++k) all[k].terms.push_back({1.0, static_cast<int>(kept[k])});
  for (const Eigen::Index c : seen) {
    if (std::find(kept.begin(), kept.end(), c) != kept.end()) continue;
    const Eigen::VectorXd share = qr.solve(m.col(c));
    for (std::size_t k = 0; k < kept.size(); ++k) {
      const double s = share[static_cast<Eigen::Index>(k)];
      if (std::fabs(s) > 1e-7) all[k].terms.push_back({s * norm[c] / norm[kept[k]], static_cast<int>(c)});
    }
  }
  for (Combination& combination : all)
    if (combination.terms.size() > 1) out.shared.push_back(std::move(combination));
  return out;
}

std::string combination_text(const Identifiability& found, const Combination& combination, std::size_t most) {
  std::string text;
  const std::size_t count = combination.terms.size();
  const std::size_t told = most == 0 || count <= most ? count : most;
  for (std::size_t i = 0; i < told; ++i) {
    const Combination::Term& term = combination.terms[i];
    const double size = std::fabs(term.factor);
    text += i == 0 ? (term.factor < 0.0 ? "-" : "") : term.factor < 0.0 ? " - " : " + ";
    if (std::fabs(size - 1.0) > 1e-6) text += format("%.3g ", size);
    text += found.unknowns[at(term.unknown)].name;
  }
  if (told < count) text += " and " + std::to_string(count - told) + " more";
  return text;
}

std::vector<std::string> identifiable_notes(const Identifiability& found, bool are_held) {
  constexpr std::size_t kTerms = 6, kLines = 12;
  std::vector<std::string> notes;
  const std::string held = are_held ? "; held at the description's" : "; they keep their priors";
  std::set<int> told;
  for (const auto& [link, all] : by_link(found)) {
    Words names;
    for (const int i : all)
      if (found.is_unseen(i)) {
        names.push_back(coordinate_of(found.unknowns[at(i)]));
        told.insert(i);
      }
    if (!names.empty())
      notes.push_back(link + ": " + std::to_string(names.size()) + " of " + std::to_string(all.size()) +
                      " inertial coordinates move no joint force: " + join(names) + held);
  }
  for (const int i : found.unseen) {
    if (told.count(i) > 0) continue;
    const Unknown& u = found.unknowns[at(i)];
    notes.push_back(u.name + " of " + u.about + " moves no joint force: no motion can tell it" +
                    (u.kind == Unknown::Kind::mass && are_held ? "; held at the description's" : ""));
  }
  if (found.shared.empty()) return notes;
  std::set<int> mixed;
  for (const Combination& c : found.shared)
    for (const Combination::Term& t : c.terms) mixed.insert(t.unknown);
  const std::string total = "motions tell " + std::to_string(found.rank) + " numbers of " +
                            std::to_string(found.unknowns.size()) + " unknowns; ";
  const std::vector<Combination> idle = idle_directions(found);
  // whichever is shorter: what shows, or what may change together without showing
  const bool tell_idle = idle.size() < found.shared.size();
  const std::vector<Combination>& lines = tell_idle ? idle : found.shared;
  std::string text =
      total + (tell_idle ? "these may change together and nothing shows"
                         : std::to_string(mixed.size()) + " show only as " + std::to_string(lines.size()) +
                               (lines.size() == 1 ? " combination" : " combinations"));
  if (are_held) text += tell_idle ? " (the first is held)" : " (the first stands for the sum, the others are held)";
  text += ":";
  for (std::size_t i = 0; i < lines.size() && i < kLines; ++i)
    text += "\n  " + (tell_idle ? direction_text(found, lines[i], kTerms) : combination_text(found, lines[i], kTerms));
  if (lines.size() > kLines) text += "\n  and " + std::to_string(lines.size() - kLines) + " more";
  notes.push_back(text);
  return notes;
}

void hold_unidentifiable(const Identifiability& found, Unknowns& unknowns) {
  const auto parameter = [&](int i) {
    return std::find_if(unknowns.parameters.begin(), unknowns.parameters.end(),
                        [&](const ModelParameter& p) { return p.name == found.unknowns[at(i)].name; });
  };
  const auto hold = [&](int i) {
    if (const auto p = parameter(i); p != unknowns.parameters.end()) p->is_held = true;
  };
  for (const int i : found.unseen) hold(i);
  for (const Combination& c : found.shared) {
    double variance = 0.0;
    for (const Combination::Term& t : c.terms) {
      const double sd = t.factor * found.unknowns[at(t.unknown)].sd;
      variance += sd * sd;
    }
    for (std::size_t k = 1; k < c.terms.size(); ++k) hold(c.terms[k].unknown);
    const auto head = parameter(c.terms[0].unknown);
    if (head != unknowns.parameters.end())
      head->sd = std::sqrt(variance) / (head->kind == ModelParameter::Kind::mass ? head->value : 1.0);
  }
}

void comment_parameters(const Identifiability& found, Unknowns& unknowns) {
  constexpr std::size_t kTerms = 5;
  for (ModelParameter& p : unknowns.parameters) {
    const std::string held = p.is_held ? "; held" : "";
    const auto is_this = [&](int i) { return found.unknowns[at(i)].name == p.name; };
    for (const int i : found.unseen)
      if (is_this(i)) p.comment = "no motion can tell it: it moves no joint force" + held;
    for (const Combination& c : found.shared) {
      if (is_this(c.terms[0].unknown)) p.comment = "stands for " + combination_text(found, c, kTerms);
      for (std::size_t k = 1; k < c.terms.size() && p.comment.empty(); ++k)
        if (is_this(c.terms[k].unknown))
          p.comment = "shows only with " + found.unknowns[at(c.terms[0].unknown)].name + held;
    }
  }
}

}  // namespace tiller::tools
