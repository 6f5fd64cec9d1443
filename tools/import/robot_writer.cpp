#include "tools/import/robot_writer.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/import/articulated_body.hpp"
#include "tools/import/contact_choice.hpp"
#include "tools/import/mechanism_task.hpp"

namespace tiller::tools {
namespace {

/// What a description that states no effort is taken for.
constexpr double kUnstatedEffort = 10.0;
/// The default task moves each joint so far from where it starts. A servo's goal moves as fast as this where the
/// description states no speed, and a change of a tenth in a period costs what a tenth of a radian does.
constexpr double kGoal_rad_s = 3.0, kGoal_m_s = 0.5, kGoalWeight = 10.0;
constexpr double kMove_rad = 0.3, kMove_m = 0.05;
constexpr double kPeriod_s = kImportPeriod_s;
/// A joint at twice its largest speed costs this much a period; full effort costs 0.1.
constexpr double kSpeedWeight = 1000.0;
/// Share of the effort that nobody explains, from tick to tick.
constexpr double kUnknownForce = 0.002;
/// A touch that comes within a period changes speeds by as much as this, of a joint whose robot has contacts.
constexpr double kTouch_m_s = 0.3, kTouch_rad_s = 3.0;
constexpr double kEncoder_rad = 0.0005, kEncoder_m = 0.0001;
/// Of a speed whose sensor states no noise: the difference of two such readings, a period apart.
constexpr double kRate_rad_s = 0.07, kRate_m_s = 0.014;
/// Weights of the default task: of positions and speeds, and at a plan's end.
constexpr double kStage[] = {10.0, 0.1}, kTerminal[] = {100.0, 10.0};
/// Periods that a plan looks ahead: enough for an arm that is driven at every joint, and what a tick has time for.
constexpr std::uint32_t kFewestPeriods = 20, kMostPeriods = 100;

class RobotText {
 public:
  RobotText(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& names, const TaskExtras& extras)
      : mechanism_(mechanism),
        unknowns_(unknowns),
        names_(names),
        extras_(extras),
        start_(start_position(mechanism)),
        mobility_(mobility(mechanism, start_)) {}

  std::string write(const std::string& header, const std::string& payload_frame, const DescribedPlant& made) {
    out_ += "# " + mechanism_.name + ", imported from " + file_name(mechanism_.path) +
            ". `tiller import` writes this file once; it is yours to change.\n"
            "# Every key: `tiller help robot-file`.\n";
    if (!mechanism_.left_out.empty()) out_ += "# Neither in the model nor in its simulated plant:\n";
    for (const std::string& what : mechanism_.left_out) out_ += "# - " + what + "\n";
    out_ += "\n[robot]\nname = \"" + identifier(mechanism_.name) + "\"\n\n[model]\nfile = \"" + header +
            "\"\ntype = \"" + names_.type + "\"\nperiod_s = " + number_text(kPeriod_s) +
            "\nintegrator = \"midpoint\"\n" + substeps() + "\n";
    parameters();
    gravity();
    effects(payload_frame);
    measurement();
    task(payload_frame);
    safety();
    logged();
    out_ += extras_.figure;
    plant(made);
    return out_;
  }

 private:
  static std::string file_name(const std::string& path) { return path.substr(path.find_last_of('/') + 1); }
  const MovingBody& body(std::size_t joint) const {
    return mechanism_.bodies[static_cast<std::size_t>(names_.bodies[joint])];
  }
  std::size_t joints() const { return names_.joints.size(); }
  const MovingBody& driven_body(std::size_t input) const { return body(driven(input)); }
  static double effort(const MovingBody& b) { return b.effort < 1e6 ? b.effort : kUnstatedEffort; }

  /// "{ a = 1, b = 2 }" of what `value` says for each joint; empty texts are left out.
  template <class Value>
  std::string table(const std::vector<std::string>& keys, const Value& value) const {
    std::string text;
    for (std::size_t j = 0; j < keys.size(); ++j) {
      const std::string v = value(j);
      if (!v.empty()) text += (text.empty() ? " " : ", ") + keys[j] + " = " + v;
    }
    return "{" + text + " }";
  }

