#include "tools/import/unknowns.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "tools/base/text.hpp"

namespace tiller::tools {

std::string identifier(const std::string& name) {
  std::string out;
  for (const char c : name) out += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  if (out.empty() || std::isdigit(static_cast<unsigned char>(out[0])) != 0) out = "j" + out;
  return out;
}

const char* const* inertia_coordinates() {
  static const char* const names[kInertiaCoordinates] = {"size",      "stretch_x", "stretch_y", "stretch_z",
                                                         "shear_xy",  "shear_yz",  "shear_xz",  "shift_x_m",
                                                         "shift_y_m", "shift_z_m"};
  return names;
}

std::string ModelParameter::prior() const {
  if (is_held) return is_log_normal() ? number_text(value) : "0.0";
  const auto spread = [&] { return format("%.4g", sd); };
  return is_log_normal() ? "{ log_normal = [" + (value == 1.0 ? "1.0" : number_text(value)) + ", " + spread() + "] }"
                         : "{ normal = [0.0, " + spread() + "] }";
}

namespace {

constexpr double kPayload_kg = 3.0;
/// How far a description's numbers are believed where they are called unknown: a quarter for masses, a tenth for
/// shapes and gains.
constexpr double kMassShare = 0.25, kShapeSd = 0.1, kShiftSd_m = 0.01, kGainSd = 0.1, kGripShare = 0.25;
/// A joint whose friction nobody states: of its effort, at most so much dry, and so much viscous at its top speed. Four
/// harmonic drives took 5 to 12 % dry (docs/evidence/measured.md, the TIAGo), and others may take more; what takes all
/// of the effort leaves no speed beyond.
constexpr double kDryShare = 0.2, kViscousShare = 1.0;

class Reader {
 public:
  Reader(const Mechanism& mechanism, Unknowns& out, std::vector<std::string>& errors)
      : mechanism_(mechanism), out_(out), errors_(errors) {
    for (const MovingBody& body : mechanism.bodies) {
      if (body.mimics < 0) joints_.push_back(body.joint);
      for (const LinkShare& share : body.links) links_.push_back(share.link);
    }
    for (const ContactPair& pair : mechanism.contacts) pairs_.push_back(pair.name);
  }

  void read(const std::vector<std::string>& words) {
    for (const ContactPair& pair : mechanism_.contacts) add_contact(pair);
    for (const std::string& word : words) take(word);
    for (const MovingBody& body : mechanism_.bodies) {
      if (body.mimics >= 0 || has_friction(body.joint) || !(body.damping + body.friction > 0.0)) continue;
      const auto known = [](double value) { return value > 0.0 ? number_text(value) : std::string(); };
      out_.friction.push_back({body.joint, known(body.damping), known(body.friction), body.damping, body.friction});
    }
  }

 private:
  void take(const std::string& word) {
    const std::size_t colon = word.find(':'), equals = word.find('=');
    const std::string kind = word.substr(0, std::min(colon, equals));
    const std::string about = colon == std::string::npos ? "" : word.substr(colon + 1);
    if (kind == "payload") return take_payload(word, equals);
    static const Words kinds{"payload", "mass", "inertia", "friction", "gain", "contact"};
    if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end())
      return fail(word, "is none of payload[=KG], mass:LINK, inertia:LINK, friction:JOINT, gain:JOINT, contact:GEOM" +
                            meant(kind, kinds));
    const bool of_link = kind == "mass" || kind == "inertia";
    const bool of_pair = kind == "contact";
    const Words& known = of_pair ? pairs_ : of_link ? links_ : joints_;
    if (of_pair && pairs_.empty()) return fail(word, "there are no contacts; name them with --contact GEOM:plane");
    if (about.empty())
      return fail(word, "names no " +
                            std::string(of_pair   ? "contact"
                                        : of_link ? "link"
                                                  : "joint") +
                            "; write " + kind + ":NAME or " + kind + ":*");
    if (of_pair && about != "*" && std::find(known.begin(), known.end(), about) == known.end())
      return fail(word, "no contact of --contact is called '" + about + "'" + meant(about, known));
    if (about != "*" && std::find(known.begin(), known.end(), about) == known.end())
      return fail(word, std::string(of_link ? "no link that moves and has inertia" : "no joint that moves by itself") +
                            " is called '" + about + "'" + meant(about, known));
    for (const std::string& name : known)
      if (about == "*" || about == name) add(kind, name);
  }

  void fail(const std::string& word, const std::string& text) { errors_.push_back("--unknown " + word + ": " + text); }
  static std::string meant(const std::string& word, const Words& known) {
    const std::string near = nearest(word, known);
    return near.empty() ? "; there are " + join(known) : "; is '" + near + "' meant?";
  }

