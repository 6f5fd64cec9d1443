#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <tuple>
#include <vector>

namespace tiller::tools {

class ExpressionGraph;

/// A number that the emitted code will compute: a node of a graph. Arithmetic on it makes nodes; equal terms are one
/// node, whichever way they were reached, and what multiplies by 0 or 1 or adds 0 is none. A default-constructed one is
/// the constant 0 of no graph.
class Expression {
 public:
  Expression() = default;
  Expression(double constant) : constant_(constant) {}  // NOLINT(google-explicit-constructor): numbers are expressions
  Expression(ExpressionGraph* graph, std::int32_t node) : graph_(graph), node_(node) {}

  bool is_constant() const { return graph_ == nullptr; }
  double constant() const { return constant_; }
  bool is(double value) const { return is_constant() && constant_ == value; }
  ExpressionGraph* graph() const { return graph_; }
  std::int32_t node() const { return node_; }

  Expression operator-() const;
  friend Expression operator+(const Expression& a, const Expression& b);
  friend Expression operator-(const Expression& a, const Expression& b);
  friend Expression operator*(const Expression& a, const Expression& b);
  friend Expression operator/(const Expression& a, const Expression& b);
  Expression& operator+=(const Expression& b) { return *this = *this + b; }
  Expression& operator-=(const Expression& b) { return *this = *this - b; }

 private:
  ExpressionGraph* graph_ = nullptr;
  std::int32_t node_ = -1;
  double constant_ = 0.0;
};

Expression sin(const Expression& x);
Expression cos(const Expression& x);
Expression exp(const Expression& x);
Expression log(const Expression& x);
Expression sqrt(const Expression& x);
Expression abs(const Expression& x);
Expression tanh(const Expression& x);
Expression floor(const Expression& x);
Expression nearest(const Expression& x);  ///< ties to even
Expression atan2(const Expression& y, const Expression& x);
Expression min(const Expression& a, const Expression& b);
Expression max(const Expression& a, const Expression& b);
Expression copysign(const Expression& a, const Expression& b);

// Conditions are expressions of their own kind: they stand in select, logical_* and condition_of alone, and number_of
// makes 1 and 0 of them. Constant ones are the constants 1 and 0.
Expression less(const Expression& a, const Expression& b);
Expression less_equal(const Expression& a, const Expression& b);
Expression equal(const Expression& a, const Expression& b);
Expression logical_not(const Expression& m);
Expression logical_and(const Expression& m, const Expression& n);
Expression logical_or(const Expression& m, const Expression& n);
Expression select(const Expression& m, const Expression& a, const Expression& b);
bool is_condition(const Expression& x);
Expression number_of(const Expression& x);     ///< what is no condition stays what it is
Expression condition_of(const Expression& x);  ///< x != 0

/// The nodes behind expressions. Operands come before what uses them.
class ExpressionGraph {
 public:
  enum class Op : std::uint8_t {
    symbol,
    constant,
    add,
    subtract,
    multiply,
    divide,
    negate,
    sine,
    cosine,
    exponential,
    logarithm,
    square_root,
    magnitude,
    hyperbolic_tangent,
    floor,
    nearest,
    arc_tangent2,
    min,
    max,
    copysign,
    less,
    less_equal,
    equal,
    logical_not,
    logical_and,
    logical_or,  // conditions
    select
  };
  struct Node {
    Op op = Op::constant;
    std::int32_t a = -1, b = -1, c = -1;  ///< operands
    double value = 0.0;                   ///< of a constant
    std::string text;                     ///< of a symbol: how the emitted code calls it
  };

  ExpressionGraph() = default;
  ExpressionGraph(const ExpressionGraph&) = delete;
  ExpressionGraph& operator=(const ExpressionGraph&) = delete;

  /// A quantity that the emitted code is given.
  Expression symbol(const std::string& text);

  const std::vector<Node>& nodes() const { return nodes_; }
  /// The node of a constant too.
  std::int32_t node_of(const Expression& x);
  Expression make(Op op, const Expression& a);
  Expression make(Op op, const Expression& a, const Expression& b);
  Expression make(Op op, const Expression& a, const Expression& b, const Expression& c);

 private:
  std::int32_t add(Node node);
  Expression keep(Node node);

  std::vector<Node> nodes_;
  using Key = std::tuple<Op, std::int32_t, std::int32_t, std::int32_t, double, std::string>;
  std::map<Key, std::int32_t> known_;
};

/// Straight-line C++ of the expressions that `outputs` need, `indent` before every line: "const S t3 = t1 * t2;". What
/// is used once stands where it is used. Sines and cosines of one argument are one sincos. Texts of the outputs come
/// back in `values`. Deterministic. `operations`, nullable, counts arithmetic.
std::string emit_code(ExpressionGraph& graph, const std::vector<Expression>& outputs, const std::string& indent,
                      std::vector<std::string>& values, int* operations = nullptr);

/// The same with "target = value;" for every output as soon as it is known, so that many outputs do not all wait for
/// the end in registers that there are not.
std::string emit_assignments(ExpressionGraph& graph, const std::vector<Expression>& outputs,
                             const std::vector<std::string>& targets, const std::string& indent,
                             int* operations = nullptr);

/// The functions of tiller/scalar.hpp that an emitted text calls, as "sin", "select".
std::vector<std::string> called_functions(const ExpressionGraph& graph, const std::vector<Expression>& outputs);

/// Values of expressions, by the values of symbols. Conditions are 1 or 0.
std::vector<double> evaluate(const ExpressionGraph& graph, const std::vector<Expression>& outputs,
                             const std::function<double(const std::string& symbol)>& value_of);

}  // namespace tiller::tools
