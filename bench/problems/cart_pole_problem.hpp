#pragma once

// The cart-pole of the comparisons, in plain double: what every planner and every peer is measured by. It shares no
// text with the runtime, so a mistake there shows here as a cost that does not fit.
//
// Cart 1 kg, uniform pole 0.1 kg of half length 0.5 m, 20 ms, semi-implicit Euler, angle 0 upright, from hanging at
// rest. Cost of N steps: 1/2 sum over k < N of (x'Qx + u'Ru), and 1/2 x_N' Qf x_N; the period is no factor.

#include <cmath>
#include <vector>

namespace tiller::bench {

struct CartPoleProblem {
  static constexpr int nx = 4;  // position, angle, velocity, rate
  static constexpr double kPeriod = 0.02, kGravity = 9.81, kInputLimit = 20.0;
  static constexpr double kStateWeight[nx] = {0.1, 1.0, 0.01, 0.01}, kInputWeight = 0.001;
  static constexpr double kTerminalWeight[nx] = {100.0, 100.0, 10.0, 10.0};
  static constexpr double kStart[nx] = {0.0, 3.14159265358979323846, 0.0, 0.0};

  double cart_mass_kg = 1.0, pole_mass_kg = 0.1, half_length_m = 0.5;

  /// One period; `fx` (4 x 4, row-major) and `fu` (4) are its derivatives, both null for none.
  void step(const double* x, double u, double* next, double* fx = nullptr, double* fu = nullptr) const {
    const double A = cart_mass_kg + pole_mass_kg, h = pole_mass_kg * half_length_m;
    const double J = 4.0 / 3.0 * pole_mass_kg * half_length_m * half_length_m;
    const double s = std::sin(x[1]), c = std::cos(x[1]), w = x[3], dt = kPeriod;
    const double push = u + h * s * w * w, turn = h * kGravity * s;
    const double inverse = 1.0 / (A * J - h * h * c * c);
    const double ax = (J * push - h * c * turn) * inverse, aw = (A * turn - h * c * push) * inverse;
    next[2] = x[2] + dt * ax;
    next[3] = w + dt * aw;
    next[0] = x[0] + dt * next[2];
    next[1] = x[1] + dt * next[3];
    if (!fx) return;
    const double push_a = h * c * w * w, turn_a = h * kGravity * c, share = 2.0 * h * h * c * s * inverse;
    const double push_w = 2.0 * h * s * w;
    // rows: velocity, rate; columns: angle, rate
    const double va = dt * ((J * push_a + h * s * turn - h * c * turn_a) * inverse - ax * share);
    const double wa = dt * ((A * turn_a + h * s * push - h * c * push_a) * inverse - aw * share);
    const double vw = dt * J * push_w * inverse, ww = 1.0 - dt * h * c * push_w * inverse;
    const double rows[16] = {1, dt * va, dt, dt * vw, 0, 1 + dt * wa, 0, dt * ww, 0, va, 1, vw, 0, wa, 0, ww};
    for (int i = 0; i < 16; ++i) fx[i] = rows[i];
    fu[2] = dt * J * inverse;
    fu[3] = -dt * h * c * inverse;
    fu[0] = dt * fu[2];
    fu[1] = dt * fu[3];
  }

  static double stage(const double* x, double u) {
    double sum = kInputWeight * u * u;
    for (int i = 0; i < nx; ++i) sum += kStateWeight[i] * x[i] * x[i];
    return 0.5 * sum;
  }
  static double terminal(const double* x) {
    double sum = 0.0;
    for (int i = 0; i < nx; ++i) sum += kTerminalWeight[i] * x[i] * x[i];
    return 0.5 * sum;
  }
};

/// A motion, and what it cost. The angle counts from the upright in which the motion ended, unwrapped: the pole may be
/// swung up on either side, and for solvers that do not wrap angles one is the other's mirror image.
class Motion {
 public:
  void add(const double* x, double u) {
    for (int i = 0; i < CartPoleProblem::nx; ++i) rows_.push_back(x[i]);
    rows_.push_back(u);
  }
  /// Of the steps alone; 1e9 if it is not finite.
  double cost() const { return rows_.empty() ? 0.0 : cost_from(upright(rows_[rows_.size() - 4]), nullptr); }
  /// And of the state that the last step ended in.
  double cost(const double* last) const { return cost_from(upright(last[1]), last); }

 private:
  static double upright(double angle) {
    const double turn = 2.0 * CartPoleProblem::kStart[1];
    return turn * std::nearbyint(angle / turn);
  }
  double cost_from(double up, const double* last) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < rows_.size(); k += 5) {
      const double x[4] = {rows_[k], rows_[k + 1] - up, rows_[k + 2], rows_[k + 3]};
      sum += CartPoleProblem::stage(x, rows_[k + 4]);
    }
    if (last) {
      const double x[4] = {last[0], last[1] - up, last[2], last[3]};
      sum += CartPoleProblem::terminal(x);
    }
    return std::isfinite(sum) ? sum : 1e9;
  }
  std::vector<double> rows_;  // (steps x (4 states, input))
};

/// Cost of a sequence of n inputs from hanging, in double.
template <class T>
double sequence_cost(const T* u, int n) {
  double x[4], next[4];
  for (int i = 0; i < 4; ++i) x[i] = CartPoleProblem::kStart[i];
  Motion motion;
  for (int k = 0; k < n; ++k) {
    motion.add(x, static_cast<double>(u[k]));
    CartPoleProblem{}.step(x, static_cast<double>(u[k]), next);
    for (int i = 0; i < 4; ++i) x[i] = next[i];
  }
  return motion.cost(x);
}

/// Optimal costs from hanging, as two independent solvers agree on them.
constexpr double kOptimumFree50 = 72.2651, kOptimumBox50 = 122.0087;

}  // namespace tiller::bench
