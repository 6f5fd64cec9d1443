#include "tools/import/function_model.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "tools/base/unit_names.hpp"
#include "tools/import/function_equations.hpp"
#include "tools/import/model_text.hpp"
#include "tools/import/unknowns.hpp"

namespace tiller::tools {
namespace {

using Op = ExpressionGraph::Op;

/// What a part of the function is called: ours first, then what else is usual.
const Words kStateNames{"x"}, kInputNames{"u"}, kParameterNames{"p"}, kForceNames{"f", "force", "forces"};
const Words kDerivativeNames{"xdot", "ode", "dx", "x_dot", "dxdt", "rhs"}, kOutputNames{"y"};

/// Limits of an input that nobody states, by its unit.
constexpr double kForceLimit = 10.0, kAngleLimit = 0.5, kLimit = 1.0;
/// Sums in another order differ by some 1e-15 of their terms; what is wrong differs by much more.
constexpr double kSame = 1e-9;
constexpr double kTurn_rad = 6.283185307179586;

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}
/// "pole" of "pole_rad".
std::string without_unit(const std::string& name) {
  for (const char* unit : {"_rad_s", "_m_s", "_rad", "_m", "_Nm", "_N"})
    if (ends_with(name, unit)) return name.substr(0, name.size() - std::string(unit).size());
  return name;
}
bool has(const Words& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}
int index_of(const Words& words, const std::string& word) {
  const auto found = std::find(words.begin(), words.end(), word);
  return found == words.end() ? -1 : static_cast<int>(found - words.begin());
}
std::size_t at(int i) { return static_cast<std::size_t>(i); }
bool near(double a, double b) { return std::fabs(a - b) <= kSame * (1.0 + std::fabs(b)); }

/// What a C++ struct of TILLER_FIELDS cannot call a member.
bool is_taken(const std::string& name) {
  static const std::set<std::string> words{
      "alignas",   "alignof",   "and",      "asm",      "auto",  "bitand",   "bitor",     "bool",     "break",
      "case",      "catch",     "char",     "class",    "compl", "const",    "constexpr", "continue", "decltype",
      "default",   "delete",    "do",       "double",   "else",  "enum",     "explicit",  "export",   "extern",
      "false",     "float",     "for",      "friend",   "goto",  "if",       "inline",    "int",      "long",
      "mutable",   "namespace", "new",      "noexcept", "not",   "nullptr",  "operator",  "or",       "private",
      "protected", "public",    "register", "return",   "short", "signed",   "sizeof",    "static",   "struct",
      "switch",    "template",  "this",     "throw",    "true",  "try",      "typedef",   "typeid",   "typename",
      "union",     "unsigned",  "using",    "virtual",  "void",  "volatile", "while",     "xor",      "linux",
      "unix",      "S",         "Fields",   "names",    "count", "NAN",      "INFINITY",  "NULL",     "EOF"};
  return words.count(name) > 0 || name.find("__") != std::string::npos || (name[0] == '_') ||
         name.rfind("TILLER_", 0) == 0;
}

class Builder {
 public:
  Builder(const FunctionText& function, FunctionModel& model, Words& errors)
      : function_(function), details_(function.details), model_(model), errors_(errors) {}

  void build(const Words& unknown) {
    model_.path = function_.path;
    model_.name = identifier(details_.name.empty() ? function_.name : details_.name);
    model_.type = type_name(model_.name);
    model_.period_s = details_.period_s;
    if (!find_ports() || !check_shapes() || !name_all() || !find_velocities() || !read_joint_details()) return;
    if (!rebuild() || !check_samples() || !finish_joints()) return;
    read_parameters(unknown);
    read_limits();
    find_angles();
    take_time_unit();
    note_the_rest();
  }

 private:
  void error(const std::string& what) { errors_.push_back(function_.path + ": " + what); }
  void note(const std::string& what) { model_.notes.push_back(function_.path + ": " + what); }
  /// Where a person would write what is missing.
  std::string details_path() const {
    if (!details_.path.empty()) return details_.path;
    return function_.path.substr(0, function_.path.rfind('.')) + ".details.toml";
  }
  void details_error(const std::string& key, const std::string& what) {
    errors_.push_back(details_path() + ": " + key + " " + what);
  }
  static std::string meant(const std::string& word, const Words& known) {
    const std::string near = nearest(word, known);
    return near.empty() ? "; there are " + join(known) : "; is '" + near + "' meant?";
  }

  // ---- which argument is which ----

