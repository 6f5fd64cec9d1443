#include "tools/import/expression.hpp"

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
  return graph_->make(Op::negate, *this, 0.0);
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
  return x.graph()->make(Op::sine, x, 0.0);
}

Expression cos(const Expression& x) {
  Expression inner;
  if (x.is_constant()) return std::cos(x.constant());
  if (is_negated(x, inner)) return cos(inner);
  return x.graph()->make(Op::cosine, x, 0.0);
}

Expression exp(const Expression& x) {
  if (x.is_constant()) return std::exp(x.constant());
  return x.graph()->make(Op::exponential, x, 0.0);
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

Expression ExpressionGraph::make(Op op, const Expression& a, const Expression& b) {
  Node node;
  node.op = op;
  node.a = node_of(a);
  const bool binary = op == Op::add || op == Op::subtract || op == Op::multiply || op == Op::divide;
  if (binary) node.b = node_of(b);
  // a sum or product is the same in either order
  if ((op == Op::add || op == Op::multiply) && node.b < node.a) std::swap(node.a, node.b);
  return {this, add(std::move(node))};
}

std::int32_t ExpressionGraph::add(Node node) {
  const auto [found, is_new] =
      known_.try_emplace({node.op, node.a, node.b, node.value, node.text}, static_cast<std::int32_t>(nodes_.size()));
  if (is_new) nodes_.push_back(std::move(node));
  return found->second;
}

// ---- code ----------------------------------------------------------------------------------------------------------

namespace {

class Emitter {
 public:
  Emitter(const ExpressionGraph& graph, std::string indent, int* operations)
      : nodes_(graph.nodes()), indent_(std::move(indent)), operations_(operations) {}

  std::string run(const std::vector<std::int32_t>& outputs, std::vector<std::string>& values) {
    uses_.assign(nodes_.size(), 0);
    for (const std::int32_t node : outputs) count(node);
    text_.resize(nodes_.size());
    rank_.assign(nodes_.size(), kAtom);
    for (std::size_t i = 0; i < nodes_.size(); ++i)
      if (uses_[i] > 0) place(static_cast<std::int32_t>(i));
    values.clear();
    for (const std::int32_t node : outputs) values.push_back(text_[at(node)]);
    return code_;
  }

 private:
  // how tightly a text binds: where a weaker one stands as an operand it takes brackets
  enum Rank : std::uint8_t { kSum, kProduct, kAtom };

  static std::size_t at(std::int32_t node) { return static_cast<std::size_t>(node); }

  void count(std::int32_t root) {
    std::vector<std::int32_t> open{root};
    while (!open.empty()) {
      const std::int32_t node = open.back();
      open.pop_back();
      if (++uses_[at(node)] > 1) continue;
      if (nodes_[at(node)].a >= 0) open.push_back(nodes_[at(node)].a);
      if (nodes_[at(node)].b >= 0) open.push_back(nodes_[at(node)].b);
    }
  }

  std::string operand(std::int32_t node, Rank weakest) const {
    return rank_[at(node)] < weakest ? "(" + text_[at(node)] + ")" : text_[at(node)];
  }

  void place(std::int32_t id) {
    const ExpressionGraph::Node& n = nodes_[at(id)];
    std::string& text = text_[at(id)];
    Rank rank = kAtom;
    switch (n.op) {
      case Op::symbol: text = n.text; return;
      case Op::constant: text = constant(n.value); return;
      case Op::add:
        text = operand(n.a, kSum) + " + " + operand(n.b, kSum);
        rank = kSum;
        break;
      case Op::subtract:
        text = operand(n.a, kSum) + " - " + operand(n.b, kProduct);
        rank = kSum;
        break;
      case Op::multiply:
        text = operand(n.a, kProduct) + " * " + operand(n.b, kProduct);
        rank = kProduct;
        break;
      case Op::divide:
        text = operand(n.a, kProduct) + " / " + operand(n.b, kAtom);
        rank = kProduct;
        break;
      case Op::negate:
        text = "-" + operand(n.a, kAtom);
        rank = kSum;
        break;
      case Op::sine:
      case Op::cosine: return circular(id);
      case Op::exponential: text = "exp(" + text_[at(n.a)] + ")"; break;
    }
    if (operations_ != nullptr) ++*operations_;
    // a text of its own where it is used again, and before it fills a line
    if (uses_[at(id)] > 1 || text.size() > kLongest) {
      const std::string name = "t" + std::to_string(next_++);
      code_ += indent_ + "const S " + name + " = " + text + ";\n";
      text = name;
      rank = kAtom;
    }
    rank_[at(id)] = rank;
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
  std::string code_;
  int next_ = 1;
};

}  // namespace

std::string emit_code(ExpressionGraph& graph, const std::vector<Expression>& outputs, const std::string& indent,
                      std::vector<std::string>& values, int* operations) {
  std::vector<std::int32_t> nodes;
  nodes.reserve(outputs.size());
  for (const Expression& output : outputs) nodes.push_back(graph.node_of(output));
  return Emitter(graph, indent, operations).run(nodes, values);
}

}  // namespace tiller::tools