  double start(std::size_t joint) const { return start_[static_cast<std::size_t>(names_.bodies[joint])]; }
  double target(std::size_t joint) const {
    const MovingBody& b = body(joint);
    if (!b.actuated) return start(joint);
    const double room = std::isfinite(b.high - b.low) ? 0.2 * (b.high - b.low) : INFINITY;
    const double move = std::min(b.prismatic ? kMove_m : kMove_rad, room);
    const double up = start(joint) + move;
    return round_to(up <= b.high ? up : start(joint) - move);
  }
  /// Dry friction at many joints asks for short steps, which many joints cannot have within a tick.
  std::string substeps() const {
    if (const unsigned steps = contact_substeps(mechanism_, kPeriod_s); steps > 1)
      return "substeps = " + std::to_string(steps) + "   # a contact settles in two steps or more\n";
    return joints() > 3 && unknowns_.friction.size() > 3
               ? "substeps = 2   # `tiller check` asks for more, for friction's sake; a tick then takes longer\n"
               : "";
  }
  static double round_to(double value) { return std::round(1e6 * value) / 1e6; }

  bool has_priors() const {
    return !std::all_of(unknowns_.parameters.begin(), unknowns_.parameters.end(),
                        [](const ModelParameter& p) { return p.is_held; });
  }
  void parameters() {
    if (unknowns_.parameters.empty()) return;
    out_ += "[parameters]\n";
    for (const ModelParameter& p : unknowns_.parameters) {
      if (p.kind == ModelParameter::Kind::inertia && p.slot == 0)
        out_ += "# ten coordinates of " + p.about + "'s inertia; 0 is the description's\n";
      out_ += p.name + " = " + p.prior();
      if (!p.comment.empty()) out_ += "   # " + p.comment;
      out_ += "\n";
    }
    out_ += "\n";
  }

  void effect(const char* list, const char* kind, const std::string& joint, const char* key, const std::string& value) {
    if (!value.empty())
      out_ += std::string("[[") + list + "]]\nkind = \"" + kind + "\"\nport = \"" + identifier(joint) + "\"\n" + key +
              " = " + value + "\n\n";
  }

  void effects(const std::string& payload_frame) {
    if (unknowns_.payload)
      out_ += "# carried at " + payload_frame + "\n[[effects]]\nkind = \"payload\"\nmass_kg = { uniform = [0.0, " +
              number_text(unknowns_.payload_kg) + "] }\n\n";
    for (const JointFriction& f : unknowns_.friction) {
      effect("effects", "viscous_friction", f.joint, "damping_SI", f.viscous);
      effect("effects", "coulomb_friction", f.joint, "friction_SI", f.dry);
    }
    springs("effects");
    servos("effects");
  }

  void servos(const char* list) {
    for (std::size_t i = 0; i < names_.inputs.size(); ++i) {
      const MovingBody& b = driven_body(i);
      if (!b.has_goal()) continue;
      if (list == std::string("effects")) out_ += "# " + b.law.kind + ": the input is its goal" + control(b.law) + "\n";
      out_ += std::string("[[") + list + "]]\nkind = \"position_servo\"\nport = \"" + names_.inputs[i] +
              "\"\nstiffness_SI = " + number_text(b.law.stiffness) + "\ndamping_SI = " + number_text(b.law.damping) +
              "\nlimit_SI = " + (std::isfinite(b.law.limit) ? number_text(b.law.limit) : "0   # none") + "\n\n";
    }
  }
  static std::string control(const DriveLaw& law) {
    if (law.goal_per_control == 1.0 && law.goal_at_zero == 0.0) return "";
    return "; goal = " + (law.goal_at_zero != 0.0 ? number_text(law.goal_at_zero) + " + " : "") +
           number_text(law.goal_per_control) + " times MuJoCo's ctrl";
  }

  /// A spring about another position than 0 is one about 0 and a constant force.
  void springs(const char* list) {
    for (std::size_t j = 0; j < joints(); ++j) {
      const MovingBody& b = body(j);
      const double constant = b.stiffness * b.rest + b.offset;
      if (b.stiffness > 0.0) effect(list, "linear_spring", b.joint, "stiffness_SI", number_text(b.stiffness));
      if (constant != 0.0) effect(list, "constant_offset", b.joint, "force_SI", number_text(constant));
    }
  }

  void gravity() {
    const Vec3<double>& g = mechanism_.gravity_m_s2;
    if (g[0] != 0.0 || g[2] != -9.81)
      out_ += "[body]\ngravity_x_m_s2 = " + number_text(g[0]) + "\ngravity_z_m_s2 = " + number_text(g[2]) + "\n\n";
  }

