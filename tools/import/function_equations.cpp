#include "tools/import/function_equations.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <unordered_map>

namespace tiller::tools {
namespace {

using X = Expression;
using Operands = std::vector<X>;

constexpr double kLargestPower = 64.0;  // by products; beyond, an exponential is as exact

X square(const X& x) { return x * x; }

X whole_power(const X& base, int exponent) {
  if (exponent < 0) return X(1.0) / whole_power(base, -exponent);
  if (exponent == 0) return 1.0;
  const X half = whole_power(base, exponent / 2);
  return exponent % 2 == 0 ? square(half) : square(half) * base;
}

/// Exponents that are whole or end in a half by products and a root. Others by exp(b log a), for positive bases: at 0
/// the root is 0 (or infinite for negative exponents) without a slope, and below it is NaN, as the power is.
X power(const X& base, const X& exponent) {
  if (base.is_constant() && exponent.is_constant()) return std::pow(base.constant(), exponent.constant());
  if (exponent.is_constant() && std::fabs(exponent.constant()) <= kLargestPower) {
    const double b = exponent.constant(), below = std::floor(b);
    if (b == below) return whole_power(base, static_cast<int>(b));
    if (b - below == 0.5) return sqrt(base) * whole_power(base, static_cast<int>(below));
  }
  const X is_positive = less(0.0, base), root = sqrt(base);
  const X otherwise = select(less(exponent, 0.0), X(1.0) / root, root);
  return select(is_positive, exp(exponent * log(select(is_positive, base, 1.0))), otherwise);
}

X truncated(const X& x) { return select(less(x, 0.0), -floor(-x), floor(x)); }
X sign_of(const X& x) { return select(less(0.0, x), 1.0, select(less(x, 0.0), -1.0, 0.0)); }
/// By tanh, which is exact near 0, where a difference of exponentials is not.
X cosh_of(const X& x) {
  const X e = exp(x);
  return X(0.5) * (e + X(1.0) / e);
}
/// cos of an angle from its sine, without the cancellation of 1 - x^2 near 1.
X other_leg(const X& x) { return sqrt((X(1.0) - x) * (X(1.0) + x)); }

/// Both of two that are chosen by one condition and are 0 elsewhere: CasADi's if_else is such a sum.
bool is_branch(const X& x, X& condition, X& then, X& otherwise) {
  if (x.is_constant()) return false;
  const auto& nodes = x.graph()->nodes();
  const ExpressionGraph::Node& node = nodes[static_cast<std::size_t>(x.node())];
  if (node.op != ExpressionGraph::Op::select) return false;
  const auto part = [&](std::int32_t id) {
    const ExpressionGraph::Node& n = nodes[static_cast<std::size_t>(id)];
    return n.op == ExpressionGraph::Op::constant ? X(n.value) : X(x.graph(), id);
  };
  condition = part(node.a), then = part(node.b), otherwise = part(node.c);
  return true;
}
X sum(const X& a, const X& b) {
  X m, then, otherwise, n, then_b, otherwise_b;
  if (is_branch(a, m, then, otherwise) && is_branch(b, n, then_b, otherwise_b) && m.node() == n.node()) {
    if (otherwise.is(0.0) && then_b.is(0.0)) return select(m, then, otherwise_b);
    if (then.is(0.0) && otherwise_b.is(0.0)) return select(m, then_b, otherwise);
  }
  return a + b;
}

/// Of a choice between numbers it is known which are equal to a third: CasADi compares conditions with 0.
X equals(const X& a, const X& b) {
  X m, then, otherwise;
  if (!b.is_constant() || !is_branch(a, m, then, otherwise) || !then.is_constant() || !otherwise.is_constant())
    return equal(a, b);
  const bool first = then.is(b.constant()), second = otherwise.is(b.constant());
  return first == second ? X(first ? 1.0 : 0.0) : first ? m : logical_not(m);
}

struct Operation {
  std::size_t operands;
  bool takes_conditions;
  std::function<X(const Operands&)> result;
};

const std::unordered_map<std::string, Operation>& operations() {
  const auto one = [](X (*f)(const X&)) { return Operation{1, false, [f](const Operands& o) { return f(o[0]); }}; };
  const auto two = [](X (*f)(const X&, const X&)) {
    return Operation{2, false, [f](const Operands& o) { return f(o[0], o[1]); }};
  };
  const auto logical = [](X (*f)(const X&, const X&)) {
    return Operation{2, true, [f](const Operands& o) { return f(condition_of(o[0]), condition_of(o[1])); }};
  };
  static const std::unordered_map<std::string, Operation> table{
      {"assign", one([](const X& x) { return x; })},
      {"add", two(sum)},
      {"sub", two([](const X& a, const X& b) { return a - b; })},
      {"mul", two([](const X& a, const X& b) { return a * b; })},
      {"div", two([](const X& a, const X& b) { return a / b; })},
      {"neg", one([](const X& x) { return -x; })},
      {"inv", one([](const X& x) { return X(1.0) / x; })},
      {"sq", one(square)},
      {"twice", one([](const X& x) { return X(2.0) * x; })},
      {"sqrt", one(sqrt)},
      {"exp", one(exp)},
      {"log", one(log)},
      {"pow", two(power)},
      {"constpow", two(power)},
      {"sin", one(sin)},
      {"cos", one(cos)},
      {"tan", one([](const X& x) { return sin(x) / cos(x); })},
      {"asin", one([](const X& x) { return atan2(x, other_leg(x)); })},
      {"acos", one([](const X& x) { return atan2(other_leg(x), x); })},
      {"atan", one([](const X& x) { return atan2(x, 1.0); })},
      {"atan2", two(atan2)},
      {"sinh", one([](const X& x) { return tanh(x) * cosh_of(x); })},
      {"cosh", one(cosh_of)},
      {"tanh", one(tanh)},
      {"hypot", two([](const X& a, const X& b) { return sqrt(square(a) + square(b)); })},
      {"fabs", one(abs)},
      {"sign", one(sign_of)},
      {"copysign", two(copysign)},
      {"fmin", two(min)},
      {"fmax", two(max)},
      {"floor", one(floor)},
      {"ceil", one([](const X& x) { return -floor(-x); })},
      {"fmod", two([](const X& a, const X& b) { return a - b * truncated(a / b); })},
      {"remainder", two([](const X& a, const X& b) { return a - b * nearest(a / b); })},
      {"lt", two(less)},
      {"le", two(less_equal)},
      {"eq", two(equals)},
      {"ne", two([](const X& a, const X& b) { return logical_not(equals(a, b)); })},
      {"not", {1, true, [](const Operands& o) { return logical_not(condition_of(o[0])); }}},
      {"and", logical(logical_and)},
      {"or", logical(logical_or)},
      {"if_else_zero", {2, true, [](const Operands& o) { return select(condition_of(o[0]), number_of(o[1]), 0.0); }}},
  };
  return table;
}

std::string remedy(const std::string& op) {
  static const std::unordered_map<std::string, std::string> table{
      {"asinh", "write log(x + sqrt(x^2 + 1))"},
      {"acosh", "write log(x + sqrt(x^2 - 1))"},
      {"atanh", "write 0.5 log((1 + x) / (1 - x))"},
      {"log1p", "write log(1 + x)"},
      {"expm1", "write exp(x) - 1"},
      {"erf", "write a tanh of like shape"},
      {"printme", "leave the printing out"},
      {"parameter", "make the free variable an element of p"},
  };
  if (const auto found = table.find(op); found != table.end()) return found->second;
  if (op.rfind("call", 0) == 0)
    return "integrators, rootfinders, tables, external and never inlined functions have no equations here; write the "
           "equations themselves (xdot, not its integral; a table by pw_lin or a polynomial)";
  return "write it in terms of +, -, *, /, sqrt, exp, log, sin, cos, tanh, atan2, floor, fmin, fmax and if_else";
}

class Rebuilder {
 public:
  Rebuilder(const FunctionText& function, const std::vector<std::vector<FunctionArgument>>& inputs,
            std::vector<std::vector<Expression>>& outputs)
      : function_(function), inputs_(inputs), outputs_(outputs) {}

