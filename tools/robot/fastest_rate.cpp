#include "tools/robot/fastest_rate.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "tools/robot/robot_equations.hpp"

namespace tiller::tools {

double fastest_rate_1_s(const tiller_config_t& config, const double* state, const double* input) {
  constexpr double kStep = 1e-6;
  const tiller_model_t& m = *config.model;
  if (!m.dynamics) return 0.0;
  const Eigen::Index nx = m.state_count;
  std::vector<double> params;
  for (std::uint32_t i = 0; i < m.param_count; ++i) params.push_back(parameter_at(config.priors[i], 0.5));
  const double forces[TILLER_MAX_JOINTS] = {};
  const auto rates = [&](Eigen::Index moved, double step) {
    Eigen::VectorXd x = Eigen::Map<const Eigen::VectorXd>(state, nx), dxdt(nx);
    x[moved] += step;
    m.dynamics(x.data(), input, forces, &config.body, params.data(), dxdt.data());
    return dxdt;
  };
  Eigen::MatrixXd a(nx, nx);
  for (Eigen::Index i = 0; i < nx; ++i) {
    const double step = kStep * std::max(1.0, std::abs(state[i]));
    a.col(i) = (rates(i, step) - rates(i, -step)) / (2.0 * step);
  }
  if (!a.allFinite()) return 0.0;
  const double rate = Eigen::EigenSolver<Eigen::MatrixXd>(a, false).eigenvalues().cwiseAbs().maxCoeff();
  return rate > kStep ? rate : 0.0;
}

}  // namespace tiller::tools