  void measurement() {
    out_ += "[measurement]\n";
    for (const bool speeds : {false, true})
      for (std::size_t j = 0; j < joints(); ++j)
        if (const double sd = measured_sd(j, speeds); sd > 0.0)
          out_ += state(j, speeds) + " = { sd = " + number_text(sd) + " }" + unstated(j, speeds) + "\n";
    for (std::size_t j = 0; j < joints(); ++j)
      if (!(measured_sd(j, false) > 0.0) && !(measured_sd(j, true) > 0.0))
        out_ += "# the description has no sensor of " + names_.joints[j] +
                ", whose motion shows in the others' alone; an encoder: " + names_.positions[j] +
                " = { sd = " + number_text(encoder_sd(j)) + " }\n";
    const bool touches = !mechanism_.contacts.empty();
    out_ +=
        "\n[noise]\n# what the equations do not know: " +
        std::string(touches ? "when within a period something touches"
                            : "a force of 0.2 % of the effort in a period, as a random walk of the speeds") +
        "\nprocess_sd = " +
        table(names_.velocities,
              [&](std::size_t j) {
                const double gain = mobility_[static_cast<std::size_t>(names_.bodies[j])];
                const double least = !touches ? 0.01 : body(j).prismatic ? kTouch_m_s : kTouch_rad_s;
                return format("%.2g", std::max(least, kUnknownForce * effort(body(j)) * gain * std::sqrt(kPeriod_s)));
              }) +
        "\n\n";
    out_ += "[start]\nstate = " +
            table(names_.positions,
                  [&](std::size_t j) { return start(j) != 0.0 ? number_text(round_to(start(j))) : std::string(); }) +
            "\n\n";
    const bool vague = std::any_of(unknowns_.friction.begin(), unknowns_.friction.end(), [](const JointFriction& f) {
      return f.viscous.find('{') != std::string::npos || f.dry.find('{') != std::string::npos;
    });
    if (!has_priors() && !unknowns_.payload && !vague)
      out_ +=
          "# nothing is unknown: one hypothesis would do\n[posterior]\nenabled = false\nparticles = 16\nmoves_per_tick = 8\n\n";
    else
      out_ +=
          "# small, so that a tick of many joints stays short; `tiller size` tells what more would take\n"
          "[posterior]\nparticles = 64\nwindow = 16\nmoves_per_tick = 8\n\n";
  }

  const std::string& state(std::size_t joint, bool speed) const {
    return speed ? names_.velocities[joint] : names_.positions[joint];
  }
  double encoder_sd(std::size_t joint) const { return body(joint).prismatic ? kEncoder_m : kEncoder_rad; }
  /// As the description's sensors have it; of one without any every position is measured. NaN: not measured.
  double measured_sd(std::size_t joint, bool speed) const {
    const ModelSensors& sensors = extras_.sensors;
    if (sensors.position_sd.empty()) return speed ? NAN : encoder_sd(joint);
    const double sd = (speed ? sensors.velocity_sd : sensors.position_sd)[joint];
    if (sd != 0.0) return sd;
    return !speed ? encoder_sd(joint) : body(joint).prismatic ? kRate_m_s : kRate_rad_s;
  }
  std::string unstated(std::size_t joint, bool speed) const {
    const ModelSensors& sensors = extras_.sensors;
    if (sensors.position_sd.empty()) return "";
    return (speed ? sensors.velocity_sd : sensors.position_sd)[joint] == 0.0 ? "   # the description states no noise"
                                                                             : "";
  }
  bool measures_speeds() const {
    for (std::size_t j = 0; j < joints(); ++j)
      if (measured_sd(j, true) > 0.0) return true;
    return false;
  }

  /// Sensors that no state is measured by, for whoever has them in the logs.
  void logged() {
    if (extras_.sensors.logged.empty()) return;
    out_ +=
        "# What else the description's sensors read. Where your logs have these columns, take the marks away: `tiller gap`\n"
        "# then fits by them too. The controller itself measures states alone.\n# [log]\n# sensors = [\n";
    for (const LoggedSensor& s : extras_.sensors.logged)
      out_ += "#   { column = \"" + s.column + "\", of = \"" + s.of + "\"" +
              (s.derivative > 0 ? ", derivative = " + std::to_string(s.derivative) : "") +
              (s.accelerometer ? ", accelerometer = true" : "") + ", sd = " + (s.sd > 0.0 ? number_text(s.sd) : "...") +
              (s.zero != 0.0 ? ", zero = " + number_text(s.zero) : "") + " },   # " + s.unit + "\n";
    out_ += "# ]\n\n";
  }