  void take_payload(const std::string& word, std::size_t equals) {
    out_.payload = true;
    out_.payload_kg = kPayload_kg;
    if (equals == std::string::npos) return;
    char* end = nullptr;
    out_.payload_kg = std::strtod(word.c_str() + equals + 1, &end);
    if (*end != '\0' || !(out_.payload_kg > 0.0) || !(out_.payload_kg < 1e6)) fail(word, "is no mass in kg above 0");
  }

  bool has(ModelParameter::Kind kind, const std::string& about) const {
    return std::any_of(out_.parameters.begin(), out_.parameters.end(),
                       [&](const ModelParameter& p) { return p.kind == kind && p.about == about; });
  }
  const MovingBody& body_of(const std::string& joint) const {
    return *std::find_if(mechanism_.bodies.begin(), mechanism_.bodies.end(),
                         [&](const MovingBody& b) { return b.joint == joint; });
  }
  double mass_of(const std::string& link) const {
    for (const MovingBody& body : mechanism_.bodies)
      for (const LinkShare& share : body.links)
        if (share.link == link) return share.body.mass_kg;
    return 0.0;
  }

  void add(const std::string& kind, const std::string& about) {
    using Kind = ModelParameter::Kind;
    if (kind == "mass" && !has(Kind::mass, about) && !has(Kind::inertia, about)) {
      const double m = mass_of(about);
      if (m > 0.0) out_.parameters.push_back({Kind::mass, identifier(about) + "_mass_kg", about, 0, m, kMassShare});
    }
    if (kind == "inertia" && !has(Kind::inertia, about)) {
      if (has(Kind::mass, about))
        return fail("inertia:" + about, "its mass is unknown already, which inertia includes");
      for (int k = 0; k < kInertiaCoordinates; ++k)
        out_.parameters.push_back({Kind::inertia, identifier(about) + "_" + inertia_coordinates()[k], about, k, 0.0,
                                   k < 7 ? kShapeSd : kShiftSd_m});
    }
    if (kind == "gain" && body_of(about).has_goal())
      return fail("gain:" + about, "the joint's input is a servo's goal; give stiffness_SI of its effect a prior");
    if (kind == "gain" && !has(Kind::gain, about) && body_of(about).actuated)
      out_.parameters.push_back({Kind::gain, identifier(about) + "_gain", about, 0, 1.0, kGainSd});
    if (kind == "friction") add_friction(body_of(about));
    if (kind == "contact")
      for (ModelParameter& p : out_.parameters)
        if (p.kind == Kind::contact && p.about == about && p.slot == 0) p.is_held = false;
  }

  /// Known, but for the friction where it is asked for: the two others are how the law is made stable.
  void add_contact(const ContactPair& pair) {
    using Kind = ModelParameter::Kind;
    const auto add = [&](const char* what, int slot, double value, const std::string& comment) {
      out_.parameters.push_back({Kind::contact, pair.name + what, pair.name, slot, value, kGripShare, true, comment});
    };
    if (pair.law.friction > 0.0) add("_friction", 0, pair.law.friction, pair.spelled);
    add("_settle_s", 1, pair.law.settle_s, "a step of the integrator may be half as long at most");
    add("_damping_ratio", 2, pair.law.damping_ratio, "");
  }

  bool has_friction(const std::string& joint) const {
    return std::any_of(out_.friction.begin(), out_.friction.end(),
                       [&](const JointFriction& f) { return f.joint == joint; });
  }
  void add_friction(const MovingBody& body) {
    if (has_friction(body.joint)) return;
    const double effort = body.effort < 1e6 ? body.effort : 10.0, speed = body.speed < 1e6 ? body.speed : 1.0;
    const double dry = std::max(2.0 * body.friction, kDryShare * effort);
    const double viscous = std::max(2.0 * body.damping, kViscousShare * effort / speed);
    const auto prior = [](double most) { return "{ uniform = [0.0, " + format("%.4g", most) + "] }"; };
    // where the description says nothing, what the prior calls likely is as good a truth as any
    const auto truth = [](double stated, double most) { return stated > 0.0 ? stated : 0.4 * most; };
    out_.friction.push_back(
        {body.joint, prior(viscous), prior(dry), truth(body.damping, viscous), truth(body.friction, dry)});
  }

  const Mechanism& mechanism_;
  Unknowns& out_;
  std::vector<std::string>& errors_;
  Words joints_, links_, pairs_;
};

}  // namespace

bool read_unknowns(const std::vector<std::string>& words, const Mechanism& mechanism, Unknowns& unknowns,
                   std::vector<std::string>& errors) {
  unknowns = {};
  const std::size_t before = errors.size();
  Reader(mechanism, unknowns, errors).read(words);
  return errors.size() == before;
}

}  // namespace tiller::tools
