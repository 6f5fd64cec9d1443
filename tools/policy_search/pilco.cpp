#include "tools/policy_search/pilco.hpp"

#include <chrono>
#include <cmath>
#include <limits>

#include "tools/policy_search/lbfgs.hpp"

namespace tiller::tools::policy {
namespace {

double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

Controller controller_of(const Policy& policy) {
  return [policy](const Vector& measured, int) { return policy.command(measured); };
}

/// Mean and covariance of the policy's features at the start.
void start_features(const SearchTask& task, Vector& mean, Matrix& covariance) {
  Tape tape;
  VarNormal state(task.states);
  state.mean = VarMatrix(tape, task.start_mean);
  state.covariance = VarMatrix(tape, task.start_covariance);
  const VarNormal seen = with_sines(state, task.angles).part(task.policy_inputs);
  mean = seen.mean.values();
  covariance = seen.covariance.values();
}

/// Sine and cosine vary by about 0.7 over a turn.
Vector first_lengths(const SearchTask& task) {
  Vector length(static_cast<Eigen::Index>(task.policy_inputs.size()));
  for (Eigen::Index i = 0; i < length.size(); ++i)
    length(i) = task.policy_inputs[static_cast<std::size_t>(i)] < task.states ? 1.0 : 0.7;
  return length;
}

}  // namespace

void Transitions::add(const SearchTask& task, const Trial& trial) {
  const Eigen::Index count = trial.command.cols(), nu = trial.command.rows(), before = input.cols();
  const auto seen = static_cast<Eigen::Index>(task.model_inputs.size());
  input.conservativeResize(seen + nu, before + count);
  target.conservativeResize(task.states, before + count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const Vector x = trial.measured.col(k), f = features_of(task, x);
    for (Eigen::Index i = 0; i < seen; ++i) input(i, before + k) = f(task.model_inputs[static_cast<std::size_t>(i)]);
    input.col(before + k).tail(nu) = trial.command.col(k);
    Vector expected = x;
    Matrix slope;
    if (task.physics) task.physics(x, trial.command.col(k), expected, slope);
    target.col(before + k) = trial.measured.col(k + 1) - expected;
  }
}

Policy policy_of(const SearchTask& task, Trainable& trainable, const Vector& parameters) {
  Policy policy;
  trainable.set(parameters);
  trainable.write(policy);
  const std::vector<Feature> all = all_features(task.states, task.angles);
  for (const int i : task.policy_inputs) policy.features.push_back(all[static_cast<std::size_t>(i)]);
  policy.low = task.low;
  policy.high = task.high;
  return policy;
}

std::unique_ptr<Trainable> make_trainable(const SearchTask& task, const SearchOptions& options, Vector& first) {
  const int features = static_cast<int>(task.policy_inputs.size());
  auto trainable = options.kind == "linear" ? make_linear(features, task.commands())
                                            : make_rbf(features, task.commands(), options.bumps);
  Vector mean;
  Matrix covariance;
  start_features(task, mean, covariance);
  first = first_parameters(*trainable, mean, covariance, first_lengths(task), 0.1, options.seed);
  return trainable;
}

bool search_policy(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const Improve& improve,
                   const SearchProgress& after, const volatile std::sig_atomic_t& stop, SearchResult& result,
                   std::string& error) {
  result = {};
  Transitions data;
  GpShape shape;
  Vector parameters;
  const auto trainable = make_trainable(task, options, parameters);
  for (int i = 0; i < options.random_trials + options.trials; ++i) {
    SearchStep step;
    step.predicted = std::numeric_limits<double>::quiet_NaN();
    const double begun = now_s();
    Controller controller = random_controller(task.low, task.high, options.seed, i);
    if (i >= options.random_trials) {
      fit_shape(data.input, data.target, options.gp, options.seed, shape);
      const Bumps dynamics = condition(data.input, data.target, shape, options.gp);
      improve(dynamics, *trainable, i, parameters);
      step.predicted = long_term_cost(task, dynamics, *trainable, parameters, nullptr, &step.forecast);
      step.noise = shape.log_noise.array().exp().matrix();
      result.policy = policy_of(task, *trainable, parameters);
      controller = controller_of(result.policy);
    }
    if (stop) {
      result.interrupted = true;
      return true;
    }
    step.seconds = now_s() - begun;
    if (!run(controller, i, step.trial, error)) return false;
    step.cost = realised_cost(task, step.trial);
    data.add(task, step.trial);
    result.steps.push_back(std::move(step));
    if (after) after(result.steps.back(), i);
  }
  return true;
}

namespace {

/// Fresh policies that are only judged for each one that is searched from.
constexpr int kDrawn = 10;

/// Mean and covariance of the policy's features where the dynamics have data; the start's where they look at others.
void seen_features(const SearchTask& task, const Bumps& dynamics, Vector& mean, Matrix& covariance) {
  if (task.policy_inputs != task.model_inputs) return start_features(task, mean, covariance);
  const Matrix seen = dynamics.x.topRows(static_cast<Eigen::Index>(task.policy_inputs.size()));
  mean = seen.rowwise().mean();
  const Matrix away = seen.colwise() - mean;
  covariance = away * away.transpose() / static_cast<double>(std::max<Eigen::Index>(1, seen.cols() - 1));
}

/// The best of `restarts` short searches from fresh policies, or `parameters` where none is better.
void restart(const SearchTask& task, const Bumps& dynamics, Trainable& trainable, const SearchOptions& options,
             const Objective& objective, int trial, Vector& parameters) {
  double least = long_term_cost(task, dynamics, trainable, parameters, nullptr);
  Vector mean;
  Matrix covariance;
  seen_features(task, dynamics, mean, covariance);
  LbfgsOptions how;
  how.evaluations = std::max(1, options.evaluations / 2);
  how.decrease = 1e-3;
  for (int r = 0; r < options.restarts; ++r) {
    Vector best;
    double best_cost = std::numeric_limits<double>::infinity();
    for (int d = 0; d < kDrawn; ++d) {
      const auto draw = static_cast<std::uint64_t>((trial * options.restarts + r) * kDrawn + d + 1);
      // from a hundredth to all of the range: what swings and what holds are both among them
      const Vector p = first_parameters(trainable, mean, covariance, first_lengths(task),
                                        std::pow(10.0, -2.0 * d / kDrawn), options.seed + (draw << 40));
      const double cost = long_term_cost(task, dynamics, trainable, p, nullptr);
      if (cost < best_cost) best_cost = cost, best = p;
    }
    if (best.size() == 0) continue;
    const double found = minimise(objective, best, how).value;
    if (found < least) least = found, parameters = best;
  }
}

}  // namespace

bool pilco(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const SearchProgress& after,
           const volatile std::sig_atomic_t& stop, SearchResult& result, std::string& error) {
  const Improve improve = [&](const Bumps& dynamics, Trainable& trainable, int trial, Vector& parameters) {
    const Objective objective = [&](const Vector& p, Vector& gradient) {
      return stop ? std::numeric_limits<double>::quiet_NaN() : long_term_cost(task, dynamics, trainable, p, &gradient);
    };
    LbfgsOptions how;
    how.evaluations = options.evaluations;
    how.decrease = 1e-4;
    const double expected = minimise(objective, parameters, how).value;
    if (!(expected < options.restart_above * task.horizon))
      restart(task, dynamics, trainable, options, objective, trial, parameters);
  };
  return search_policy(task, run, options, improve, after, stop, result, error);
}

}  // namespace tiller::tools::policy
