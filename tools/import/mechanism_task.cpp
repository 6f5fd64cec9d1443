// The linear model of a description at rest: M dq'' = -K dq - D dq' + G du, over one period.

#include "tools/import/mechanism_task.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "tools/import/inverse_dynamics.hpp"

namespace tiller::tools {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kStep = 1e-5;  // of the central difference, rad or m
constexpr int kTerms = 12;      // of the exponential's series

class Resting {
 public:
  Resting(const Mechanism& mechanism, const ModelNames& names)
      : mechanism_(mechanism), names_(names), inertia_(body_inertias(mechanism)) {}

  /// A and B of one period, row-major.
  void linearise(const std::vector<double>& position, double period_s, std::vector<double>& a,
                 std::vector<double>& b) const {
    const auto n = static_cast<Eigen::Index>(names_.bodies.size()), m = static_cast<Eigen::Index>(names_.inputs.size());
    MatrixXd mass(n, n), stiffness(n, n), drive = MatrixXd::Zero(n, m), damping = MatrixXd::Zero(n, n);
    const std::vector<double> rest(mechanism_.bodies.size());
    for (Eigen::Index j = 0; j < n; ++j) {
      const MovingBody& body = mechanism_.bodies[body_of(j)];
      mass.col(j) = forces(position, moved(rest, j, 1.0), {});
      const Vec3<double>& g = mechanism_.gravity_m_s2;
      const Vec3<double> up{-g[0], -g[1], -g[2]};
      stiffness.col(j) =
          (forces(moved(position, j, kStep), rest, up) - forces(moved(position, j, -kStep), rest, up)) / (2.0 * kStep);
      stiffness(j, j) += body.stiffness;
      damping(j, j) = body.damping;
      if (body.has_goal()) {
        stiffness(j, j) += body.law.stiffness;
        damping(j, j) += body.law.damping;
      }
      if (names_.input_of[static_cast<std::size_t>(j)] >= 0)
        drive(j, names_.input_of[static_cast<std::size_t>(j)]) = body.has_goal() ? body.law.stiffness : 1.0;
    }
    const Eigen::LDLT<MatrixXd> solver(mass);
    MatrixXd whole = MatrixXd::Zero(2 * n + m, 2 * n + m);
    whole.block(0, n, n, n).setIdentity();
    whole.block(n, 0, n, n) = -solver.solve(stiffness);
    whole.block(n, n, n, n) = -solver.solve(damping);
    whole.block(n, 2 * n, n, m) = solver.solve(drive);
    const MatrixXd step = exponential(whole * period_s);
    for (Eigen::Index r = 0; r < 2 * n; ++r) {
      for (Eigen::Index c = 0; c < 2 * n; ++c) a.push_back(step(r, c));
      for (Eigen::Index c = 0; c < m; ++c) b.push_back(step(r, 2 * n + c));
    }
  }

 private:
  std::size_t body_of(Eigen::Index joint) const {
    return static_cast<std::size_t>(names_.bodies[static_cast<std::size_t>(joint)]);
  }

  /// What follows joint j goes along.
  std::vector<double> moved(std::vector<double> bodies, Eigen::Index j, double way) const {
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      const MovingBody& body = mechanism_.bodies[i];
      if (i == body_of(j)) bodies[i] += way;
      if (body.mimics == static_cast<int>(body_of(j))) bodies[i] += body.mimic_ratio * way;
    }
    return bodies;
  }

  VectorXd forces(const std::vector<double>& position, const std::vector<double>& acceleration,
                  const Vec3<double>& base) const {
    const std::vector<double> still(position.size());
    const std::vector<double> all = joint_forces<double>(mechanism_, inertia_, position, still, acceleration, base);
    VectorXd out(static_cast<Eigen::Index>(names_.bodies.size()));
    for (Eigen::Index j = 0; j < out.size(); ++j) {
      out[j] = all[body_of(j)];
      for (std::size_t i = 0; i < all.size(); ++i)
        if (mechanism_.bodies[i].mimics == static_cast<int>(body_of(j)))
          out[j] += mechanism_.bodies[i].mimic_ratio * all[i];
    }
    return out;
  }

  /// By scaling and squaring.
  static MatrixXd exponential(MatrixXd m) {
    const double size = m.cwiseAbs().rowwise().sum().maxCoeff();
    const int halvings = size > 0.5 && std::isfinite(size) ? static_cast<int>(std::ceil(std::log2(size / 0.5))) : 0;
    m /= std::ldexp(1.0, halvings);
    MatrixXd term = MatrixXd::Identity(m.rows(), m.cols()), sum = term;
    for (int k = 1; k <= kTerms; ++k) {
      term = term * m / k;
      sum += term;
    }
    for (int k = 0; k < halvings; ++k) sum = (sum * sum).eval();
    return sum;
  }

  const Mechanism& mechanism_;
  const ModelNames& names_;
  std::vector<BodyInertia<double>> inertia_;
};

}  // namespace

void linearise_mechanism(const Mechanism& mechanism, const ModelNames& names, const std::vector<double>& start,
                         const std::vector<double>& target, LinearTask& task) {
  const Resting resting(mechanism, names);
  task.states = 2 * names.bodies.size();
  task.inputs = names.inputs.size();
  resting.linearise(start, task.period_s, task.start_a, task.start_b);
  resting.linearise(target, task.period_s, task.target_a, task.target_b);
  task.way.assign(task.states, 0.0);
  for (std::size_t j = 0; j < names.bodies.size(); ++j) {
    const auto body = static_cast<std::size_t>(names.bodies[j]);
    task.way[j] = target[body] - start[body];
  }
}

}  // namespace tiller::tools
