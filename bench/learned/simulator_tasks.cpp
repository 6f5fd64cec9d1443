#include "bench/learned/simulator_tasks.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "tools/likelihood_free/pieces.hpp"

namespace tiller::bench {
namespace {

constexpr std::uint32_t kLanes = 64;
constexpr std::uint32_t kRngTransition = 210, kRngTruth = 211, kRngForce = 212, kRngPose = 213, kRngSensor = 214;

const char* const kPuck = R"([simulator]
command = ["%s", "-m", "tiller_tools.mujoco_simulator", "%s/puck.xml", "--parameter", "friction=geom_friction[puck,0]",
           "--measure", "position_m=qpos:slide", "--input", "force_N=push"]
inputs = ["force_N"]
period_s = 0.02
start_s = 600
timeout_s = 120
name = "puck"
[parameters]
friction = { uniform = [0.1, 0.9] }
[measurements]
position_m = { sd = 0.001 }
)";

const char* const kHopper = R"([simulator]
command = ["%s", "-m", "tiller_tools.mujoco_simulator", "%s/hopper.xml", "--parameter",
  "friction=geom_friction[foot,0]",
  "--measure", "x_m=qpos:x", "--measure", "z_m=qpos:z", "--measure", "pitch_rad=qpos:pitch", "--measure",
  "hip_rad=qpos:hip", "--measure", "knee_rad=qpos:knee", "--measure", "ankle_rad=qpos:ankle", "--measure",
  "x_rate_m_s=qvel:x", "--measure", "z_rate_m_s=qvel:z", "--measure", "pitch_rate_rad_s=qvel:pitch", "--measure",
  "hip_rate_rad_s=qvel:hip", "--measure", "knee_rate_rad_s=qvel:knee", "--measure", "ankle_rate_rad_s=qvel:ankle",
  "--input", "hip_Nm=hip", "--input", "knee_Nm=knee", "--input", "ankle_Nm=ankle"]
inputs = ["hip_Nm", "knee_Nm", "ankle_Nm"]
period_s = 0.02
start_s = 600
timeout_s = 120
name = "hopper"
[parameters]
friction = { uniform = [0.1, 0.9] }
[measurements]
x_m = { sd = 0.002 }
z_m = { sd = 0.002 }
pitch_rad = { sd = 0.002 }
hip_rad = { sd = 0.002 }
knee_rad = { sd = 0.002 }
ankle_rad = { sd = 0.002 }
x_rate_m_s = { sd = 0.02 }
z_rate_m_s = { sd = 0.02 }
pitch_rate_rad_s = { sd = 0.02 }
hip_rate_rad_s = { sd = 0.02 }
knee_rate_rad_s = { sd = 0.02 }
ankle_rate_rad_s = { sd = 0.02 }
)";

using tools::Matrix;
using tools::Piece;
using tools::Vector;

/// Two periods of force every half a second, to and fro.
std::vector<Piece> puck_pieces(std::uint64_t seed) {
  Piece piece{Vector::Zero(1), Matrix::Zero(1, 200), Matrix::Zero(1, 200)};
  Rng rng(seed, kRngForce, 0);
  for (Eigen::Index k = 0; k < 200; k += 25) {
    const double force_N = (k / 25 % 2 == 0 ? 1.0 : -1.0) * (12.0 + 6.0 * rng.uniform());
    piece.input(0, k) = piece.input(0, k + 1) = force_N;
  }
  return {piece};
}

/// Eight hops of .3 s from crouched poses that move forwards, torques drawn anew every .06 s.
std::vector<Piece> hopper_pieces(std::uint64_t seed) {
  std::vector<Piece> pieces;
  Rng pose(seed, kRngPose, 0), torque(seed, kRngForce, 0);
  for (int p = 0; p < 8; ++p) {
    Piece piece{Vector::Zero(12), Matrix::Zero(3, 15), Matrix::Zero(12, 15)};
    const double crouch = 0.2 + 0.3 * pose.uniform();
    const double height_m = 0.45 * std::cos(crouch) + 0.5 * std::cos(crouch) + 0.16;
    piece.start(1) = height_m - 1.2 + 0.01 * pose.uniform();
    piece.start(3) = crouch;
    piece.start(4) = -2.0 * crouch;
    piece.start(5) = crouch;
    piece.start(6) = 2.0 * pose.uniform() - 1.0;
    for (Eigen::Index k = 0; k < 15; k += 3)
      for (Eigen::Index i = 0; i < 3; ++i)
        piece.input.block(i, k, 1, 3).setConstant(60.0 * (2.0 * torque.uniform() - 1.0));
    pieces.push_back(piece);
  }
  return pieces;
}

}  // namespace

