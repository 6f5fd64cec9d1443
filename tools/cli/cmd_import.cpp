// import: a robot description into a model of one's own, with its robot file.

#include <sys/stat.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/base/output_file.hpp"
#include "tools/cli/import_description.hpp"
#include "tools/cli/import_function.hpp"
#include "tools/command/commands.hpp"
#include "tools/description/function.hpp"
#include "tools/import/contact_choice.hpp"
#include "tools/import/figure_writer.hpp"
#include "tools/import/identifiable.hpp"
#include "tools/import/model_writer.hpp"
#include "tools/import/robot_writer.hpp"
#include "tools/robot/clearance_file.hpp"

namespace tiller::tools {
namespace {

struct Options {
  std::string description, folder, details, base = "fixed";
  Words unknown, hold, armature, frame, sphere, value, contact;
  std::string sphere_file;
  double margin_rad = 0.0;
  bool any_inertia = false, servos = false, force = false, keep_unidentifiable = false, model_only = false;
};

int complain_all(const std::vector<std::string>& errors) {
  for (const std::string& error : errors) (void)complain(error);
  return kExitBadInput;
}

bool exists(const std::string& path) {
  struct stat status = {};
  return ::stat(path.c_str(), &status) == 0;
}

/// "JOINT=NUMBER", or the name alone where `fallback` is given.
bool read_pair(const char* option, const std::string& word, const double* fallback, std::string& joint, double& value,
               std::vector<std::string>& errors) {
  const std::size_t equals = word.find('=');
  joint = word.substr(0, equals);
  if (equals == std::string::npos && fallback != nullptr) {
    value = *fallback;
    return true;
  }
  char* end = nullptr;
  value = equals == std::string::npos ? NAN : std::strtod(word.c_str() + equals + 1, &end);
  if (std::isfinite(value) && end != word.c_str() + equals + 1 && *end == '\0') return true;
  errors.push_back(std::string(option) + " " + word + ": write " + (fallback != nullptr ? "JOINT or " : "") +
                   "JOINT=NUMBER, in SI units");
  return false;
}

bool read_joint_options(const Options& o, MechanismOptions& options, std::vector<std::string>& errors) {
  const double zero = 0.0;
  for (const std::string& word : o.hold) {
    MechanismOptions::Held held;
    if (read_pair("--hold", word, &zero, held.joint, held.position, errors)) options.held.push_back(held);
  }
  for (const std::string& word : o.armature) {
    MechanismOptions::Armature armature;
    if (!read_pair("--armature", word, nullptr, armature.joint, armature.inertia, errors)) continue;
    if (armature.inertia < 0.0)
      errors.push_back("--armature " + word + ": an inertia is not negative");
    else
      options.armature.push_back(armature);
  }
  return errors.empty();
}

/// "LINK:X,Y,Z,RADIUS"
bool read_sphere(const std::string& word, Spheres& spheres, std::vector<std::string>& errors) {
  const std::size_t colon = word.rfind(':');
  const Words cells = colon == std::string::npos || colon == 0 ? Words{} : csv_cells(word.substr(colon + 1));
  double value[4] = {};
  bool good = cells.size() == 4;
  for (std::size_t i = 0; good && i < 4; ++i) {
    char* end = nullptr;
    value[i] = std::strtod(cells[i].c_str(), &end);
    good = !cells[i].empty() && *end == '\0' && std::fabs(value[i]) < 1e6;
  }
  if (!good || !(value[3] > 0.0)) {
    errors.push_back("--sphere " + word + ": write LINK:X,Y,Z,RADIUS, in m in the link's frame, with a radius above 0");
    return false;
  }
  Sphere sphere{"", word.substr(0, colon), {value[0], value[1], value[2]}, value[3]};
  int on_link = 1;
  for (const Sphere& other : spheres.list) on_link += other.link == sphere.link ? 1 : 0;
  sphere.name = identifier(sphere.link) + "_" + std::to_string(on_link);
  for (const Sphere& other : spheres.list)
    if (other.name == sphere.name) {
      errors.push_back("--sphere " + word + ": would be called " + sphere.name + " as one on link '" + other.link +
                       "' is; rename a link in the description");
      return false;
    }
  spheres.list.push_back(sphere);
  return true;
}

/// Of the options, of the file that they name, and with --model-only of the robot file that stays.
bool read_spheres(const Options& o, Spheres& spheres, std::vector<std::string>& errors) {
  const std::string robot = o.folder + "/robot.toml";
  const std::string file = o.sphere_file.empty() && o.model_only ? robot : o.sphere_file;
  if (o.model_only && !exists(robot)) {
    errors.push_back(robot +
                     ": is not there, so that --model-only would leave a model without a robot file; leave it out");
    return false;
  }
  if (o.model_only && !(o.sphere.empty() && o.sphere_file.empty())) {
    errors.push_back("--model-only takes the spheres of " + robot +
                     "; write them there, without --sphere and --spheres");
    return false;
  }
  if (!file.empty() && !o.sphere.empty()) {
    errors.push_back("--sphere and --spheres: use one of them; a file has as many as you like");
    return false;
  }
  if (!file.empty() && !read_sphere_file(file, spheres, errors)) return false;
  for (const std::string& word : o.sphere) (void)read_sphere(word, spheres, errors);
  if (!o.sphere_file.empty() && spheres.empty() && errors.empty())
    errors.push_back(file + ": has no spheres in a section [cost.clearance]");
  return errors.empty();
}

/// The command that writes the same model, without what belongs to the robot file alone.
std::string command_text(const Options& o) {
  const auto quoted = [](const std::string& word) {
    return word.find_first_of(" *'\"$&;()<>|\\") == std::string::npos ? word : "'" + word + "'";
  };
  std::string text = "tiller import " + quoted(o.description) + " -o " + quoted(o.folder);
  const auto add = [&](const char* option, const Words& words) {
    if (!words.empty()) text += std::string(" ") + option + " " + quoted(join(words, ","));
  };
  add("--unknown", o.unknown);
  add("--frame", o.frame);
  add("--hold", o.hold);
  add("--armature", o.armature);
  add("--contact", o.contact);
  if (o.base != "fixed") text += " --base " + o.base;
  if (o.any_inertia) text += " --any-inertia";
  if (o.servos) text += " --servos";
  return text;
}

/// Head of a header: how it was written, and the spheres that it knows.
std::string head_of(const Options& o, const Spheres& spheres) {
  if (spheres.empty()) return "";
  std::string text = command_mark() + command_text(o) + "\n";
  for (const std::string& mark : all_marks(spheres)) text += mark + "\n";
  return text;
}

/// The link that hangs on the longest chain of joints, behind its fixed joints; -1: nothing moves.
int last_frame(const Mechanism& mechanism) {
  int longest = 0, frame = -1;
  for (std::size_t i = 0; i < mechanism.frames.size(); ++i) {
    if (!mechanism.frames[i].is_link) continue;
    int depth = 0;
    for (int b = mechanism.frames[i].body; b >= 0; b = mechanism.bodies[static_cast<std::size_t>(b)].parent) ++depth;
    // the last of several: what hangs on fixed joints comes after what it hangs on
    if (depth >= longest && depth > 0) {
      longest = depth;
      frame = static_cast<int>(i);
    }
  }
  return frame;
}

/// The frames that are told of; the first carries the payload.
bool read_frames(const Mechanism& mechanism, const Words& wanted, std::vector<int>& frames,
                 std::vector<std::string>& errors) {
  constexpr std::size_t kMost = TILLER_MAX_OUTPUTS / 12;
  if (wanted.empty()) {
    if (const int last = last_frame(mechanism); last >= 0) frames.push_back(last);
    return true;
  }
  for (const std::string& word : wanted) {
    const int frame = mechanism.find_frame(word);
    if (frame < 0) {
      Words names;
      for (const NamedFrame& f : mechanism.frames) names.push_back(f.name);
      const std::string near = nearest(word, names);
      errors.push_back("--frame " + word + ": no link or site is called so" +
                       (near.empty() ? "; there are " + join(names) : "; is '" + near + "' meant?"));
    } else if (mechanism.frames[static_cast<std::size_t>(frame)].body < 0) {
      errors.push_back("--frame " + word + ": belongs to the base, which does not move; name a link behind a joint");
    } else {
      frames.push_back(frame);
    }
  }
  if (frames.size() > kMost)
    errors.push_back("--frame: " + std::to_string(frames.size()) + " frames where a model may tell of " +
                     std::to_string(kMost) + "; name fewer");
  return errors.empty();
}

bool outputs_fit(const Spheres& spheres, const SphereOutputs& distances, std::size_t frames,
                 std::vector<std::string>& errors) {
  const std::size_t all = 12 * frames + distances.outputs.size();
  if (all <= TILLER_MAX_OUTPUTS) return true;
  errors.push_back(
      "spheres: " + std::to_string(spheres.list.size()) + " of them make " + std::to_string(distances.outputs.size()) +
      " distances, which with " + std::to_string(frames) + " frame(s) of 12 outputs is more than the " +
      std::to_string(TILLER_MAX_OUTPUTS) +
      " outputs of a model; use fewer spheres, or name links in may_touch whose distance is nobody's worry");
  return false;
}

/// Of a model without inputs.
std::string why_undriven(const Mechanism& mechanism) {
  if (mechanism.idle_drives.empty())
    return ", so there is nothing to control: what moves is held, follows or has no motor";
  return ": the file's actuators drive " + join(mechanism.idle_drives) +
         ", and only those at hinges and slides are read; give the joints motors there, or take <actuator> out, and every "
         "joint is taken as driven";
}

/// What leaves a model with enough joints less, as options.
std::string ways_out(const Options& o, const Mechanism& mechanism, const ModelNames& names, std::size_t many) {
  Words own;
  std::size_t of_base = 0;
  for (const int b : names.bodies) {
    const std::string& joint = mechanism.bodies[static_cast<std::size_t>(b)].joint;
    const bool is_base = o.base != "fixed" && joint.rfind("base_", 0) == 0;
    of_base += is_base ? 1 : 0;
    if (!is_base) own.push_back(joint);
  }
  Words ways;
  if (of_base == 6 && many <= 3)
    ways.push_back("--hold base_y,base_yaw,base_roll: the base moves in its x-z plane alone");
  if (const std::string pattern = pattern_of(own, many); !pattern.empty()) ways.push_back("--hold " + pattern);
  if (of_base >= many) ways.push_back("no --base: the joints alone, " + std::to_string(own.size()));
  ways.push_back("--hold JOINT[=POSITION],... of joints that do not matter; there are " + join(own));
  return "hold " + std::to_string(many) + " or more:\n  " + join(ways, "\n  ");
}

/// What a model may have; the remedy names joints to hold.
bool within_limits(const Options& o, const Mechanism& mechanism, const ModelNames& names, const Unknowns& unknowns,
                   std::vector<std::string>& errors) {
  const auto over = [&](const char* what, std::size_t has, int most, const std::string& remedy) {
    if (has > static_cast<std::size_t>(most))
      errors.push_back(mechanism.path + ": " + std::to_string(has) + " " + what + " where a model may have " +
                       std::to_string(most) + "; " + remedy);
  };
  const std::size_t many = names.joints.size() > TILLER_MAX_JOINTS ? names.joints.size() - TILLER_MAX_JOINTS : 0;
  over("joints", names.joints.size(), TILLER_MAX_JOINTS, ways_out(o, mechanism, names, many));
  static_assert(2 * TILLER_MAX_JOINTS <= TILLER_MAX_STATES, "a position and a speed for each joint");
  if (many > 0) return false;  // what follows counts the same joints
  static_assert(TILLER_MAX_INPUTS >= TILLER_MAX_JOINTS, "an input for each joint");
  std::size_t effects = unknowns.payload ? 1 : 0;
  for (const JointFriction& f : unknowns.friction) effects += (f.viscous.empty() ? 0 : 1) + (f.dry.empty() ? 0 : 1);
  std::size_t of_servos = 0;  // a servo has three parameters
  for (const MovingBody& b : mechanism.bodies) {
    if (b.mimics >= 0) continue;
    effects += (b.stiffness > 0.0 ? 1 : 0) + (b.stiffness * b.rest + b.offset != 0.0 ? 1 : 0) + (b.has_goal() ? 1 : 0);
    of_servos += b.has_goal() ? 2 : 0;
  }
  const std::string fewer = "name fewer with --unknown, or hold joints: --hold JOINT[=POSITION],...";
  over("parameters", unknowns.parameters.size() + effects + of_servos, TILLER_MAX_PARAMS, fewer);
  over("effects of friction, springs and servos", effects, TILLER_MAX_EFFECTS, fewer);
  if (names.inputs.empty()) errors.push_back(mechanism.path + ": no joint is driven" + why_undriven(mechanism));
  return errors.empty();
}

/// Up to so many the filter's intervals were found right for arms (docs/evidence/robots.md).
constexpr std::size_t kManyUnknowns = 3;

std::size_t unknown_count(const Unknowns& unknowns) {
  std::size_t count = unknowns.payload ? 1 : 0;
  for (const ModelParameter& p : unknowns.parameters) count += p.is_held ? 0 : 1;
  for (const JointFriction& f : unknowns.friction)
    for (const std::string* text : {&f.viscous, &f.dry}) count += text->find('{') != std::string::npos ? 1 : 0;
  return count;
}

/// Copies the description beside the robot file and makes sure that a plant can be made of it; the reason against it is
/// a note. False with `error` where the copy cannot be written.
bool make_plant(const Options& o, const MechanismOptions& options, const Mechanism& mechanism,
                const std::string& compiled, const std::string& frame, DescribedPlant& plant,
                std::vector<std::string>& notes, std::string& error) {
  if (options.base != BaseKind::fixed) {
    notes.push_back(o.description + ": a base that moves has no ODE plant; [sim] plant = \"model\"");
    return true;
  }
  if (!mechanism.contacts.empty()) {
    notes.push_back(o.description + ": contacts have no ODE plant; [sim] plant = \"model\"");
    return true;
  }
  if (std::any_of(mechanism.bodies.begin(), mechanism.bodies.end(), [](const MovingBody& b) { return b.has_goal(); })) {
    notes.push_back(o.description + ": servos have no ODE plant; [sim] plant = \"model\"");
    return true;
  }
  if (mechanism.gravity_m_s2[0] != 0.0) {
    notes.push_back(o.description + ": gravity that is not along z has no ODE plant; [sim] plant = \"model\"");
    return true;
  }
  plant.frame = frame;
  for (const auto& held : options.held) plant.hold[held.joint] = held.position;
  for (const auto& armature : options.armature) plant.armature[armature.joint] = armature.inertia;
  plant.file = o.description;
  // what MuJoCo has compiled can be read where there is no MuJoCo, nor the file's meshes
  const std::string json = identifier(mechanism.name) + ".json";
  if (!compiled.empty()) {
    plant.file = o.folder + "/" + json;
    if (!replace_file(plant.file, compiled, error)) return false;
  }
  std::vector<std::string> problems;
  if (!describe_plant(plant, problems)) {
    for (const std::string& problem : problems) notes.push_back(problem);
    plant = {};
    return true;
  }
  if (!compiled.empty()) {
    plant.file = json;
    return true;
  }
  const std::string name = o.description.substr(o.description.find_last_of('/') + 1), copy = o.folder + "/" + name;
  std::ifstream from(o.description, std::ios::binary);
  std::stringstream text;
  text << from.rdbuf();
  plant.file = name;
  std::error_code none;
  return std::filesystem::equivalent(o.description, copy, none) || replace_file(copy, text.str(), error);
}

int write_files(const Options& o, const MechanismOptions& options, const Description& description,
                const Mechanism& mechanism, const Unknowns& unknowns, const std::vector<int>& frames,
                const Spheres& spheres, const SphereOutputs& distances, const ModelSensors& sensors) {
  const int frame = frames.empty() ? -1 : frames.front();
  const WrittenModel model = write_model(mechanism, unknowns, frame, frames, distances, sensors.motions);
  const std::string stem = identifier(mechanism.name), header = stem + ".hpp";
  const std::string robot_path = o.folder + "/robot.toml", model_path = o.folder + "/" + header;
  const std::string frame_name = frame >= 0 ? mechanism.frames[static_cast<std::size_t>(frame)].name : "";
  for (const std::string& path : {robot_path, model_path})
    if (!o.force && !o.model_only && exists(path))
      return complain(path + " is there already; write it anew with --force, the model alone with --model-only");
  std::string error;
  make_folders_for(robot_path);
  DescribedPlant plant;
  std::vector<std::string> notes = mechanism.notes;
  if (!make_plant(o, options, mechanism, description.compiled, frame_name, plant, notes, error)) return complain(error);
  if (!replace_file(model_path, head_of(o, spheres) + model.text, error)) return complain(error);
  const std::string figure = write_figure(description, options, mechanism, model.names, frames);
  if (!o.model_only && !replace_file(robot_path,
                                     write_robot(mechanism, unknowns, model.names, header, frame_name, plant,
                                                 {o.margin_rad, spheres, sensors, figure}),
                                     error))
    return complain(error);
  for (const std::string& note : notes) std::printf("note: %s\n", note.c_str());
  if (const std::size_t count = unknown_count(unknowns); count > kManyUnknowns)
    std::printf(
        "note: %zu unknown parameters: with more than %zu the intervals of an arm's filter come out too narrow; name what "
        "matters most, fix the rest at values that `tiller identify` finds\n",
        count, kManyUnknowns);
  std::printf(
      "%s: %zu joints, %zu inputs, %zu parameters; %d operations for the accelerations, %d for the inverse inertia, "
      "%d for the frames' poses\n",
      mechanism.name.c_str(), model.names.joints.size(), model.names.inputs.size(), unknowns.parameters.size(),
      model.operations, model.response_operations, model.output_operations);
  std::printf("  %s\n  %s\n", model_path.c_str(), robot_path.c_str());
  if (!frame_name.empty())
    std::printf("  frame %s carries the payload and has targets in [cost]; others: --frame NAME,...\n",
                frame_name.c_str());
  if (!mechanism.left_out.empty()) std::printf("neither in the model nor in its simulated plant:\n");
  for (const std::string& what : mechanism.left_out) std::printf("  %s\n", what.c_str());
  std::printf("next:\n  tiller check %s\n  tiller run %s --sim --seconds 5 --report %s/run.html\n", robot_path.c_str(),
              robot_path.c_str(), o.folder.c_str());
  return kExitOk;
}

/// Contacts that settle too fast for any step that a robot file may have.
bool can_be_stepped(const Mechanism& mechanism, std::vector<std::string>& errors) {
  if (contact_substeps(mechanism, kImportPeriod_s) > 0) return true;
  for (const ContactPair& pair : mechanism.contacts)
    if (Mechanism one = {}; one.contacts.push_back(pair), contact_substeps(one, kImportPeriod_s) == 0)
      errors.push_back("--contact " + pair.spelled + ": " + mechanism.path + " lets it settle in " +
                       number_text(pair.law.settle_s) + " s (damping ratio " + number_text(pair.law.damping_ratio) +
                       "), which takes more than the 64 steps that a period of " + number_text(kImportPeriod_s) +
                       " s may have; write a softer solref, for example solref=\"0.005 1\"");
  return false;
}

/// Options that the other kind of file has no use for are refused: whoever gives them takes the file for another one.
bool options_fit(const Options& o, bool is_function) {
  const auto refuse = [&](bool given, const char* option) {
    if (given)
      (void)complain(std::string(option) + ": " + o.description +
                     (is_function ? " is a CasADi function" : " is no CasADi function") + ", which has no use for it");
    return given;
  };
  bool bad = false;
  if (is_function) {
    bad |= refuse(!o.frame.empty(), "--frame");
    bad |= refuse(!o.hold.empty(), "--hold");
    bad |= refuse(!o.armature.empty(), "--armature");
    bad |= refuse(!o.contact.empty(), "--contact");
    bad |= refuse(o.base != "fixed", "--base");
    bad |= refuse(o.any_inertia, "--any-inertia");
    bad |= refuse(o.servos, "--servos");
    bad |= refuse(!o.sphere.empty(), "--sphere");
    bad |= refuse(!o.sphere_file.empty(), "--spheres");
    bad |= refuse(o.margin_rad > 0.0, "--margin");
    bad |= refuse(o.model_only, "--model-only");
    bad |= refuse(o.keep_unidentifiable, "--keep-unidentifiable");
  } else {
    bad |= refuse(!o.value.empty(), "--value");
    bad |= refuse(!o.details.empty(), "--details");
  }
  return !bad;
}

/// Notes and comments on what no motion can tell; without --keep-unidentifiable that is held at the description's.
void judge_unknowns(const Options& o, int payload_frame, Mechanism& mechanism, Unknowns& unknowns) {
  const Identifiability found = find_identifiable(mechanism, unknowns, payload_frame);
  if (!o.keep_unidentifiable) hold_unidentifiable(found, unknowns);
  comment_parameters(found, unknowns);
  for (const std::string& note : identifiable_notes(found, !o.keep_unidentifiable)) mechanism.notes.push_back(note);
}

int import_command(Options& o) {
  std::vector<std::string> errors;
  if (std::filesystem::is_directory(o.description))
    return complain(o.description + ": is a folder; name the description in it");
  const bool has_function = is_function(o.description);
  if (!options_fit(o, has_function)) return kExitBadInput;
  if (has_function) return import_function({o.description, o.folder, o.details, o.unknown, o.value, o.force});
  if (o.description.size() > 3 && o.description.compare(o.description.size() - 3, 3, ".py") == 0)
    return complain(o.description + ": a Python source is not run; let it write the function, f.save(\"" +
                    o.description.substr(0, o.description.size() - 3) + ".casadi\"), and import that file");
  MechanismOptions options;
  options.any_inertia = o.any_inertia;
  options.servos = o.servos;
  options.base = o.base == "free" ? BaseKind::free : o.base == "planar" ? BaseKind::planar : BaseKind::fixed;
  Description description;
  Mechanism mechanism;
  Unknowns unknowns;
  std::vector<int> frames;
  if (!read_joint_options(o, options, errors) || !read_description(o.description, description, errors) ||
      !expand_held(description, options, errors) || !build_mechanism(description, options, mechanism, errors) ||
      !choose_contacts(description, o.contact, mechanism, errors) || !can_be_stepped(mechanism, errors) ||
      !read_unknowns(o.unknown, mechanism, unknowns, errors) || !read_frames(mechanism, o.frame, frames, errors) ||
      !within_limits(o, mechanism, name_model(mechanism), unknowns, errors))
    return complain_all(errors);
  if (o.folder.empty()) o.folder = identifier(mechanism.name);
  while (o.folder.size() > 1 && o.folder.back() == '/') o.folder.pop_back();
  Spheres spheres;
  SphereOutputs distances;
  if (!read_spheres(o, spheres, errors) || !place_spheres(spheres, mechanism, distances, errors) ||
      !outputs_fit(spheres, distances, frames.size(), errors))
    return complain_all(errors);
  const int payload = frames.empty() ? -1 : frames.front();
  const ModelSensors sensors =
      place_sensors(description, name_model(mechanism),
                    TILLER_MAX_OUTPUTS - 12 * frames.size() - distances.outputs.size(), mechanism, frames);
  judge_unknowns(o, payload, mechanism, unknowns);
  return write_files(o, options, description, mechanism, unknowns, frames, spheres, distances, sensors);
}

constexpr char kImportFooter[] =
    "The equations are written out for this one robot (docs/guide/import.md); every command works with the result.\n\n"
    "Examples:\n"
    "  tiller import my_arm.urdf -o my_arm --unknown payload=2\n"
    "      my_arm/my_arm.hpp and my_arm/robot.toml, with a prior for the load\n"
    "  tiller import my_arm.urdf -o my_arm --sphere base:0,0,0.1,0.12 --sphere hand:0,0,0.05,0.06\n"
    "      the hand keeps away from the base; `tiller import my_arm.urdf -o my_arm --model-only` after spheres move\n"
    "  tiller import ur5.urdf --unknown mass:forearm_link --frame tool0 --hold wrist_3_joint\n"
    "      one mass in doubt, five joints\n"
    "  tiller import leg.xml --contact foot:plane --unknown contact:foot\n"
    "      the foot stands on the ground, with a prior for the friction\n"
    "  tiller import cart_pole.casadi --value pole_kg=0.2,length_m=0.5 --unknown pole_kg\n"
    "      xdot = f(x, u, p) as CasADi saved it; symbols' names become the names of states and parameters";

}  // namespace

int import_description(const std::string& description, const std::string& folder) {
  Options options;
  options.description = description;
  options.folder = folder;
  return import_command(options);
}

void add_import_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand(
      "import", "a robot's description (URDF, MJCF) or CasADi function into a model and its robot file");
  auto o = std::make_shared<Options>();
  command
      ->add_option("DESCRIPTION", o->description,
                   "URDF, of a xacro what `xacro FILE` prints; MJCF, .mjb, read by the Python\npackage mujoco; "
                   "what casadi.Function.save wrote, read by the package casadi;\nor the JSON that an import keeps")
      ->required();
  command->add_option("-o,--output", o->folder, "folder for the model's header and robot.toml [the robot's name]");
  command
      ->add_option("--unknown", o->unknown,
                   "what is uncertain: payload[=KG], mass:LINK, inertia:LINK, friction:JOINT, gain:JOINT,\n"
                   "contact:GEOM (its friction);\n"
                   "of a function: its parameters; * for every one; several by commas")
      ->delimiter(',');
  command
      ->add_option(
          "--contact", o->contact,
          "of an MJCF: GEOM:plane or GEOM:GEOM2, a pair that pushes at each other: a sphere, a capsule's ends\n"
          "or a box's corners on a plane, a box or a sphere; several by commas. Others pass through each other")
      ->delimiter(',');
  command
      ->add_option(
          "--frame", o->frame,
          "links, or an MJCF's sites, whose poses costs and logs know; the first carries the payload\n[the last link]")
      ->delimiter(',');
  command->add_option("--base", o->base, "fixed, planar (x, y, yaw) or free (x, y, z, yaw, pitch, roll) [fixed]")
      ->check(CLI::IsMember({"fixed", "planar", "free"}));
  command
      ->add_option("--hold", o->hold,
                   "joints that do not move: JOINT or JOINT=POSITION, of a base that moves too (base_yaw);\n"
                   "'*_hip' for every one called so; several by commas")
      ->delimiter(',');
  command
      ->add_option("--armature", o->armature,
                   "rotor inertia behind the gear, where the description has none: JOINT=KGM2, *=KGM2; by commas")
      ->delimiter(',');
  command->add_option(
      "--sphere", o->sphere,
      "LINK:X,Y,Z,RADIUS, as often as needed: a sphere on a link, in m in its frame, that is to stay apart\n"
      "from those of other links; obstacles and a floor: --spheres");
  command->add_option("--spheres", o->sphere_file,
                      "a TOML file with the section [cost.clearance] (docs/reference/costs.md)");
  command
      ->add_option("--margin", o->margin_rad,
                   "so many rad before its end a joint that turns begins to cost, in [cost] bounds [0]")
      ->check(CLI::Range(0.0, 3.0));
  command->add_flag("--model-only", o->model_only,
                    "write the model anew, with the spheres of the folder's robot.toml, which stays as it is");
  command->add_flag(
      "--keep-unidentifiable", o->keep_unidentifiable,
      "infer also the unknowns that no motion identifies; a filter with few particles reports intervals\nfor them that are too narrow; without this flag they are fixed at the description's values");
  command->add_flag("--servos", o->servos,
                    "of an MJCF: actuators act by their laws, so that the input of a position servo is its goal");
  command->add_flag("--any-inertia", o->any_inertia, "take inertias that no body can have as they are");
  command->add_option("--value", o->value, "of a function's parameters: NAME=NUMBER; several by commas")
      ->delimiter(',');
  command->add_option("--details", o->details,
                      "about a function: TOML or JSON with names, parameters, limits, joints, angles, period_s\n"
                      "[<function>.details.toml or .details.json beside it]");
  command->add_flag("--force", o->force, "write over files that are there");
  command->footer(kImportFooter);
  command->callback([o, &exit_code] { exit_code = import_command(*o); });
}

}  // namespace tiller::tools
