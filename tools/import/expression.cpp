#include "tools/import/expression.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/base/text.hpp"

namespace tiller::tools {

using Op = ExpressionGraph::Op;

namespace {

ExpressionGraph* graph_of(const Expression& a, const Expression& b) {
  return a.graph() != nullptr ? a.graph() : b.graph();
}

/// The operand of a negation; null: it is none.
bool is_negated(const Expression& x, Expression& operand) {
  if (x.is_constant()) return false;
  const ExpressionGraph::Node& node = x.graph()->nodes()[static_cast<std::size_t>(x.node())];
  if (node.op != Op::negate) return false;
  operand = Expression(x.graph(), node.a);
  return true;
}

bool same(const Expression& a, const Expression& b) {
  if (a.is_constant() || b.is_constant()) return a.is_constant() && b.is_constant() && a.constant() == b.constant();
  return a.node() == b.node();
}

}  // namespace

Expression Expression::operator-() const {
  Expression inner;
  if (is_constant()) return -constant_;
  if (is_negated(*this, inner)) return inner;
  return graph_->make(Op::negate, *this);
}

Expression operator+(const Expression& a, const Expression& b) {
  Expression inner;
  if (a.is_constant() && b.is_constant()) return a.constant_ + b.constant_;
  if (a.is(0.0)) return b;
  if (b.is(0.0)) return a;
  if (is_negated(b, inner)) return a - inner;
  if (is_negated(a, inner)) return b - inner;
  return graph_of(a, b)->make(Op::add, a, b);
}

Expression operator-(const Expression& a, const Expression& b) {
  Expression inner;
  if (a.is_constant() && b.is_constant()) return a.constant_ - b.constant_;
  if (b.is(0.0)) return a;
  if (a.is(0.0)) return -b;
  if (same(a, b)) return 0.0;
  if (is_negated(b, inner)) return a + inner;
  if (is_negated(a, inner)) return -(inner + b);
  return graph_of(a, b)->make(Op::subtract, a, b);
}

Expression operator*(const Expression& a, const Expression& b) {
  Expression inner;
  if (a.is_constant() && b.is_constant()) return a.constant_ * b.constant_;
  if (a.is(0.0) || b.is(0.0)) return 0.0;
  if (a.is(1.0)) return b;
  if (b.is(1.0)) return a;
  if (a.is(-1.0)) return -b;
  if (b.is(-1.0)) return -a;
  if (a.is_constant() && a.constant() < 0.0) return -(Expression(-a.constant()) * b);
  if (b.is_constant() && b.constant() < 0.0) return -(Expression(-b.constant()) * a);
  if (is_negated(a, inner)) return -(inner * b);
  if (is_negated(b, inner)) return -(a * inner);
  return graph_of(a, b)->make(Op::multiply, a, b);
}

Expression operator/(const Expression& a, const Expression& b) {
  Expression inner;
  if (a.is_constant() && b.is_constant()) return a.constant_ / b.constant_;
  if (a.is(0.0)) return 0.0;
  if (b.is_constant()) return a * Expression(1.0 / b.constant());
  if (is_negated(a, inner)) return -(inner / b);
  if (is_negated(b, inner)) return -(a / inner);
  return graph_of(a, b)->make(Op::divide, a, b);
}

Expression sin(const Expression& x) {
  Expression inner;
  if (x.is_constant()) return std::sin(x.constant());
  if (is_negated(x, inner)) return -sin(inner);
  return x.graph()->make(Op::sine, x);
}

Expression cos(const Expression& x) {
  Expression inner;
  if (x.is_constant()) return std::cos(x.constant());
  if (is_negated(x, inner)) return cos(inner);
  return x.graph()->make(Op::cosine, x);
}

Expression exp(const Expression& x) {
  if (x.is_constant()) return std::exp(x.constant());
  return x.graph()->make(Op::exponential, x);
}

namespace {

/// A function of one number: folded where it is constant.
Expression apply(Op op, const Expression& x, double (*function)(double)) {
  return x.is_constant() ? Expression(function(x.constant())) : x.graph()->make(op, x);
}
/// Of two.
Expression apply(Op op, const Expression& a, const Expression& b, double (*function)(double, double)) {
  if (a.is_constant() && b.is_constant()) return function(a.constant(), b.constant());
  return graph_of(a, b)->make(op, a, b);
}

// what the emitted code computes, for plain numbers (tiller/scalar.hpp)
double smaller(double a, double b) { return a < b ? a : b; }
double larger(double a, double b) { return a > b ? a : b; }
double is_less(double a, double b) { return a < b ? 1.0 : 0.0; }
double is_less_equal(double a, double b) { return a <= b ? 1.0 : 0.0; }
double is_equal(double a, double b) { return a == b ? 1.0 : 0.0; }

bool is_condition_op(Op op) { return op >= Op::less && op <= Op::logical_or; }

}  // namespace

Expression log(const Expression& x) { return apply(Op::logarithm, x, std::log); }
Expression sqrt(const Expression& x) { return apply(Op::square_root, x, std::sqrt); }
Expression abs(const Expression& x) { return apply(Op::magnitude, x, std::fabs); }
Expression tanh(const Expression& x) { return apply(Op::hyperbolic_tangent, x, std::tanh); }
Expression floor(const Expression& x) { return apply(Op::floor, x, std::floor); }
Expression nearest(const Expression& x) { return apply(Op::nearest, x, std::nearbyint); }
Expression atan2(const Expression& y, const Expression& x) { return apply(Op::arc_tangent2, y, x, std::atan2); }
Expression copysign(const Expression& a, const Expression& b) { return apply(Op::copysign, a, b, std::copysign); }
Expression min(const Expression& a, const Expression& b) { return same(a, b) ? a : apply(Op::min, a, b, smaller); }
Expression max(const Expression& a, const Expression& b) { return same(a, b) ? a : apply(Op::max, a, b, larger); }

Expression less(const Expression& a, const Expression& b) { return apply(Op::less, a, b, is_less); }
Expression less_equal(const Expression& a, const Expression& b) { return apply(Op::less_equal, a, b, is_less_equal); }
Expression equal(const Expression& a, const Expression& b) { return apply(Op::equal, a, b, is_equal); }

Expression logical_not(const Expression& m) {
  if (m.is_constant()) return m.constant() == 0.0 ? 1.0 : 0.0;
  const ExpressionGraph::Node& node = m.graph()->nodes()[static_cast<std::size_t>(m.node())];
  return node.op == Op::logical_not ? Expression(m.graph(), node.a) : m.graph()->make(Op::logical_not, m);
}
Expression logical_and(const Expression& m, const Expression& n) {
  if (m.is_constant()) return m.constant() != 0.0 ? n : Expression(0.0);
  if (n.is_constant()) return n.constant() != 0.0 ? m : Expression(0.0);
  return same(m, n) ? m : m.graph()->make(Op::logical_and, m, n);
}
Expression logical_or(const Expression& m, const Expression& n) {
  if (m.is_constant()) return m.constant() != 0.0 ? Expression(1.0) : n;
  if (n.is_constant()) return n.constant() != 0.0 ? Expression(1.0) : m;
  return same(m, n) ? m : m.graph()->make(Op::logical_or, m, n);
}

Expression select(const Expression& m, const Expression& a, const Expression& b) {
  if (m.is_constant()) return m.constant() != 0.0 ? a : b;
  if (same(a, b)) return a;
  const ExpressionGraph::Node& node = m.graph()->nodes()[static_cast<std::size_t>(m.node())];
  if (node.op == Op::logical_not) return select(Expression(m.graph(), node.a), b, a);
  return m.graph()->make(Op::select, m, a, b);
}

bool is_condition(const Expression& x) {
  return !x.is_constant() && is_condition_op(x.graph()->nodes()[static_cast<std::size_t>(x.node())].op);
}
Expression number_of(const Expression& x) { return is_condition(x) ? select(x, 1.0, 0.0) : x; }
Expression condition_of(const Expression& x) {
  if (is_condition(x)) return x;
  return x.is_constant() ? Expression(x.constant() != 0.0 ? 1.0 : 0.0) : logical_not(equal(x, 0.0));
}

Expression ExpressionGraph::symbol(const std::string& text) {
  Node node;
  node.op = Op::symbol;
  node.text = text;
  return {this, add(std::move(node))};
}

std::int32_t ExpressionGraph::node_of(const Expression& x) {
  if (!x.is_constant()) return x.node();
  Node node;
  node.value = x.constant();
  return add(std::move(node));
}

Expression ExpressionGraph::make(Op op, const Expression& a) {
  Node node;
  node.op = op;
  node.a = node_of(a);
  return keep(std::move(node));
}

Expression ExpressionGraph::make(Op op, const Expression& a, const Expression& b) {
  Node node;
  node.op = op;
  node.a = node_of(a);
  node.b = node_of(b);
  // a sum or product is the same in either order
  if ((op == Op::add || op == Op::multiply) && node.b < node.a) std::swap(node.a, node.b);
  return keep(std::move(node));
}

Expression ExpressionGraph::make(Op op, const Expression& a, const Expression& b, const Expression& c) {
  Node node;
  node.op = op;
  node.a = node_of(a);
  node.b = node_of(b);
  node.c = node_of(c);
  return keep(std::move(node));
}

Expression ExpressionGraph::keep(Node node) { return {this, add(std::move(node))}; }

std::int32_t ExpressionGraph::add(Node node) {
  const auto [found, is_new] = known_.try_emplace({node.op, node.a, node.b, node.c, node.value, node.text},
                                                  static_cast<std::int32_t>(nodes_.size()));
  if (is_new) nodes_.push_back(std::move(node));
  return found->second;
}

namespace {

/// In tiller/scalar.hpp; null: an operator.
const char* function_name(Op op) {
  switch (op) {
    case Op::sine: return "sin";
    case Op::cosine: return "cos";
    case Op::exponential: return "exp";
    case Op::logarithm: return "log";
    case Op::square_root: return "sqrt";
    case Op::magnitude: return "abs";
    case Op::hyperbolic_tangent: return "tanh";
    case Op::floor: return "floor";
    case Op::nearest: return "nearest";
    case Op::arc_tangent2: return "atan2";
    case Op::min: return "min";
    case Op::max: return "max";
    case Op::copysign: return "copysign";
    case Op::select: return "select";
    default: return nullptr;
  }
}

double value_of_node(const ExpressionGraph::Node& n, double a, double b, double c) {
  switch (n.op) {
    case Op::symbol:
    case Op::constant: return n.value;
    case Op::add: return a + b;
    case Op::subtract: return a - b;
    case Op::multiply: return a * b;
    case Op::divide: return a / b;
    case Op::negate: return -a;
    case Op::sine: return std::sin(a);
    case Op::cosine: return std::cos(a);
    case Op::exponential: return std::exp(a);
    case Op::logarithm: return std::log(a);
    case Op::square_root: return std::sqrt(a);
    case Op::magnitude: return std::fabs(a);
    case Op::hyperbolic_tangent: return std::tanh(a);
    case Op::floor: return std::floor(a);
    case Op::nearest: return std::nearbyint(a);
    case Op::arc_tangent2: return std::atan2(a, b);
    case Op::min: return smaller(a, b);
    case Op::max: return larger(a, b);
    case Op::copysign: return std::copysign(a, b);
    case Op::less: return is_less(a, b);
    case Op::less_equal: return is_less_equal(a, b);
    case Op::equal: return is_equal(a, b);
    case Op::logical_not: return a == 0.0 ? 1.0 : 0.0;
    case Op::logical_and: return a != 0.0 && b != 0.0 ? 1.0 : 0.0;
    case Op::logical_or: return a != 0.0 || b != 0.0 ? 1.0 : 0.0;
    case Op::select: return a != 0.0 ? b : c;
  }
  return NAN;
}

}  // namespace

std::vector<double> evaluate(const ExpressionGraph& graph, const std::vector<Expression>& outputs,
                             const std::function<double(const std::string& symbol)>& value_of) {
  const std::vector<ExpressionGraph::Node>& nodes = graph.nodes();
  std::vector<double> value(nodes.size());
  const auto of = [&](std::int32_t node) { return node < 0 ? 0.0 : value[static_cast<std::size_t>(node)]; };
  for (std::size_t i = 0; i < nodes.size(); ++i)
    value[i] = nodes[i].op == Op::symbol ? value_of(nodes[i].text)
                                         : value_of_node(nodes[i], of(nodes[i].a), of(nodes[i].b), of(nodes[i].c));
  std::vector<double> out;
  for (const Expression& x : outputs) out.push_back(x.is_constant() ? x.constant() : of(x.node()));
  return out;
}

// ---- code ----------------------------------------------------------------------------------------------------------

namespace {

class Emitter {
 public:
  Emitter(const ExpressionGraph& graph, std::string indent, int* operations)
      : nodes_(graph.nodes()), indent_(std::move(indent)), operations_(operations) {}