PaperBox::PaperBox(const PaperTask& paper, double sigma, std::uint64_t seed)
    : task_(paper.task),
      sigma_(sigma),
      episode_(paper.episode(sigma, kEpisodeTicks, seed)),
      config_(paper.task.config) {
  config_.seed = seed;
  if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
  const auto nx = static_cast<Eigen::Index>(episode_.nx), nu = static_cast<Eigen::Index>(episode_.nu);
  for (std::uint32_t k = 0; k < episode_.ticks; ++k)
    problem_.pieces.push_back({Eigen::Map<const Vector>(&episode_.state[k * episode_.nx], nx),
                               Eigen::Map<const Matrix>(&episode_.input[k * episode_.nu], nu, 1),
                               Eigen::Map<const Matrix>(&episode_.state[(k + 1) * episode_.nx], nx, 1)});
  problem_.config = &config_;
  problem_.noise_sd.assign(episode_.nx, 0.0);
  problem_.simulate = [this](const std::vector<tools::Ask>& asks, std::vector<tools::Simulated>& answers,
                             std::string&) { return simulate(asks, answers), true; };
}

void PaperBox::simulate(const std::vector<tools::Ask>& asks, std::vector<tools::Simulated>& answers) const {
  const std::uint32_t nx = episode_.nx, np = config_.param_count;
  answers.assign(asks.size(), {});
  std::vector<double> params(std::size_t{np} * kLanes), next(std::size_t{nx} * kLanes);
  for (std::size_t first = 0; first < asks.size(); first += kLanes) {
    const std::size_t lanes = std::min<std::size_t>(kLanes, asks.size() - first);
    std::vector<Rng> rng;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      const tools::Ask& ask = asks[first + std::min<std::size_t>(lane, lanes - 1)];
      for (std::uint32_t i = 0; i < np; ++i) params[i * kLanes + lane] = ask.params(i);
      rng.emplace_back(ask.seed, kRngTransition, 0);
    }
    for (std::uint32_t k = 0; k < episode_.ticks; ++k) {
      step_lanes(config_, setup_, kLanes, &episode_.state[k * nx], params.data(), &episode_.input[k * episode_.nu],
                 next.data());
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        Matrix end(nx, 1);
        for (std::uint32_t r = 0; r < nx; ++r)
          end(r, 0) = next[r * kLanes + lane] + sigma_ * task_.step_rms[r] * rng[lane].normal();
        answers[first + lane].measured.push_back(std::move(end));
      }
    }
  }
}

MujocoBox::MujocoBox(const std::string& machine, const std::string& python, std::uint64_t seed)
    : seed_(seed), is_puck_(machine == "puck") {
  char text[4000];
  std::snprintf(text, sizeof text, is_puck_ ? kPuck : kHopper, python.c_str(), TILLER_LEARNED);
  std::string errors;
  file_ = tools::parse_simulator_file(text, std::string(TILLER_PYTHON_TOOLS) + "/bench.toml", errors);
  if (!file_) {
    std::fprintf(stderr, "%s", errors.c_str());
    std::exit(1);
  }
  file_->robot.config.seed = seed;
  pool_ = std::make_unique<tools::SimulatorPool>(file_->setup);
  problem_.config = &file_->robot.config;
  problem_.noise_sd = tools::sensor_noise(file_->robot.config);
  problem_.pieces = is_puck_ ? puck_pieces(seed) : hopper_pieces(seed);
  problem_.simulate = tools::pool_simulator(*pool_, problem_.pieces);
}

bool MujocoBox::make_data(std::string& error) {
  truth_ = 0.1 + 0.8 * Rng(seed_, kRngTruth, 0).uniform();
  tools::Ask ask{Vector::Constant(1, truth_), Matrix(problem_.pieces[0].start.size(), problem_.pieces.size()), 1};
  for (std::size_t p = 0; p < problem_.pieces.size(); ++p)
    ask.start.col(static_cast<Eigen::Index>(p)) = problem_.pieces[p].start;
  std::vector<tools::Simulated> answers;
  if (!problem_.simulate({ask}, answers, error)) return false;
  error = answers[0].failure;
  if (!error.empty()) return false;
  Rng rng(seed_, kRngSensor, 0);
  for (std::size_t p = 0; p < problem_.pieces.size(); ++p) {
    Piece& piece = problem_.pieces[p];
    piece.measured = answers[0].measured[p];
    for (Eigen::Index i = 0; i < piece.start.size(); ++i) {
      const double sd = problem_.noise_sd[static_cast<std::size_t>(i)];
      piece.start(i) += sd * rng.normal();
      for (Eigen::Index k = 0; k < piece.measured.cols(); ++k) piece.measured(i, k) += sd * rng.normal();
    }
  }
  return true;
}

}  // namespace tiller::bench
