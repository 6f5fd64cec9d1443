#include "tools/logs/frame_forces.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include "posterior/posterior.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStep = 1e-5;       // rad or m, of central differences
constexpr double kSingular = 1e-3;   // of the Jacobian's largest singular value: below, a direction is not felt
constexpr double kUndecided = 1e-3;  // share of such a direction in a coordinate that is determined nevertheless

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// "tip" of "tip_x_m"; empty: no coordinate of a frame.
std::string frame_of(const std::string& output) {
  if (output.size() < 5) return "";
  const std::string end = output.substr(output.size() - 4);
  return end == "_x_m" || end == "_y_m" || end == "_z_m" ? output.substr(0, output.size() - 4) : "";
}

/// F of tau = J' F by least squares, in the directions of F that joints feel; NaN in coordinates that have a share of
/// others.
void solve(const Matrix& jacobian, const Vector& tau, const Vector& tau_sd, Vector& mean, Vector& sd) {
  mean = sd = Vector::Constant(jacobian.rows(), kNaN);
  if (!jacobian.allFinite() || !tau.allFinite() || !tau_sd.allFinite() || !(tau_sd.array() > 0.0).all()) return;
  const Eigen::JacobiSVD<Matrix> svd(jacobian, Eigen::ComputeFullU);
  const Vector& size = svd.singularValues();
  const Eigen::Index felt = (size.array() > kSingular * size[0]).count();
  if (felt == 0) return;
  const Matrix directions = svd.matrixU().leftCols(felt);
  const Matrix weighted = tau_sd.cwiseInverse().asDiagonal() * jacobian.transpose() * directions;
  const Matrix covariance = (weighted.transpose() * weighted).inverse();
  const Vector force = directions * (covariance * (weighted.transpose() * tau.cwiseQuotient(tau_sd)));
  const Vector deviation = (directions * covariance * directions.transpose()).diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < jacobian.rows(); ++i) {
    if (svd.matrixU().row(i).tail(jacobian.rows() - felt).norm() > kUndecided) continue;
    mean[i] = force[i];
    sd[i] = deviation[i];
  }
}

}  // namespace

FrameForces::FrameForces(const tiller_config_t& config) : config_(config), joints_(Posterior::force_joints(config)) {
  const tiller_model_t& model = *config.model;
  for (std::uint32_t j = 0; j < joints_; ++j)
    if (model.joints[j].position == TILLER_NO_POSITION) return;
  std::map<std::string, std::vector<std::uint32_t>> coordinates;
  for (std::uint32_t i = 0; joints_ > 0 && i < model.output_count; ++i)
    if (const std::string frame = frame_of(model.output_names[i]); !frame.empty()) coordinates[frame].push_back(i);
  for (const auto& [frame, outputs] : coordinates) {
    if (outputs.size() < 2) continue;
    frames_.push_back(outputs);
    for (const std::uint32_t i : outputs) {
      const std::string output = model.output_names[i];
      names_.push_back(output.substr(0, output.size() - 1) + "N");
    }
  }
}

void FrameForces::compute(const tiller_info_t& info, double* mean, double* sd) const {
  if (frames_.empty()) return;
  const tiller_model_t& model = *config_.model;
  double state[TILLER_MAX_STATES], high[TILLER_MAX_OUTPUTS], low[TILLER_MAX_OUTPUTS];
  std::copy(std::begin(info.state_mean), std::end(info.state_mean), state);
  Matrix jacobian(model.output_count, joints_);
  for (std::uint32_t j = 0; j < joints_; ++j) {
    double& position = state[model.joints[j].position];
    const double at = position;
    position = at + kStep;
    model.outputs(state, info.param_mean, high);
    position = at - kStep;
    model.outputs(state, info.param_mean, low);
    position = at;
    for (std::uint32_t i = 0; i < model.output_count; ++i) jacobian(i, j) = (high[i] - low[i]) / (2.0 * kStep);
  }
  Vector tau(joints_), tau_sd(joints_), force, deviation;
  for (std::uint32_t j = 0; j < joints_; ++j) {
    tau[j] = info.force_mean[j];
    tau_sd[j] = info.force_sd[j];
  }
  std::size_t at = 0;
  for (const std::vector<std::uint32_t>& frame : frames_) {
    Matrix rows(frame.size(), joints_);
    for (std::size_t i = 0; i < frame.size(); ++i)
      rows.row(static_cast<Eigen::Index>(i)) = jacobian.row(static_cast<Eigen::Index>(frame[i]));
    solve(rows, tau, tau_sd, force, deviation);
    for (std::size_t i = 0; i < frame.size(); ++i, ++at) {
      mean[at] = force[static_cast<Eigen::Index>(i)];
      sd[at] = deviation[static_cast<Eigen::Index>(i)];
    }
  }
}

}  // namespace tiller::tools