  /// False: the list is none of a function.
  bool run() {
    outputs_.clear();
    for (const FunctionPort& port : function_.outputs) {
      outputs_.emplace_back(port.size());
      open_ += port.size();
    }
    return std::all_of(function_.instructions.begin(), function_.instructions.end(),
                       [&](const FunctionInstruction& i) { return step(i); }) &&
           open_ == 0;
  }

  /// A fault and the results that it reaches, in the order in which they appear.
  std::vector<std::pair<std::string, Words>> faults;

 private:
  bool step(const FunctionInstruction& i) {
    if (i.op == "const") {
      put(i.result, {i.constant, ""});
      return true;
    }
    if (i.op == "input") {
      if (i.operands.size() != 2 || !within(i.operands[0], inputs_) ||
          !within(i.operands[1], inputs_[at(i.operands[0])]))
        return false;
      put(i.result, inputs_[at(i.operands[0])][at(i.operands[1])]);
      return true;
    }
    std::vector<FunctionArgument> operands;
    for (std::size_t k = i.op == "output" ? 1 : 0; k < i.operands.size(); ++k) {
      const auto found = work_.find(i.operands[k]);
      if (found == work_.end()) return false;
      operands.push_back(found->second);
    }
    if (i.op == "output") return operands.size() == 1 && deliver(i.result, i.operands[0], operands[0]);
    return apply(i, operands);
  }

