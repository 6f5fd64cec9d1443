#pragma once

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

namespace tiller::tools::policy {

class Tape;

/// A number that remembers how it was made. One that no tape knows (id below zero) is a constant.
struct Var {
  Var() = default;
  Var(double constant) : value(constant) {}  // NOLINT(google-explicit-constructor): 2.0 * x shall read like that
  Var(Tape* t, int i, double v) : tape(t), id(i), value(v) {}

  Tape* tape = nullptr;
  int id = -1;
  double value = 0.0;
};

/// Reverse differentiation of what is computed with Var: a node per operation holds its two operands and the partial
/// derivatives with respect to them; one sweep from the last node to the first gives the derivatives of one result with
/// respect to everything. Operations with a derivative of their own (a Gaussian process's moments) are taken as one
/// step: their results are fresh variables, and `defer` is called in the sweep once these have their derivatives.
/// Cost: 24 bytes and about 2 ns an operation.
class Tape {
 public:
  /// A variable that nothing on the tape made.
  Var variable(double value) { return node(-1, 0.0, -1, 0.0, value); }
  Var node(int a, double by_a, int b, double by_b, double value) {
    nodes_.push_back({a, b, by_a, by_b});
    return {this, static_cast<int>(nodes_.size()) - 1, value};
  }
  /// `back` adds to the operands' derivatives (add) what the results' (derivative) make of them. `first` is the first
  /// of the results, which were made after all operands.
  void defer(const Var& first, std::function<void()> back) { deferred_.emplace_back(first.id, std::move(back)); }

  void sweep(const Var& result);
  double derivative(const Var& v) const { return v.id < 0 ? 0.0 : adjoint_[static_cast<std::size_t>(v.id)]; }
  /// Within `back` alone.
  void add(const Var& v, double derivative) {
    if (v.id >= 0) adjoint_[static_cast<std::size_t>(v.id)] += derivative;
  }

 private:
  struct Node {
    int a, b;
    double by_a, by_b;
  };
  std::vector<Node> nodes_;
  std::vector<double> adjoint_;
  std::vector<std::pair<int, std::function<void()>>> deferred_;
};

inline Var unary(const Var& a, double value, double by_a) {
  return a.tape ? a.tape->node(a.id, by_a, -1, 0.0, value) : Var(value);
}
inline Var binary(const Var& a, const Var& b, double value, double by_a, double by_b) {
  Tape* tape = a.tape ? a.tape : b.tape;
  return tape ? tape->node(a.id, by_a, b.id, by_b, value) : Var(value);
}

inline Var operator+(const Var& a, const Var& b) { return binary(a, b, a.value + b.value, 1.0, 1.0); }
inline Var operator-(const Var& a, const Var& b) { return binary(a, b, a.value - b.value, 1.0, -1.0); }
inline Var operator*(const Var& a, const Var& b) { return binary(a, b, a.value * b.value, b.value, a.value); }
inline Var operator-(const Var& a) { return unary(a, -a.value, -1.0); }
inline Var& operator+=(Var& a, const Var& b) { return a = a + b; }
inline Var& operator-=(Var& a, const Var& b) { return a = a - b; }
inline Var exp(const Var& a) {
  const double e = std::exp(a.value);
  return unary(a, e, e);
}
inline Var sin(const Var& a) { return unary(a, std::sin(a.value), std::cos(a.value)); }
inline Var cos(const Var& a) { return unary(a, std::cos(a.value), -std::sin(a.value)); }

}  // namespace tiller::tools::policy