  /// targets: what each output is assigned to as soon as it is known; empty: nothing.
  std::string run(const std::vector<std::int32_t>& outputs, const std::vector<std::string>& targets,
                  std::vector<std::string>& values) {
    for (std::size_t k = 0; k < targets.size(); ++k) targets_.emplace(outputs[k], targets[k]);
    uses_.assign(nodes_.size(), 0);
    for (const std::int32_t node : outputs) count(node);
    text_.resize(nodes_.size());
    rank_.assign(nodes_.size(), kAtom);
    for (std::size_t i = 0; i < nodes_.size(); ++i)
      if (uses_[i] > 0) place(static_cast<std::int32_t>(i));
    for (const auto& [node, target] : targets_) assign(node, target);  // of what computes nothing
    values.clear();
    for (const std::int32_t node : outputs) values.push_back(text_[at(node)]);
    return code_;
  }

 private:
  // how tightly a text binds: where a weaker one stands as an operand it takes brackets
  enum Rank : std::uint8_t { kLogic, kComparison, kSum, kProduct, kAtom };

  static std::size_t at(std::int32_t node) { return static_cast<std::size_t>(node); }

  void count(std::int32_t root) {
    std::vector<std::int32_t> open{root};
    while (!open.empty()) {
      const std::int32_t node = open.back();
      open.pop_back();
      if (++uses_[at(node)] > 1) continue;
      for (const std::int32_t operand : {nodes_[at(node)].a, nodes_[at(node)].b, nodes_[at(node)].c})
        if (operand >= 0) open.push_back(operand);
    }
  }