  bool is_unnamed() const {
    const auto by_number = [](const std::vector<FunctionPort>& ports, const char* letter) {
      for (std::size_t i = 0; i < ports.size(); ++i)
        if (ports[i].name != letter + std::to_string(i)) return false;
      return true;
    };
    return by_number(function_.inputs, "i") && by_number(function_.outputs, "o");
  }
  static int find(const std::vector<FunctionPort>& ports, const Words& names) {
    for (std::size_t i = 0; i < ports.size(); ++i)
      if (has(names, ports[i].name)) return static_cast<int>(i);
    return -1;
  }
  static std::string listed_ports(const std::vector<FunctionPort>& ports) {
    Words names;
    for (const FunctionPort& port : ports) names.push_back(port.name);
    return join(names);
  }

  bool find_ports() {
    const int inputs = static_cast<int>(function_.inputs.size()), outputs = static_cast<int>(function_.outputs.size());
    if (is_unnamed()) {
      x_ = inputs > 0 ? 0 : -1, u_ = inputs > 1 ? 1 : -1, p_ = inputs > 2 ? 2 : -1, f_ = inputs > 3 ? 3 : -1;
      xdot_ = outputs > 0 ? 0 : -1, y_ = outputs > 1 ? 1 : -1;
      if (x_ >= 0 && u_ >= 0)
        note("its arguments have no names: taken as x, u, p, f in this order, results as xdot, y");
    } else {
      x_ = find(function_.inputs, kStateNames), u_ = find(function_.inputs, kInputNames);
      p_ = find(function_.inputs, kParameterNames), f_ = find(function_.inputs, kForceNames);
      xdot_ = find(function_.outputs, kDerivativeNames), y_ = find(function_.outputs, kOutputNames);
    }
    const std::string example = "name them: Function(\"f\", [x, u, p], [xdot], [\"x\", \"u\", \"p\"], [\"xdot\"])";
    for (const auto& [index, name] : {std::pair{x_, "x (states)"}, std::pair{u_, "u (inputs)"}})
      if (index < 0)
        error(std::string("has no argument ") + name + "; there are " + listed_ports(function_.inputs) + "; " +
              example);
    if (xdot_ < 0)
      error("has no result xdot (derivatives); there are " + listed_ports(function_.outputs) + "; " + example);
    for (int k = 0; k < outputs; ++k)
      if (k != xdot_ && k != y_)
        note("result '" + function_.outputs[at(k)].name + "' is not read; results are xdot and y");
    if (f_ >= 0 && function_.inputs[at(f_)].size() == 0) f_ = -1;
    if (p_ >= 0 && function_.inputs[at(p_)].size() == 0) p_ = -1;
    if (y_ >= 0 && function_.outputs[at(y_)].size() == 0) y_ = -1;
    return errors_.empty();
  }

  const FunctionPort& input(int i) const { return function_.inputs[at(i)]; }

  static std::string shape_text(const FunctionPort& port) {
    return "is " + std::to_string(port.rows) + " x " + std::to_string(port.columns);
  }
  /// A vector without elements that are always 0.
  void expect_vector(const FunctionPort& port) {
    const bool dense = port.size() == at(port.rows) * at(port.columns);
    if ((port.rows != 1 && port.columns != 1) || port.size() == 0 || !dense)
      error(port.name + " " + shape_text(port) + (dense ? "" : " with structural zeros") +
            "; it has to be a dense column");
  }
  bool check_shapes() {
    expect_vector(input(x_));
    expect_vector(input(u_));
    if (f_ >= 0) expect_vector(input(f_));
    if (p_ >= 0 && input(p_).size() < at(input(p_).rows) * at(input(p_).columns))
      error("p " + shape_text(input(p_)) + " with structural zeros; make it dense, or a vector of what is not 0");
    const FunctionPort &x = input(x_), &xdot = function_.outputs[at(xdot_)];
    if (errors_.empty() && (xdot.columns != 1 || xdot.rows != static_cast<int>(x.size())))
      error(xdot.name + " " + shape_text(xdot) + " where x has " + std::to_string(x.size()) +
            " elements; the derivative of each state is wanted, in the states' order");
    if (y_ >= 0 && function_.outputs[at(y_)].columns != 1)
      error("y " + shape_text(function_.outputs[at(y_)]) + "; it has to be a column");
    if (!errors_.empty()) return false;
    for (const FunctionSample& sample : function_.samples) {
      bool fits = sample.in.size() == function_.inputs.size() && sample.out.size() == function_.outputs.size();
      for (std::size_t i = 0; fits && i < sample.in.size(); ++i)
        fits = sample.in[i].size() == function_.inputs[i].size();
      for (std::size_t i = 0; fits && i < sample.out.size(); ++i)
        fits = sample.out[i].size() == function_.outputs[i].size();
      if (!fits) error("a sample has not the function's shape; write it anew from the function");
      if (!fits) return false;
    }
    return true;
  }

