// The header and the robot file of a model that a function became.

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/import/function_model.hpp"
#include "tools/import/model_text.hpp"

namespace tiller::tools {
namespace {

std::string file_name(const std::string& path) { return path.substr(path.find_last_of('/') + 1); }
bool ends_with(const std::string& text, const std::string& end) {
  return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// ---- the header -------------------------------------------------------------------------------------

/// From so many operations on a model is differentiated in one text (tiller/model.hpp, long_dynamics).
constexpr int kLong = 150;

/// Hides <cmath>'s names where the numbers are plain: "    using tiller::sin;".
std::string using_text(const ExpressionGraph& graph, const std::vector<Expression>& of) {
  std::string out;
  for (const std::string& name : called_functions(graph, of)) out += "    using tiller::" + name + ";\n";
  return out;
}

std::string joints_text(const FunctionModel& m) {
  std::string text = "  static constexpr tiller_joint_t joints[] = {  // position, velocity, force, 1 + input\n";
  for (std::size_t j = 0; j < m.joints.size(); ++j) {
    const FunctionJoint& joint = m.joints[j];
    text += "      {\"" + joint.name + "\", " +
            (joint.position < 0 ? "TILLER_NO_POSITION" : std::to_string(joint.position)) + ", " +
            std::to_string(joint.velocity) + ", " + std::to_string(j) + ", " + std::to_string(joint.drive + 1) + "},\n";
  }
  return text + "  };\n";
}

// ---- the robot file ---------------------------------------------------------------------------------

constexpr double kPeriod_s = 0.02;
constexpr double kPriorShare = 0.25, kPriorOfZero = 0.1;
/// The default task moves the first position by so much.
constexpr double kMove = 0.3;

class RobotText {
 public:
  explicit RobotText(const FunctionModel& model) : m_(model) {}

  std::string write(const std::string& header) {
    out_ += "# " + m_.name + ", imported from " + file_name(m_.path) +
            ". `tiller import` writes this file once; it is yours to change.\n"
            "# Every key: `tiller help robot-file`.\n\n[robot]\nname = \"" +
            m_.name + "\"\n\n[model]\nfile = \"" + header + "\"\ntype = \"" + m_.type +
            "\"\nperiod_s = " + number_text(period_s()) + "\n\n";
    parameters();
    measurement();
    task();
    limits();
    plant();
    return out_;
  }

 private:
  double period_s() const { return m_.period_s > 0.0 ? m_.period_s : kPeriod_s * m_.time_unit_s; }
  /// Of a random walk whose standard deviation after one of the function's own units of time is `sd`.
  std::string walk(double sd) const {
    return m_.time_unit_s == 1.0 ? number_text(sd) : format("%.2g", sd / std::sqrt(m_.time_unit_s));
  }
  bool is_velocity(std::size_t state) const {
    return std::find(m_.velocity_of.begin(), m_.velocity_of.end(), static_cast<int>(state)) != m_.velocity_of.end();
  }
  static bool is_place(const std::string& name) { return ends_with(name, "_rad") || ends_with(name, "_m"); }
  static double encoder(const std::string& name) { return is_place(name) ? 0.001 : 0.01; }
  bool is_unknown() const {
    return std::any_of(m_.parameters.begin(), m_.parameters.end(),
                       [](const FunctionParameter& p) { return p.is_unknown; });
  }

  template <class Value>
  static std::string table(const Words& keys, const Value& value) {
    std::string text;
    for (std::size_t k = 0; k < keys.size(); ++k) {
      const std::string v = value(k);
      if (!v.empty()) text += (text.empty() ? " " : ", ") + keys[k] + " = " + v;
    }
    return "{" + text + " }";
  }

  static std::string prior(const FunctionParameter& p) {
    if (!p.is_unknown) return number_text(p.value);
    if (p.value > 0.0) return "{ log_normal = [" + number_text(p.value) + ", " + number_text(kPriorShare) + "] }";
    const double sd = p.value < 0.0 ? kPriorShare * -p.value : kPriorOfZero;
    return "{ normal = [" + number_text(p.value) + ", " + format("%.6g", sd) + "] }";
  }
  void parameters() {
    if (m_.parameters.empty()) return;
    out_ += "[parameters]\n";
    for (const FunctionParameter& p : m_.parameters) out_ += p.name + " = " + prior(p) + "\n";
    out_ += "\n";
  }

  void measurement() {
    out_ += "[measurement]   # every state but speeds; correct what the machine does not measure\n";
    for (std::size_t k = 0; k < m_.states.size(); ++k)
      if (!is_velocity(k)) out_ += m_.states[k] + " = { sd = " + number_text(encoder(m_.states[k])) + " }\n";
    out_ +=
        "\n[noise]\n# what the equations do not know, as a random walk of each state: its standard deviation after a second\n"
        "process_sd = " +
        table(m_.states,
              [&](std::size_t k) {
                return walk(is_velocity(k) ? 0.05 : m_.velocity_of[k] >= 0 ? 0.001 : 0.01);
              }) +
        "\n\n";
    out_ +=
        is_unknown()
            ? "[posterior]\nparticles = 64\n\n"
            : "# nothing is unknown: one hypothesis would do\n[posterior]\nenabled = false\nparticles = 16\nmoves_per_tick = 8\n\n";
  }

  void task() {
    out_ += std::string(m_.is_smooth ? "" : "# the equations have branches or steps: samples look beyond them\n") +
            "[planner]\nkind = \"" + (m_.is_smooth ? "ilqr" : "hybrid") + "\"\nhorizon = 40\nparticles = 1\n" +
            noise() + "\n" + "# a first task: the first state moves by " + number_text(kMove) +
            ", all others return to where they start\n[cost]\ntarget = { " + m_.states[0] + " = " + number_text(kMove) +
            " }\n";
    const auto weights = [&](const char* place, const char* speed) {
      return table(m_.states, [&](std::size_t k) { return std::string(is_velocity(k) ? speed : place); });
    };
    out_ += "state_weight = " + weights("10", "0.1") + "\nterminal_weight = " + weights("100", "10") + "\n";
    const auto effort = [&](std::size_t i) {
      const double most = std::max(std::fabs(m_.limits[i].first), std::fabs(m_.limits[i].second));
      return format("%.3g", 0.1 / (most * most));
    };
    out_ += "input_weight = " + table(m_.inputs, effort) + "\ninput_rate_weight = " + table(m_.inputs, effort) + "\n\n";
  }

  /// How far samples look: a sixth of the range, so that they reach its ends.
  std::string noise() const {
    if (m_.is_smooth) return "";
    const auto sd = [&](std::size_t i) { return format("%.3g", (m_.limits[i].second - m_.limits[i].first) / 6.0); };
    return "noise_sd = " + table(m_.inputs, sd) + "\n";
  }

  void limits() {
    out_ += "[limits]\n";
    for (std::size_t i = 0; i < m_.inputs.size(); ++i) {
      const auto& [low, high] = m_.limits[i];
      const double safe = std::min(std::max(0.0, low), high);
      out_ += m_.inputs[i] + " = { low = " + number_text(low) + ", high = " + number_text(high) +
              ", safe = " + number_text(safe) + " }" +
              (m_.limit_stated[i] ? "" : "   # nobody states it: write the machine's") + "\n";
    }
    out_ += "\n[safety]\nsensor_timeout_s = " + number_text(5.0 * period_s()) + "\n\n";
  }

  void plant() {
    out_ +=
        "# The simulated plant: this model, stepped ten times finer, with parameters that the controller does not know.\n"
        "# It checks the loop, not the model; only a plant with equations of its own (or the robot) does that.\n"
        "[sim]\nplant = \"model\"\nseed = 1\n";
    if (is_unknown()) out_ += "draw = true               # from the priors above, by the seed\n";
    for (std::size_t k = 0; k < m_.states.size(); ++k)
      if (!is_velocity(k))
        out_ += "sensors." + m_.states[k] + " = { sd = " + number_text(encoder(m_.states[k])) + " }\n";
  }

  const FunctionModel& m_;
  std::string out_;
};

}  // namespace

WrittenFunction write_function_model(FunctionModel& m) {
  WrittenFunction out;
  Words values, told, parameters;
  const std::string code = emit_code(m.graph, m.derivatives, "    ", values, &out.operations);
  std::string told_code;
  if (!m.told.empty()) told_code = emit_code(m.graph, m.told, "    ", told, &out.output_operations);
  for (const FunctionParameter& p : m.parameters) parameters.push_back(p.name);
  const bool is_long = out.operations > kLong;
  const std::string with_params = parameters.empty() ? "" : ", [[maybe_unused]] const Params& p";

  std::string& text = out.text;
  text = "#pragma once\n\n#include \"tiller/model.hpp\"\n\n/// " + m.name + ", from " + file_name(m.path) +
         " by `tiller import`, which writes it anew: the instructions of a CasADi function, " +
         std::to_string(out.operations) +
         "\n/// operations. What is not an argument of the function changes nothing: " +
         "[body] gravity and payloads.\ntemplate <class S>\nstruct " + m.type +
         " {\n  static constexpr const char* name = \"" + m.name + "\";\n";
  text += fields_text("State", m.states) + fields_text("Input", m.inputs);
  if (!parameters.empty()) text += fields_text("Params", parameters);
  if (!m.forces.empty()) text += fields_text("Force", m.forces) + joints_text(m);
  if (m.angles != 0) text += "  static constexpr unsigned angles = " + format("0x%xu", m.angles) + ";\n";
  if (is_long) text += "  static constexpr bool long_dynamics = true;\n";
  text += std::string("\n  ") + (is_long ? "__attribute__((noinline)) " : "") +
          "static State dynamics([[maybe_unused]] const State& x, [[maybe_unused]] const Input& u" +
          ",\n                        " + (m.forces.empty() ? "" : "[[maybe_unused]] const Force& f, ") +
          "const tiller::Body<S>&" + with_params + ") {\n" + using_text(m.graph, m.derivatives) + code +
          "    return {" + listed(values, "            ") + "};\n  }\n";
  if (!m.told.empty())
    text += "\n" + fields_text("Output", m.outputs) + "  static Output outputs([[maybe_unused]] const State& x" +
            with_params + ") {\n" + using_text(m.graph, m.told) + told_code + "    return {" +
            listed(told, "            ") + "};\n  }\n";
  text += "};\n";
  return out;
}

std::string write_function_robot(const FunctionModel& model, const std::string& header) {
  return RobotText(model).write(header);
}

}  // namespace tiller::tools