  void task(const std::string& frame) {
    const bool sticks = std::any_of(unknowns_.friction.begin(), unknowns_.friction.end(),
                                    [](const JointFriction& f) { return !f.dry.empty(); });
    if (sticks) out_ += "# a joint that sticks has no gradient: samples find the force that frees it\n";
    out_ += std::string("[planner]\nkind = \"") + (sticks ? "hybrid" : "ilqr") + "\"\n" + horizon() +
            "particles = 1\niterations = 2\n\n"
            "# full effort for a tick costs what a tenth of a radian does\n[cost]\n";
    out_ += "target = " + table(names_.positions, [&](std::size_t j) { return number_text(target(j)); }) + "\n";
    std::vector<std::string> states = names_.positions;
    states.insert(states.end(), names_.velocities.begin(), names_.velocities.end());
    const auto weights = [&](double position, double velocity) {
      return table(states, [&](std::size_t i) { return number_text(i < joints() ? position : velocity); });
    };
    out_ += "state_weight = " + weights(kStage[0], kStage[1]) +
            "\nterminal_weight = " + weights(kTerminal[0], kTerminal[1]) + "\n";
    const auto effort_weight = [&](std::size_t i) {
      return driven_body(i).has_goal() ? std::string() : format("%.3g", effort_weight_of(i));
    };
    const auto rate_weight = [&](std::size_t i) {
      return format("%.3g", driven_body(i).has_goal() ? kGoalWeight : effort_weight_of(i));
    };
    const std::string weights_of_inputs = table(names_.inputs, effort_weight);
    if (weights_of_inputs != "{ }") out_ += "input_weight = " + weights_of_inputs + "\n";
    out_ += "input_rate_weight = " + table(names_.inputs, rate_weight) + "\n";
    bounds();
    frame_target(frame);
    out_ += "\n";
    if (!extras_.spheres.empty()) out_ += clearance_text(extras_.spheres);
  }

  static double reach(const MovingBody& b) { return std::max(0.1, b.goal_high() - b.goal_low()); }
  double effort_weight_of(std::size_t input) const {
    const MovingBody& b = driven_body(input);
    const double e = b.has_goal() ? reach(b) : effort(b);
    return 0.1 / (e * e);
  }

  /// As long as the description's own model asks for at this task.
  std::string horizon() const {
    LinearTask task;
    task.period_s = kPeriod_s;
    for (std::size_t i = 0; i < names_.inputs.size(); ++i) {
      task.effort.push_back(effort_weight_of(i));
      task.reach.push_back(driven_body(i).has_goal() ? reach(driven_body(i)) : effort(driven_body(i)));
    }
    std::vector<double> goal = start_;
    for (std::size_t j = 0; j < joints(); ++j) goal[static_cast<std::size_t>(names_.bodies[j])] = target(j);
    for (const double* weight : {kStage, kTerminal})
      for (std::size_t i = 0; i < 2 * joints(); ++i)
        (weight == kStage ? task.stage : task.terminal).push_back(weight[i < joints() ? 0 : 1]);
    linearise_mechanism(mechanism_, names_, start_, goal, task);
    const HorizonAdvice advice = advise_horizon(task, kMostPeriods);
    if (advice.needed <= kFewestPeriods) return "horizon = " + std::to_string(kFewestPeriods) + "\n";
    return "horizon = " + std::to_string(advice.needed) + "   # " + advice.reason + "\n";
  }