  // ---- names ----

  /// The elements' names: of the details, else the symbols'.
  Words names_of(const std::string& key, const Words& symbols) {
    Words out;
    const auto given = details_.names.find(key);
    if (given == details_.names.end()) {
      for (const std::string& symbol : symbols) out.push_back(identifier(symbol));
      return out;
    }
    if (given->second.size() != symbols.size()) {
      details_error("names." + key, "has " + std::to_string(given->second.size()) + " names where the function has " +
                                        std::to_string(symbols.size()) + " elements");
      return symbols;
    }
    for (const std::string& name : given->second)
      if (name.empty() || identifier(name) != name)
        details_error("names." + key, "has '" + name + "'; names are letters, digits and underscores, a letter first");
    return given->second;
  }

  void check_names(const std::string& key, const Words& names, std::set<std::string>& seen) {
    for (const std::string& name : names) {
      const std::string how = "; name the elements in " + details_path() + ": names." + key + " = [...]";
      if (is_taken(name)) error("an element of " + key + " is called '" + name + "', a word of C++ or of tiller" + how);
      if (!seen.insert(name).second) error("two elements are called '" + name + "', one of " + key + how);
    }
  }

  bool name_all() {
    model_.states = names_of("x", input(x_).elements);
    model_.inputs = names_of("u", input(u_).elements);
    if (p_ >= 0) parameter_names_ = names_of("p", input(p_).elements);
    if (f_ >= 0) force_names_ = names_of("f", input(f_).elements);
    if (y_ >= 0) {
      Words plain;
      for (int i = 0; i < function_.outputs[at(y_)].rows; ++i) plain.push_back("y_" + std::to_string(i));
      model_.outputs = names_of("y", plain);
    }
    for (const auto& [key, names] : details_.names)
      if (!has({"x", "u", "p", "f", "y"}, key)) details_error("names." + key, "is none of names.x, u, p, f, y");
    std::set<std::string> columns, forces;  // all but the forces stand in one log
    check_names("x", model_.states, columns);
    check_names("u", model_.inputs, columns);
    check_names("y", model_.outputs, columns);
    check_names("p", parameter_names_, columns);
    check_names("f", force_names_, forces);
    return errors_.empty();
  }

  // ---- joints ----

  /// Positions, by what their derivative is: another state, as it is.
  bool find_velocities() {
    model_.velocity_of.assign(model_.states.size(), -1);
    std::vector<int> holds(1, -1);  // (work) the state that stands there
    std::vector<bool> is_velocity(model_.states.size());
    const auto state_at = [&](int place) { return place >= 0 && at(place) < holds.size() ? holds[at(place)] : -1; };
    for (const FunctionInstruction& i : function_.instructions) {
      if (i.op == "output" && i.result == xdot_ && i.operands.size() == 2) {
        const FunctionPort& xdot = function_.outputs[at(xdot_)];
        if (i.operands[0] < 0 || at(i.operands[0]) >= xdot.size()) continue;
        const int position = xdot.row[at(i.operands[0])], velocity = state_at(i.operands[1]);
        if (velocity < 0 || velocity == position || is_velocity[at(velocity)] || at(position) >= model_.states.size())
          continue;
        model_.velocity_of[at(position)] = velocity;
        is_velocity[at(velocity)] = true;
      } else if (i.op != "output" && i.result >= 0 && i.result < kMostWork) {
        if (at(i.result) >= holds.size()) holds.resize(at(i.result) + 1, -1);
        const bool is_state = i.op == "input" && i.operands.size() == 2 && i.operands[0] == x_ && i.operands[1] >= 0 &&
                              at(i.operands[1]) < model_.states.size();
        holds[at(i.result)] = is_state ? i.operands[1] : -1;
      }
    }
    return true;
  }

  int position_of(int velocity) const {
    for (std::size_t k = 0; k < model_.velocity_of.size(); ++k)
      if (model_.velocity_of[k] == velocity) return static_cast<int>(k);
    return -1;
  }

