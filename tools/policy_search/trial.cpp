#include "tools/policy_search/trial.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <csignal>

#include "core/rng.hpp"
#include "tools/links/link.hpp"
#include "tools/links/model_plant.hpp"

namespace tiller::tools::policy {
namespace {

constexpr std::uint32_t kRngTrial = 92, kRngExplore = 93;  // purposes of random numbers (core/rng.hpp)

/// The plant and, after it, what links to it.
struct Opened {
  std::unique_ptr<SimPlant> ode;
  std::unique_ptr<ModelPlant> model;
  std::unique_ptr<Link> link;
};

bool open_plant(const RobotFile& robot, Opened& opened, std::string& error) {
  if (robot.sim.plant == "model") {
    opened.model = ModelPlant::make(robot, error);
    if (opened.model) opened.link = make_model_link(robot, *opened.model);
  } else {
    opened.ode = make_sim_plant(robot, error);
    if (opened.ode) opened.link = make_sim_link(robot, *opened.ode, false);
  }
  return opened.link != nullptr;
}

Vector normal_draw(const Vector& mean, const Matrix& covariance, Rng& rng) {
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(covariance);
  Vector z(mean.size());
  for (Eigen::Index i = 0; i < z.size(); ++i) z(i) = rng.normal();
  return mean + eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().cwiseProduct(z);
}

/// The robot file of one trial: its start, the period of the policy, no watchdog that a long period would trip.
RobotFile robot_of(const RobotFile& robot, const TrialOptions& options, const Vector& start, int index) {
  RobotFile now = robot;
  now.config.period_s = options.period_s;
  now.sim.watchdog_s = 0;
  now.sim.noise_seed = options.seed * 1000 + static_cast<std::uint64_t>(index) + 1;
  for (Eigen::Index i = 0; i < start.size(); ++i) {
    now.config.initial_state[i] = start(i);
    const auto named = now.sim.state.find(now.states[static_cast<std::size_t>(i)]);
    if (named != now.sim.state.end()) named->second = start(i);
  }
  return now;
}

Vector truth_of(const Link& link, Eigen::Index nx) {
  double x[TILLER_MAX_STATES];
  link.truth(x);
  return Eigen::Map<Vector>(x, nx);
}

}  // namespace

RunTrial trials_on_plant(const RobotFile& robot, const TrialOptions& options) {
  return [robot, options](const Controller& controller, int index, Trial& trial, std::string& error) {
    const Eigen::Index nx = options.start_mean.size(), nu = static_cast<Eigen::Index>(robot.inputs.size());
    Rng rng(options.seed, kRngTrial, static_cast<std::uint64_t>(index));
    const RobotFile now =
        robot_of(robot, options, normal_draw(options.start_mean, options.start_covariance, rng), index);
    Opened opened;
    if (!open_plant(now, opened, error)) return false;
    trial = {Matrix(nx, options.horizon + 1), Matrix(nx, options.horizon + 1), Matrix(nu, options.horizon)};
    const volatile std::sig_atomic_t never = 0;
    for (int k = 0; k <= options.horizon; ++k) {
      const Sensed sensed = opened.link->wait(never);
      trial.truth.col(k) = truth_of(*opened.link, nx);
      for (Eigen::Index i = 0; i < nx; ++i)
        trial.measured(i, k) = trial.truth(i, k) + options.noise_sd(i) * rng.normal();
      if (k == options.horizon) break;
      trial.command.col(k) = controller(trial.measured.col(k), k);
      tiller_command_t command{};
      command.stamp_us = sensed.now_us;
      std::copy_n(trial.command.col(k).data(), nu, command.value);
      (void)opened.link->send(command);
    }
    if (trial.truth.allFinite()) return true;
    error = robot.path + ": the plant's state is not finite, or it has not all states of the model; a policy needs all";
    return false;
  };
}

Vector measured_deviation(const RobotFile& robot, double period_s) {
  Vector sd = Vector::Zero(static_cast<Eigen::Index>(robot.states.size()));
  for (const auto& [name, value] : robot.sim.sensor_sd) {
    const int i = index_of(robot.states, name);
    if (i >= 0) sd(i) = value;
  }
  const tiller_model_t& model = *robot.model;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const int q = model.joints[j].position, v = model.joints[j].velocity;
    if (q >= 0 && v >= 0 && sd(v) == 0.0) sd(v) = 1.4142135623730951 * sd(q) / period_s;
  }
  return sd;
}

Controller random_controller(const Vector& low, const Vector& high, std::uint64_t seed, int index) {
  return [low, high, seed, index](const Vector&, int k) {
    Rng rng(seed, kRngExplore, (static_cast<std::uint64_t>(index) << 20) + static_cast<std::uint64_t>(k));
    Vector u(low.size());
    for (Eigen::Index i = 0; i < u.size(); ++i) u(i) = low(i) + (high(i) - low(i)) * rng.uniform();
    return u;
  };
}

Vector features_of(const SearchTask& task, const Vector& state) {
  const std::vector<Feature> all = all_features(task.states, task.angles);
  Vector f(static_cast<Eigen::Index>(all.size()));
  for (std::size_t i = 0; i < all.size(); ++i) f(static_cast<Eigen::Index>(i)) = all[i].of(state);
  return f;
}

double realised_cost(const SearchTask& task, const Trial& trial) {
  double sum = 0;
  for (Eigen::Index k = 1; k < trial.truth.cols(); ++k)
    sum += saturating_cost(features_of(task, trial.truth.col(k)), task.target, task.weight);
  return sum;
}

}  // namespace tiller::tools::policy