  /// The same target told by where the tool would be; for whoever would rather say it so.
  void frame_target(const std::string& name) {
    const int index = mechanism_.find_frame(name);
    if (index < 0) return;
    const NamedFrame& frame = mechanism_.frames[static_cast<std::size_t>(index)];
    ArticulatedBody<double> tree(mechanism_, {});
    std::vector<double> position = start_;
    for (std::size_t j = 0; j < joints(); ++j) position[static_cast<std::size_t>(names_.bodies[j])] = target(j);
    for (std::size_t i = 0; i < mechanism_.bodies.size(); ++i) {
      const MovingBody& b = mechanism_.bodies[i];
      if (b.mimics >= 0) position[i] = b.mimic_ratio * position[static_cast<std::size_t>(b.mimics)] + b.mimic_offset;
    }
    tree.place(position);
    const Vec3<double> p = tree.point(frame.body, frame.pose.position);
    Mat3<double> r;
    for (int c = 0; c < 3; ++c) {
      const Vec3<double> axis =
          tree.direction(frame.body, {frame.pose.rotation(0, c), frame.pose.rotation(1, c), frame.pose.rotation(2, c)});
      for (int k = 0; k < 3; ++k) r(k, c) = axis[static_cast<std::size_t>(k)];
    }
    const double pitch = std::atan2(-r(2, 0), std::hypot(r(0, 0), r(1, 0)));
    const double roll = std::atan2(r(2, 1), r(2, 2)), yaw = std::atan2(r(1, 0), r(0, 0));
    const auto triple = [](double a, double b, double c) { return format("[%.4f, %.4f, %.4f]", a, b, c); };
    out_ += "# or where the tool is wanted, in the base's axes; then without the positions' weights above\n# frames." +
            identifier(name) + " = { position_m = " + triple(p[0], p[1], p[2]) +
            ", weight = 1000, rpy_rad = " + triple(roll, pitch, yaw) + ", rotation_weight = 100 }\n";
  }

  void bounds() {
    std::string rows;
    for (std::size_t j = 0; j < joints(); ++j) {
      const MovingBody& b = body(j);
      if (!std::isfinite(b.low) || !std::isfinite(b.high)) continue;
      rows += "bounds." + names_.positions[j] + " = { low = " + number_text(b.low) + ", high = " + number_text(b.high) +
              (b.prismatic || !(extras_.margin_rad > 0.0) ? "" : ", margin = " + number_text(extras_.margin_rad)) +
              ", weight = 1000 }\n";
    }
    if (!rows.empty()) out_ += "# the joints' ends, as costs\n" + rows;
    std::string speeds;
    for (std::size_t j = 0; j < joints(); ++j) {
      const double speed = body(j).speed;
      if (!(speed < 1e6)) continue;
      const std::string most = number_text(speed);
      speeds += "bounds." + names_.velocities[j] + " = { low = -" + most + ", high = " + most +
                ", weight = " + format("%.3g", kSpeedWeight / (speed * speed)) + " }\n";
    }
    if (!speeds.empty()) out_ += "# and their largest speeds\n" + speeds;
  }

  /// The joint that input i drives.
  std::size_t driven(std::size_t i) const {
    return static_cast<std::size_t>(std::find(names_.input_of.begin(), names_.input_of.end(), static_cast<int>(i)) -
                                    names_.input_of.begin());
  }

  void safety() {
    out_ += "[limits]\n";
    for (std::size_t i = 0; i < names_.inputs.size(); ++i) {
      const MovingBody& b = driven_body(i);
      if (b.has_goal()) {
        goal_limits(names_.inputs[i], driven(i));
        continue;
      }
      const std::string e = number_text(effort(b));
      out_ += names_.inputs[i] + " = { low = -" + e + ", high = " + e + ", safe = 0 }" +
              (b.effort < 1e6 ? "" : "   # the description states none: write the motor's") + "\n";
    }
    out_ += "\n[safety]\nsensor_timeout_s = 0.05\n";
    if (std::any_of(names_.bodies.begin(), names_.bodies.end(),
                    [&](int b) { return mechanism_.bodies[static_cast<std::size_t>(b)].has_goal(); }))
      out_ += "# without a plan, and in SAFE, a servo goes to `safe`, as fast as its rate allows\n";
    if (std::any_of(names_.bodies.begin(), names_.bodies.end(), [&](int b) {
          const MovingBody& one = mechanism_.bodies[static_cast<std::size_t>(b)];
          return one.actuated && !one.has_goal();
        }))
      out_ += "# brakes while no plan can be had; a joint under gravity sinks\n";
    for (std::size_t i = 0; i < names_.inputs.size(); ++i) {
      const std::size_t j = driven(i);
      if (body(j).has_goal()) continue;
      const double speed = body(j).speed < 1e6 ? body(j).speed : 3.0;
      out_ += "hold_gain." + names_.inputs[i] + " = { " + names_.velocities[j] + " = " +
              format("%.3g", 0.2 * effort(body(j)) / speed) + " }\n";
    }
    std::string ranges;
    for (std::size_t j = 0; j < joints(); ++j) {
      const MovingBody& b = body(j);
      if (!std::isfinite(b.low) || !std::isfinite(b.high)) continue;
      const double margin = 0.05 * (b.high - b.low);
      ranges += "#   " + names_.positions[j] + " = { sd = ..., low = " + format("%.4g", b.low - margin) +
                ", high = " + format("%.4g", b.high + margin) + " }\n";
    }
    if (!ranges.empty())
      out_ += "\n# a reading beyond its joint's ends is refused where [measurement] says so:\n" + ranges;
    out_ += "\n";
  }