  /// Joints that the details name: each with an element of f or an input as its force.
  bool read_joint_details() {
    for (const FunctionDetails::Joint& wanted : details_.joints) {
      const std::string key = "joints." + wanted.name;
      FunctionJoint joint;
      joint.name = wanted.name;
      joint.velocity = index_of(model_.states, wanted.velocity);
      joint.position = joint.velocity < 0 ? -1 : position_of(joint.velocity);
      if (identifier(wanted.name) != wanted.name) details_error(key, "is no name of letters, digits and underscores");
      if (joint.velocity < 0)
        details_error(key, "has velocity = \"" + wanted.velocity + "\", which is no state" +
                               meant(wanted.velocity, model_.states));
      Words forces = force_names_;
      forces.insert(forces.end(), model_.inputs.begin(), model_.inputs.end());
      if (!has(forces, wanted.force))
        details_error(key, "has force = \"" + wanted.force + "\", which is no input and no element of f" +
                               meant(wanted.force, forces));
      else if (has(model_.forces, wanted.force))
        details_error(key, "has force = \"" + wanted.force + "\", which is another joint's already");
      if (index_of(force_names_, wanted.force) < 0) joint.drive = index_of(model_.inputs, wanted.force);
      model_.joints.push_back(joint);
      model_.forces.push_back(wanted.force);
    }
    return errors_.empty() && match_forces();
  }

  /// Elements of f that no detail names: by name, "cart_N" for "cart_m", else one for each position, in their order.
  bool match_forces() {
    Words open;
    for (const std::string& force : force_names_)
      if (!has(model_.forces, force)) open.push_back(force);
    std::vector<int> positions;
    for (std::size_t k = 0; k < model_.states.size(); ++k) {
      const int velocity = model_.velocity_of[k];
      const bool is_named = std::any_of(model_.joints.begin(), model_.joints.end(),
                                        [&](const FunctionJoint& j) { return j.velocity == velocity; });
      if (velocity >= 0 && !is_named) positions.push_back(static_cast<int>(k));
    }
    const auto add = [&](const std::string& force, int position) {
      const std::string& state = model_.states[at(position)];
      const std::string name = without_unit(state);  // "a" of "a_rad", but once
      const bool taken = std::any_of(model_.joints.begin(), model_.joints.end(),
                                     [&](const FunctionJoint& j) { return j.name == name; });
      model_.joints.push_back({taken ? state : name, position, model_.velocity_of[at(position)], -1});
      model_.forces.push_back(force);
    };
    Words unmatched;
    for (const std::string& force : open) {
      const auto same = std::find_if(positions.begin(), positions.end(),
                                     [&](int k) { return without_unit(model_.states[at(k)]) == without_unit(force); });
      if (same == positions.end()) {
        unmatched.push_back(force);
      } else {
        add(force, *same);
        positions.erase(same);
      }
    }
    if (unmatched.size() == positions.size()) {
      for (std::size_t k = 0; k < unmatched.size(); ++k) add(unmatched[k], positions[k]);
    } else if (!unmatched.empty()) {
      Words free;
      for (const int k : positions) free.push_back(model_.states[at(k)]);
      error("forces " + join(unmatched) + " have no joint: positions whose derivative is a state are " + join(free) +
            "; say in " + details_path() + " where they push: joints.NAME = { velocity = \"STATE\", force = \"" +
            unmatched[0] + "\" }");
    }
    return errors_.empty();
  }

  // ---- equations ----

  std::vector<std::vector<FunctionArgument>> arguments() {
    std::vector<std::vector<FunctionArgument>> out(function_.inputs.size());
    for (std::size_t i = 0; i < out.size(); ++i)
      for (std::size_t k = 0; k < function_.inputs[i].size(); ++k) out[i].push_back(argument(static_cast<int>(i), k));
    return out;
  }
  FunctionArgument argument(int port, std::size_t k) {
    if (port == x_) return {model_.graph.symbol("x." + model_.states[k]), ""};
    if (port == u_) {
      const Expression u = model_.graph.symbol("u." + model_.inputs[k]);
      const bool pushes = index_of(force_names_, model_.inputs[k]) < 0 && has(model_.forces, model_.inputs[k]);
      return {pushes ? u + model_.graph.symbol("f." + model_.inputs[k]) : u, ""};
    }
    if (port == p_) return {model_.graph.symbol("p." + parameter_names_[k]), ""};
    if (port == f_) return {model_.graph.symbol("f." + force_names_[k]), ""};
    const std::string& name = function_.inputs[at(port)].name;
    return {0.0, "argument '" + name + "'\narguments are x, u, p and f" +
                     (name == "t" ? ": equations do not depend on time; make it a state whose derivative is 1" : "")};
  }