  std::string operand(std::int32_t node, Rank weakest) const {
    return rank_[at(node)] < weakest ? "(" + text_[at(node)] + ")" : text_[at(node)];
  }

  struct Infix {
    Op op;
    const char* sign;
    Rank left, right, whole;  // the weakest that an operand may be without brackets, and what it becomes
  };
  static constexpr Infix kInfix[] = {
      {Op::add, " + ", kSum, kSum, kSum},
      {Op::subtract, " - ", kSum, kProduct, kSum},
      {Op::multiply, " * ", kProduct, kProduct, kProduct},
      {Op::divide, " / ", kProduct, kAtom, kProduct},
      {Op::less, " < ", kSum, kSum, kComparison},
      {Op::less_equal, " <= ", kSum, kSum, kComparison},
      {Op::equal, " == ", kSum, kSum, kComparison},
      {Op::logical_and, " & ", kAtom, kAtom, kLogic},
      {Op::logical_or, " | ", kAtom, kAtom, kLogic},
  };

  // The text of an operation on operands that have theirs, and how strongly it binds.
  Rank spell(const ExpressionGraph::Node& n, std::string& text) const {
    for (const Infix& infix : kInfix)
      if (infix.op == n.op) {
        text = operand(n.a, infix.left) + infix.sign + operand(n.b, infix.right);
        return infix.whole;
      }
    if (n.op == Op::negate || n.op == Op::logical_not) {
      text = (n.op == Op::negate ? "-" : "!") + operand(n.a, kAtom);
      return n.op == Op::negate ? kSum : kComparison;
    }
    text = call(n);
    return kAtom;
  }