  /// Of a servo's goal: a position, which begins where the joint stands.
  void goal_limits(const std::string& input, std::size_t joint) {
    const MovingBody& b = body(joint);
    const double speed = b.speed < 1e6 ? b.speed : b.prismatic ? kGoal_m_s : kGoal_rad_s;
    const double safe = std::clamp(round_to(start(joint)), b.goal_low(), b.goal_high());
    out_ += input + " = { low = " + number_text(b.goal_low()) + ", high = " + number_text(b.goal_high()) +
            ", safe = " + number_text(safe) + ", rate_per_s = " + number_text(speed) + " }   # a position\n";
  }

  void plant(const DescribedPlant& made) {
    if (made.file.empty())
      out_ +=
          "# The simulated plant: this model, stepped ten times finer, with parameters that the controller does not know.\n"
          "# It checks the loop, not the model; only a plant with equations of its own (or the robot) does that.\n"
          "[sim]\nplant = \"model\"\nseed = 1\n";
    else
      out_ +=
          "# The simulated plant: an ODE world made from the description, which shares no equation with the model.\n"
          "[sim]\nplant = \"urdf\"\nfile = \"" +
          made.file + "\"\n" + (made.frame.empty() ? "" : "frame = \"" + made.frame + "\"\n") +
          numbers("hold", made.hold) + numbers("armature", made.armature) +
          (mechanism_.gravity_m_s2[2] != -9.81
               ? "parameters.gravity_m_s2 = " + number_text(-mechanism_.gravity_m_s2[2]) + "\n"
               : "") +
          "seed = 1\n";
    if (has_priors()) out_ += "draw = true               # from the priors above, by the seed\n";
    if (measures_speeds()) out_ += "rates = true              # the plant measures speeds too\n";
    for (const bool speeds : {false, true})
      for (std::size_t j = 0; j < joints(); ++j)
        if (const double sd = measured_sd(j, speeds); sd > 0.0)
          out_ += "sensors." + state(j, speeds) + " = { sd = " + number_text(0.5 * sd) + " }\n";
    out_ += "\n";
    if (unknowns_.payload)
      out_ += "[[sim.effects]]\nkind = \"payload\"\nmass_kg = " + number_text(round_to(0.4 * unknowns_.payload_kg)) +
              "\n\n";
    for (const JointFriction& f : unknowns_.friction) {
      const auto value = [](double v) { return v > 0.0 ? format("%.4g", v) : std::string(); };
      effect("sim.effects", "viscous_friction", f.joint, "damping_SI", value(f.plant_viscous));
      effect("sim.effects", "coulomb_friction", f.joint, "friction_SI", value(f.plant_dry));
    }
    springs("sim.effects");
    servos("sim.effects");
  }

  static std::string numbers(const std::string& key, const std::map<std::string, double>& values) {
    std::string text;
    for (const auto& [name, value] : values)
      text += (text.empty() ? " \"" : ", \"") + name + "\" = " + number_text(value);
    return text.empty() ? "" : key + " = {" + text + " }\n";
  }

  const Mechanism& mechanism_;
  const Unknowns& unknowns_;
  const ModelNames& names_;
  const TaskExtras& extras_;
  const std::vector<double> start_, mobility_;
  std::string out_;
};

}  // namespace

std::string write_robot(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& names,
                        const std::string& header, const std::string& payload_frame, const DescribedPlant& plant,
                        const TaskExtras& extras) {
  return RobotText(mechanism, unknowns, names, extras).write(header, payload_frame, plant);
}

}  // namespace tiller::tools