  bool rebuild() {
    std::vector<std::vector<Expression>> results;
    if (!rebuild_equations(only_read(), arguments(), results, errors_)) return false;
    const auto dense = [&](int port, std::size_t rows) {
      std::vector<Expression> out(rows);
      const FunctionPort& shape = function_.outputs[at(port)];
      for (std::size_t k = 0; k < shape.size(); ++k)
        if (shape.row[k] >= 0 && at(shape.row[k]) < rows) out[at(shape.row[k])] = results[at(port)][k];
      return out;
    };
    model_.derivatives = dense(xdot_, model_.states.size());
    if (y_ >= 0) model_.told = dense(y_, model_.outputs.size());
    for (std::size_t k = 0; k < model_.outputs.size(); ++k)
      for (const std::string& symbol : symbols_of({model_.told[k]}))
        if (symbol[0] == 'u' || symbol[0] == 'f')
          error("y[" + std::to_string(k) + "] (" + model_.outputs[k] + ") depends on " + symbol +
                "; outputs are of states and parameters alone");
    model_.is_smooth = !has_branches();
    return errors_.empty();
  }
  /// Without results that nobody reads: what they need is not refused.
  FunctionText only_read() const {
    FunctionText out = function_;
    const auto is_read = [&](int port) { return port == xdot_ || port == y_ || at(port) >= function_.outputs.size(); };
    const auto is_idle = [&](const FunctionInstruction& i) { return i.op == "output" && !is_read(i.result); };
    out.instructions.erase(std::remove_if(out.instructions.begin(), out.instructions.end(), is_idle),
                           out.instructions.end());
    for (std::size_t k = 0; k < out.outputs.size(); ++k)
      if (!is_read(static_cast<int>(k))) out.outputs[k].row.clear();
    return out;
  }

  std::vector<bool> reached(const std::vector<Expression>& from) const {
    const auto& nodes = model_.graph.nodes();
    std::vector<bool> out(nodes.size());
    for (const Expression& x : from)
      if (!x.is_constant()) out[at(x.node())] = true;
    for (std::size_t i = nodes.size(); i-- > 0;)
      for (const std::int32_t operand : {nodes[i].a, nodes[i].b, nodes[i].c})
        if (out[i] && operand >= 0) out[at(operand)] = true;
    return out;
  }
  std::set<std::string> symbols_of(const std::vector<Expression>& from) const {
    const std::vector<bool> is = reached(from);
    std::set<std::string> out;
    for (std::size_t i = 0; i < is.size(); ++i)
      if (is[i] && model_.graph.nodes()[i].op == Op::symbol) out.insert(model_.graph.nodes()[i].text);
    return out;
  }
  std::set<std::string> all_symbols() const {
    std::vector<Expression> all = model_.derivatives;
    all.insert(all.end(), model_.told.begin(), model_.told.end());
    return symbols_of(all);
  }
  bool has_branches() const {
    const std::vector<bool> is = reached(model_.derivatives);
    for (std::size_t i = 0; i < is.size(); ++i)
      if (is[i])
        for (const Op op : {Op::select, Op::floor, Op::nearest, Op::copysign})
          if (model_.graph.nodes()[i].op == op) return true;
    return false;
  }

  // ---- values ----

  using Point = std::map<std::string, double>;
  Point point_of(const FunctionSample& sample) const {
    Point out;
    const auto put = [&](int port, const char* prefix, const Words& names) {
      for (std::size_t k = 0; port >= 0 && k < names.size(); ++k) out[prefix + names[k]] = sample.in[at(port)][k];
    };
    put(x_, "x.", model_.states);
    put(u_, "u.", model_.inputs);
    put(p_, "p.", parameter_names_);
    put(f_, "f.", force_names_);
    return out;
  }
  std::vector<double> values(const Point& point) const {
    std::vector<Expression> all = model_.derivatives;
    all.insert(all.end(), model_.told.begin(), model_.told.end());
    return evaluate(model_.graph, all, [&](const std::string& symbol) {
      const auto found = point.find(symbol);
      return found == point.end() ? 0.0 : found->second;
    });
  }

