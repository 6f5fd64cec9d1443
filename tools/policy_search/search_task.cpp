#include "tools/policy_search/search_task.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "rollout/rollout.hpp"
#include "tools/links/trial_plant.hpp"
#include "tools/policy_search/trial.hpp"

namespace tiller::tools::policy {
namespace {

/// The model at fixed parameters, linearised one state at a time.
class ModelStep {
 public:
  ModelStep(const RobotFile& robot, double period_s) : config_(robot.config) {
    const double finer = std::ceil(period_s / robot.config.period_s);
    config_.period_s = period_s;
    config_.substeps = std::min<std::uint32_t>(64, config_.substeps * static_cast<std::uint32_t>(std::max(1.0, finer)));
    for (std::uint32_t i = 0; i < config_.param_count; ++i) params_.push_back(centre_of(config_.priors[i]));
    good_ = make_step_setup(config_, setup_) == tiller_status_ok;
    setup_.delay_steps = 0;
  }

  void operator()(const Vector& x, const Vector& u, Vector& next, Matrix& slope) const {
    const auto nx = static_cast<std::uint32_t>(x.size()), nu = static_cast<std::uint32_t>(u.size());
    constexpr std::uint32_t lanes = kLanePadding;
    std::vector<double> out(std::size_t{nx} * lanes), a(std::size_t{nx} * nx * lanes), b(std::size_t{nx} * nu * lanes);
    std::vector<double> effects(std::size_t{setup_.effect_state_count + 1} * lanes);
    LineariseJob job;
    job.setup = &setup_;
    job.lanes = lanes;
    job.state = {x.data(), 0};
    job.params = {params_.data(), 0};
    job.effect_state = {effects.data(), 0};
    job.control = {u.data(), 0};
    job.next_state = out.data();
    job.a = a.data();
    job.b = b.data();
    select_rollout(*config_.model).linearise(*config_.model, job);
    next.resize(nx);
    slope.resize(nx, nx + nu);
    for (std::uint32_t i = 0; i < nx; ++i) {
      next(i) = good_ ? out[i * lanes] : NAN;
      for (std::uint32_t j = 0; j < nx; ++j) slope(i, j) = a[(i * nx + j) * lanes];
      for (std::uint32_t j = 0; j < nu; ++j) slope(i, nx + j) = b[(i * nu + j) * lanes];
    }
  }

 private:
  Config config_;
  StepSetup setup_;
  std::vector<double> params_;
  bool good_ = false;
};

void fill_weights(const RobotFile& robot, SearchTask& task) {
  const int n = task.feature_count();
  Vector target_state(task.states);
  task.weight = Matrix::Zero(n, n);
  for (int i = 0; i < task.states; ++i) {
    target_state(i) = robot.config.cost.target[i];
    const auto angle = std::find(task.angles.begin(), task.angles.end(), i);
    const double w = robot.config.cost.state_weight[i];
    if (angle == task.angles.end()) {
      task.weight(i, i) = w;
      continue;
    }
    const int sine = task.states + 2 * static_cast<int>(angle - task.angles.begin());
    task.weight(sine, sine) = task.weight(sine + 1, sine + 1) = w;
  }
  task.target = features_of(task, target_state);
}

}  // namespace

PhysicsStep physics_of(const RobotFile& robot, double period_s) {
  const auto step = std::make_shared<ModelStep>(robot, period_s);
  return [step](const Vector& x, const Vector& u, Vector& next, Matrix& slope) { (*step)(x, u, next, slope); };
}

bool make_task(const RobotFile& robot, const TaskOptions& options, SearchTask& task, std::string& error) {
  const tiller_model_t& model = *robot.model;
  const int nx = static_cast<int>(model.state_count), nu = static_cast<int>(model.input_count);
  task = {};
  task.states = nx;
  for (int i = 0; i < nx; ++i)
    if (model.angle_mask >> i & 1u) task.angles.push_back(i);
  for (int i = 0; i < task.feature_count(); ++i)
    if (i >= nx || !(model.angle_mask >> i & 1u)) task.policy_inputs.push_back(i);
  task.model_inputs = task.policy_inputs;
  task.low = Eigen::Map<const Vector>(robot.config.safety.input_low, nu);
  task.high = Eigen::Map<const Vector>(robot.config.safety.input_high, nu);
  if (!task.low.allFinite() || !task.high.allFinite()) {
    error = robot.path + ": [limits]: a policy needs low and high of every input; give them";
    return false;
  }
  task.start_mean = Eigen::Map<const Vector>(robot.config.initial_state, nx);
  task.start_covariance = Eigen::Map<const Vector>(robot.config.initial_state_sd, nx).cwiseAbs2().asDiagonal();
  task.start_covariance.diagonal().array() += 1e-6;
  task.horizon = std::max(1, static_cast<int>(std::lround(options.seconds / options.period_s)));
  fill_weights(robot, task);
  const Vector away = features_of(task, task.start_mean) - task.target;
  const double distance = away.dot(task.weight * away);
  if (!(distance > 0.0)) {
    error = robot.path + ": [cost] state_weight: the start costs nothing, so there is nothing to search; give weights";
    return false;
  }
  task.weight /= options.width > 0 ? options.width * options.width : distance / 16.0;
  if (options.physics) task.physics = physics_of(robot, options.period_s);
  return true;
}

}  // namespace tiller::tools::policy
