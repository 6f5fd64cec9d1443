#include "tools/gap/search/joint_reach.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>

namespace tiller::tools::gap {
namespace {

constexpr int kShapes = static_cast<int>(kReachShapes);
constexpr double kPi = 3.14159265358979323846;

double reach_in(Session& s, const Candidate& base, std::size_t index, std::uint32_t joint) {
  if (!s.shooting->open_response(base.hypothesis, base.fit, index, joint)) return INFINITY;
  const double points = static_cast<double>(s.windows[index].points);
  s.shooting->force_response(index, [&](std::size_t k, double, double* force) {
    for (int shape = 0; shape < kShapes; ++shape)
      force[shape] = std::cos(kPi * shape * (static_cast<double>(k) + 0.5) / points);
  });
  const double* products = s.shooting->response_products();
  Eigen::MatrixXd square = Eigen::Map<const Eigen::MatrixXd>(products, kShapes, kShapes);
  const Eigen::VectorXd cross = Eigen::Map<const Eigen::VectorXd>(products + kShapes * kShapes, kShapes);
  square.diagonal().array() += 1e-9 * square.diagonal().maxCoeff() + 1e-12;
  const double most = cross.dot(square.ldlt().solve(cross));
  return std::isfinite(most) ? most : INFINITY;
}

}  // namespace

std::vector<double> joint_reach(Session& s, const Candidate& base) {
  std::vector<double> reach(s.config.model->joint_count, 0.0);
  for (std::uint32_t joint = 0; joint < s.config.model->joint_count; ++joint)
    for (const std::size_t index : s.screen) {
      if (s.stopped()) return reach;
      reach[joint] += reach_in(s, base, index, joint);
    }
  return reach;
}

}  // namespace tiller::tools::gap