  /// The function's own values against ours.
  bool check_samples() {
    std::vector<bool> compared(model_.states.size() + model_.outputs.size());
    for (const FunctionSample& sample : function_.samples) {
      const std::vector<double> ours = values(point_of(sample));
      for (const int port : {xdot_, y_})
        if (port >= 0 && !agrees(port, sample.out[at(port)], ours, compared)) return false;
    }
    Words silent;
    for (std::size_t k = 0; k < compared.size(); ++k)
      if (!compared[k] && !result(k).is_constant()) silent.push_back(name_of_result(k));
    if (!silent.empty() && !function_.samples.empty())
      note(join(silent) + (silent.size() > 1 ? " are" : " is") +
           " finite at none of the random points where the import compares itself with CasADi: look at the domain");
    return true;
  }
  const Expression& result(std::size_t k) const {
    return k < model_.states.size() ? model_.derivatives[k] : model_.told[k - model_.states.size()];
  }
  std::string name_of_result(std::size_t k) const {
    const std::size_t states = model_.states.size();
    return k < states ? "xdot[" + std::to_string(k) + "]" : "y[" + std::to_string(k - states) + "]";
  }
  bool agrees(int port, const std::vector<double>& theirs, const std::vector<double>& ours,
              std::vector<bool>& compared) {
    for (std::size_t k = 0; k < theirs.size(); ++k) {
      if (!std::isfinite(theirs[k])) continue;
      const std::size_t place = (port == y_ ? model_.states.size() : 0) + at(function_.outputs[at(port)].row[k]);
      compared[place] = true;
      if (near(ours[place], theirs[k])) continue;
      error(name_of_result(place) + " comes out as " + number_text(ours[place]) + " where CasADi has " +
            number_text(theirs[k]) + "; the import does not understand this function: it writes nothing");
      return false;
    }
    return true;
  }

  /// How a node depends on the forces: not at all, by a line, or otherwise.
  std::vector<int> force_degrees() const {
    constexpr int kCurve = 2;
    const auto& nodes = model_.graph.nodes();
    std::vector<int> degree(nodes.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const auto of = [&](std::int32_t node) { return node < 0 ? 0 : degree[at(node)]; };
      const int a = of(nodes[i].a), b = of(nodes[i].b), c = of(nodes[i].c);
      switch (nodes[i].op) {
        case Op::symbol: degree[i] = nodes[i].text.rfind("f.", 0) == 0 ? 1 : 0; break;
        case Op::constant: break;
        case Op::add:
        case Op::subtract:
        case Op::negate: degree[i] = std::max(a, b); break;
        case Op::multiply: degree[i] = std::min(kCurve, a + b); break;
        case Op::divide: degree[i] = b > 0 ? kCurve : a; break;
        case Op::select: degree[i] = a > 0 ? kCurve : std::max(b, c); break;
        default: degree[i] = a + b + c > 0 ? kCurve : 0; break;
      }
    }
    return degree;
  }

  bool finish_joints() {
    if (model_.joints.empty()) return true;
    const std::vector<int> degree = force_degrees();
    for (std::size_t k = 0; k < model_.states.size(); ++k) {
      const Expression& rate = model_.derivatives[k];
      if (!rate.is_constant() && degree[at(rate.node())] > 1)
        error("xdot[" + std::to_string(k) + "] (of " + model_.states[k] + ") is no straight line of the forces " +
              join(model_.forces) + "; forces at joints add to others");
    }
    if (!errors_.empty()) return false;
    const std::set<std::string> used = all_symbols();
    for (std::size_t j = 0; j < model_.joints.size(); ++j) {
      if (used.count("f." + model_.forces[j]) == 0)
        error("the force " + model_.forces[j] + " of joint " + model_.joints[j].name + " changes nothing");
      if (model_.joints[j].drive < 0) model_.joints[j].drive = drive_of(model_.forces[j]);
    }
    return errors_.empty();
  }

  /// The input that does what a force does, to the same number.
  int drive_of(const std::string& force) const {
    for (std::size_t u = 0; u < model_.inputs.size(); ++u) {
      bool same = !function_.samples.empty();
      for (const FunctionSample& sample : function_.samples) {
        Point by_force = point_of(sample), by_input = by_force;
        by_force["f." + force] += 1.0;
        by_input["u." + model_.inputs[u]] += 1.0;
        const std::vector<double> a = values(by_force), b = values(by_input);
        for (std::size_t k = 0; k < model_.states.size(); ++k) same = same && (near(a[k], b[k]) || std::isnan(b[k]));
      }
      if (same) return static_cast<int>(u);
    }
    return -1;
  }