  void place(std::int32_t id) {
    const ExpressionGraph::Node& n = nodes_[at(id)];
    std::string& text = text_[at(id)];
    if (n.op == Op::symbol || n.op == Op::constant) {
      text = n.op == Op::symbol ? n.text : constant(n.value);
      return;
    }
    if (n.op == Op::sine || n.op == Op::cosine) return circular(id);
    Rank rank = spell(n, text);
    if (operations_ != nullptr) ++*operations_;
    // a text of its own where it is used again, and before it fills a line
    const auto wanted = targets_.equal_range(id);
    const int further = uses_[at(id)] - static_cast<int>(std::distance(wanted.first, wanted.second));
    if (further > 1 || (further > 0 && wanted.first != wanted.second) || text.size() > kLongest) {
      const std::string name = "t" + std::to_string(next_++);
      code_ += indent_ + (is_condition_op(n.op) ? "const auto " : "const S ") + name + " = " + text + ";\n";
      text = name;
      rank = kAtom;
    }
    rank_[at(id)] = rank;
    for (auto target = wanted.first; target != wanted.second; ++target) {
      assign(id, target->second);
      if (further == 0) text = target->second;
    }
    targets_.erase(wanted.first, wanted.second);
  }
  void assign(std::int32_t node, const std::string& target) {
    code_ += indent_ + target + " = " + text_[at(node)] + ";\n";
  }