  bool apply(const FunctionInstruction& i, const std::vector<FunctionArgument>& operands) {
    const auto found = operations().find(i.op);
    if (found == operations().end()) {
      put(i.result, {0.0, "operation '" + i.op + "'\n" + remedy(i.op)});
      return true;
    }
    const Operation& operation = found->second;
    if (operands.size() != operation.operands) return false;
    FunctionArgument result;
    Operands values;
    for (const FunctionArgument& o : operands) {
      if (result.fault.empty()) result.fault = o.fault;
      values.push_back(operation.takes_conditions ? o.value : number_of(o.value));
    }
    // what a constant condition leaves out does not matter
    const bool left_out = i.op == "if_else_zero" && operands[0].fault.empty() && values[0].is(0.0);
    if (left_out) result.fault.clear();
    if (result.fault.empty()) result.value = left_out ? X(0.0) : operation.result(values);
    put(i.result, result);
    return true;
  }

  /// A constant that is no number must not meet others: it is equal to none of them, itself included.
  void put(int place, FunctionArgument value) {
    if (value.fault.empty() && value.value.is_constant() && !std::isfinite(value.value.constant()))
      value = {0.0, std::string("a constant ") + (std::isnan(value.value.constant()) ? "NaN" : "infinity") +
                        "\nlook for 0/0, 1/0, log(0) or numpy.nan among the numbers that the function was built with"};
    work_[place] = std::move(value);
  }

  bool deliver(int port, int element, const FunctionArgument& value) {
    if (!within(port, outputs_) || !within(element, outputs_[at(port)])) return false;
    outputs_[at(port)][at(element)] = number_of(value.value);
    --open_;
    if (value.fault.empty()) return true;
    auto found = std::find_if(faults.begin(), faults.end(), [&](const auto& f) { return f.first == value.fault; });
    if (found == faults.end()) found = faults.insert(faults.end(), {value.fault, {}});
    found->second.push_back(function_.outputs[at(port)].name + "[" + std::to_string(element) + "]");
    return true;
  }

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  template <class List>
  static bool within(int i, const List& list) {
    return i >= 0 && at(i) < list.size();
  }

  const FunctionText& function_;
  const std::vector<std::vector<FunctionArgument>>& inputs_;
  std::vector<std::vector<Expression>>& outputs_;
  std::unordered_map<int, FunctionArgument> work_;
  std::size_t open_ = 0;  // elements of results that no instruction has given yet
};

}  // namespace

bool rebuild_equations(const FunctionText& function, const std::vector<std::vector<FunctionArgument>>& inputs,
                       std::vector<std::vector<Expression>>& outputs, Words& errors) {
  Rebuilder rebuilder(function, inputs, outputs);
  if (!rebuilder.run()) {
    errors.push_back(function.path + ": its instructions do not belong together; write it anew from the function");
    return false;
  }
  for (const auto& [fault, results] : rebuilder.faults) {
    const std::size_t end = fault.find('\n');
    errors.push_back(function.path + ": " + join(results) + (results.size() > 1 ? " need " : " needs ") +
                     fault.substr(0, end) + ", which has no place in a model; " + fault.substr(end + 1));
  }
  return rebuilder.faults.empty();
}

}  // namespace tiller::tools