  // ---- parameters, limits, angles ----

  /// The value of element k of p: by its own name, or from the list of the symbol that it is of ("k_2" of "k").
  bool value_of(std::size_t k, double& value, std::set<std::string>& taken) {
    const std::string &name = parameter_names_[k], symbol = input(p_).elements[k];
    for (const std::string& key : {name, symbol}) {
      const auto found = details_.parameters.find(key);
      if (found == details_.parameters.end() || found->second.size() != 1) continue;
      taken.insert(key);
      value = found->second[0];
      return true;
    }
    const std::size_t line = symbol.rfind('_');
    const std::string of = symbol.substr(0, line);
    const auto found = line == std::string::npos ? details_.parameters.end() : details_.parameters.find(of);
    if (found == details_.parameters.end()) return false;
    taken.insert(of);
    char* end = nullptr;
    const unsigned long place = std::strtoul(symbol.c_str() + line + 1, &end, 10);
    if (*end != '\0' || place >= found->second.size()) {
      details_error("parameters." + of,
                    "has " + std::to_string(found->second.size()) + " numbers, and none for " + symbol);
      value = 0.0;
    } else {
      value = found->second[place];
    }
    return true;
  }

  void read_parameters(const Words& unknown) {
    const std::set<std::string> used = all_symbols();
    std::set<std::string> taken;
    Words unused, missing, known;
    for (std::size_t k = 0; k < parameter_names_.size(); ++k) {
      FunctionParameter parameter;
      parameter.name = parameter_names_[k];
      const bool is_given = value_of(k, parameter.value, taken);
      if (used.count("p." + parameter.name) == 0) {
        unused.push_back(parameter.name);
        continue;
      }
      known.push_back(parameter.name);
      if (!is_given) missing.push_back(parameter.name);
      parameter.is_unknown = has(unknown, parameter.name) || has(unknown, "*");
      model_.parameters.push_back(parameter);
    }
    if (!unused.empty()) note("parameters " + join(unused) + " change nothing: left out");
    if (!missing.empty())
      error("parameters without a value: " + join(missing) + "; give them with --value " + join(missing, "=NUMBER,") +
            "=NUMBER, or in " + details_path() + ":\n  [parameters]\n  " + join(missing, " = NUMBER\n  ") +
            " = NUMBER");
    for (const auto& [name, value] : details_.parameters)
      if (taken.count(name) == 0)
        details_error("parameters." + name, "is no parameter of the function" +
                                                std::string(value.size() > 1 ? ", or one of another size" : "") +
                                                meant(name, parameter_names_));
    for (const std::string& word : unknown)
      if (word != "*" && !has(known, word))
        errors_.push_back("--unknown " + word + ": is no parameter of " + function_.path +
                          (has(unused, word) ? " that changes anything" : "") + meant(word, known));
    if (const auto zero = std::find_if(model_.parameters.begin(), model_.parameters.end(),
                                       [](const FunctionParameter& p) { return p.is_unknown && p.value == 0.0; });
        zero != model_.parameters.end() && missing.empty())
      note("parameter " + zero->name +
           " is 0, so that its prior has no scale: 0.1 is taken; correct it in [parameters]");
  }

  void read_limits() {
    Words unstated;
    for (const std::string& name : model_.inputs) {
      const auto found = details_.limits.find(name);
      model_.limit_stated.push_back(found != details_.limits.end());
      if (found != details_.limits.end()) {
        model_.limits.push_back(found->second);
        continue;
      }
      const bool is_force = ends_with(name, "_N") || ends_with(name, "_Nm"), is_angle = ends_with(name, "_rad");
      const double most = is_force ? kForceLimit : is_angle ? kAngleLimit : kLimit;
      model_.limits.push_back({-most, most});
      unstated.push_back(name + " (" + number_text(most) + ")");
    }
    for (const auto& [name, range] : details_.limits)
      if (!has(model_.inputs, name)) details_error("limits." + name, "is no input" + meant(name, model_.inputs));
    if (!unstated.empty())
      note("nobody states limits of " + join(unstated) +
           ": guessed; write the machine's into [limits] of the robot file");
  }