  std::string call(const ExpressionGraph::Node& n) const {
    std::string text = function_name(n.op) + std::string("(") + text_[at(n.a)];
    for (const std::int32_t further : {n.b, n.c})
      if (further >= 0) text += ", " + text_[at(further)];
    return text + ")";
  }

  void circular(std::int32_t id) {
    const std::int32_t argument = nodes_[at(id)].a;
    if (operations_ != nullptr) ++*operations_;
    std::int32_t sine = -1, cosine = -1;
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (uses_[i] == 0 || nodes_[i].a != argument) continue;
      if (nodes_[i].op == Op::sine) sine = static_cast<std::int32_t>(i);
      if (nodes_[i].op == Op::cosine) cosine = static_cast<std::int32_t>(i);
    }
    const std::string number = std::to_string(next_++);
    if (sine < 0 || cosine < 0) {
      text_[at(id)] = (sine < 0 ? "c" : "s") + number;
      code_ += indent_ + "const S " + text_[at(id)] + (sine < 0 ? " = cos(" : " = sin(") + text_[at(argument)] + ");\n";
      return;
    }
    if (!text_[at(sine)].empty() || !text_[at(cosine)].empty()) return;  // both came with the first
    text_[at(sine)] = "s" + number;
    text_[at(cosine)] = "c" + number;
    code_ += indent_ + "S s" + number + ", c" + number + ";\n" + indent_ + "sincos(" + text_[at(argument)] + ", s" +
             number + ", c" + number + ");\n";
  }

  static std::string constant(double value) {
    std::string text = number_text(value);
    if (text.find_first_of(".e") == std::string::npos) text += ".0";
    return "S(" + text + ")";
  }

  static constexpr std::size_t kLongest = 90;

  const std::vector<ExpressionGraph::Node>& nodes_;
  const std::string indent_;
  int* const operations_;
  std::vector<int> uses_;
  std::vector<std::string> text_;
  std::vector<Rank> rank_;
  std::multimap<std::int32_t, std::string> targets_;  // of nodes still to come
  std::string code_;
  int next_ = 1;
};

}  // namespace

std::string emit_code(ExpressionGraph& graph, const std::vector<Expression>& outputs, const std::string& indent,
                      std::vector<std::string>& values, int* operations) {
  std::vector<std::int32_t> nodes;
  nodes.reserve(outputs.size());
  for (const Expression& output : outputs) nodes.push_back(graph.node_of(output));
  return Emitter(graph, indent, operations).run(nodes, {}, values);
}

std::string emit_assignments(ExpressionGraph& graph, const std::vector<Expression>& outputs,
                             const std::vector<std::string>& targets, const std::string& indent, int* operations) {
  std::vector<std::int32_t> nodes;
  nodes.reserve(outputs.size());
  for (const Expression& output : outputs) nodes.push_back(graph.node_of(output));
  std::vector<std::string> values;
  return Emitter(graph, indent, operations).run(nodes, targets, values);
}

std::vector<std::string> called_functions(const ExpressionGraph& graph, const std::vector<Expression>& outputs) {
  const std::vector<ExpressionGraph::Node>& nodes = graph.nodes();
  std::vector<bool> reached(nodes.size());
  for (const Expression& x : outputs)
    if (!x.is_constant()) reached[static_cast<std::size_t>(x.node())] = true;
  std::vector<std::string> out;
  for (std::size_t i = nodes.size(); i-- > 0;) {
    if (!reached[i]) continue;
    for (const std::int32_t operand : {nodes[i].a, nodes[i].b, nodes[i].c})
      if (operand >= 0) reached[static_cast<std::size_t>(operand)] = true;
    const char* name = function_name(nodes[i].op);
    if (name != nullptr && std::find(out.begin(), out.end(), name) == out.end()) out.push_back(name);
  }
  if (std::count(out.begin(), out.end(), "sin") + std::count(out.begin(), out.end(), "cos") == 2)
    out.push_back("sincos");
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace tiller::tools