  /// States in rad at which a turn more changes nothing, where the details do not say which wrap.
  void find_angles() {
    if (details_.has_angles) {
      for (const std::string& name : details_.angles) {
        const int state = index_of(model_.states, name);
        if (state < 0 || at(state) >= kMostStates)
          details_error("angles", "has '" + name + "', which is no state" + meant(name, model_.states));
        else
          model_.angles |= 1u << state;
      }
      return;
    }
    Words found;
    for (std::size_t k = 0; k < model_.states.size() && k < kMostStates; ++k) {
      if (!ends_with(model_.states[k], "_rad") || !is_periodic(model_.states[k])) continue;
      model_.angles |= 1u << k;
      found.push_back(model_.states[k]);
    }
    if (!found.empty())
      note("states that wrap at a half turn, for a turn more changes nothing: " + join(found) +
           "; if not: angles = [] in " + details_path());
  }
  bool is_periodic(const std::string& state) const {
    bool compared = false;
    for (const FunctionSample& sample : function_.samples) {
      Point point = point_of(sample);
      const std::vector<double> here = values(point);
      point["x." + state] += kTurn_rad;
      const std::vector<double> there = values(point);
      for (std::size_t k = 0; k < here.size(); ++k) {
        if (!std::isfinite(here[k]) || !std::isfinite(there[k])) continue;
        compared = true;
        if (!near(there[k], here[k])) return false;
      }
    }
    return compared;
  }

  /// Names that end in a rate per second, or per hour.
  Words rates_per(const std::string& unit) const {
    Words all = model_.states, found;
    all.insert(all.end(), model_.inputs.begin(), model_.inputs.end());
    for (const FunctionParameter& p : model_.parameters) all.push_back(p.name);
    for (const std::string& name : all)
      if (ends_with(unit_of_field(name), "/" + unit)) found.push_back(name);
    return found;
  }

  /// Derivatives per hour, by the details or by the names of what they are made of, become derivatives per second.
  void take_time_unit() {
    const Words hours = rates_per("h"), seconds = rates_per("s");
    std::string unit = details_.time;
    if (unit.empty() && !hours.empty() && !seconds.empty())
      return error("has rates per hour (" + join(hours) + ") and per second (" + join(seconds) +
                   "); say what its derivatives are per: time = \"h\" or time = \"s\" in " + details_path());
    if (unit.empty() && !hours.empty()) {
      unit = "h";
      note("its derivatives are taken as changes per hour, for its rates are (" + join(hours) +
           "), and divided by 3600; if they are per second: time = \"s\" in " + details_path());
    }
    model_.time_unit_s = unit == "h" ? 3600.0 : unit == "min" ? 60.0 : 1.0;
    if (model_.time_unit_s == 1.0) return;
    if (!model_.joints.empty())
      return error("has derivatives per " + unit +
                   " and joints, whose speeds are per second in every model; write the "
                   "equations in seconds");
    for (Expression& rate : model_.derivatives) rate = rate / model_.time_unit_s;
  }

  void note_the_rest() {
    const std::set<std::string> used = all_symbols();
    Words idle, unnamed;
    for (const std::string& name : model_.inputs)
      if (used.count("u." + name) == 0) idle.push_back(name);
    if (!idle.empty()) note("inputs " + join(idle) + " change nothing");
    if (details_.names.count("x") == 0)
      for (const std::string& name : model_.states)
        if (name.rfind("x_", 0) == 0 && name.find_first_not_of("0123456789", 2) == std::string::npos)
          unnamed.push_back(name);
    if (!unnamed.empty())
      note("states " + join(unnamed) + " have no names of their own; names with SI units go into " + details_path() +
           ": names.x = [\"cart_m\", ...]");
    if (model_.joints.empty())
      note("has no forces f, so effects at joints (friction, backlash) are refused; " + details_path() +
           " may name an input as one: joints.NAME = { velocity = \"STATE\", force = \"INPUT\" }");
  }

  static constexpr int kMostWork = 1 << 24;
  static constexpr std::size_t kMostStates = 32;  // bits of a set of states

  const FunctionText& function_;
  const FunctionDetails& details_;
  FunctionModel& model_;
  Words& errors_;
  int x_ = -1, u_ = -1, p_ = -1, f_ = -1, xdot_ = -1, y_ = -1;
  Words parameter_names_, force_names_;  // of the function, whether they matter or not
};

}  // namespace

bool build_function_model(const FunctionText& function, const Words& unknown, FunctionModel& model, Words& errors) {
  Words found;
  Builder(function, model, found).build(unknown);
  errors.insert(errors.end(), found.begin(), found.end());
  return found.empty();
}

}  // namespace tiller::tools
