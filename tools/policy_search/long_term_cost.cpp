#include "tools/policy_search/long_term_cost.hpp"

#include <cmath>
#include <limits>

namespace tiller::tools::policy {
namespace {

/// Features and, behind them, the commands that the policy gives for them.
VarNormal with_commands(Tape& tape, const SearchTask& task, Trainable& trainable, const VarNormal& all) {
  const VarMoments before = trainable.apply(tape, all.part(task.policy_inputs));
  const VarMoments after = squashed(before.mean, before.covariance, task.low, task.high);
  const int n = all.size(), nu = task.commands();
  const VarMatrix across = (all.covariance.part(range(0, n), task.policy_inputs) * before.gain) * after.gain;
  VarNormal out(n + nu);
  for (int j = 0; j < n + nu; ++j) {
    out.mean(j) = j < n ? all.mean(j) : after.mean(j - n);
    for (int i = 0; i < n + nu; ++i)
      out.covariance(i, j) = i < n && j < n ? all.covariance(i, j)
                             : i < n        ? across(i, j - n)
                             : j < n        ? across(j, i - n)
                                            : after.covariance(i - n, j - n);
  }
  return out;
}

/// The physics' step on the tape: next state and slope at the means, differentiable through central differences of the
/// slope.
struct Linearised {
  VarMatrix next, slope;
};

Linearised linearise(Tape& tape, const SearchTask& task, const VarMatrix& at) {
  const Vector z = at.values();
  const int nx = task.states, n = static_cast<int>(z.size());
  Vector next;
  Matrix slope;
  task.physics(z.head(nx), z.tail(n - nx), next, slope);
  const Linearised out{VarMatrix(tape, next), VarMatrix(tape, slope)};
  tape.defer(out.next(0), [&tape, &task, at, z, nx, n, slope, out] {
    const Matrix by_slope = out.slope.derivatives(tape);
    Vector by = slope.transpose() * out.next.derivatives(tape);
    Vector ignored;
    Matrix above, below;
    for (int k = 0; k < n; ++k) {
      const double h = 1e-4 * (1.0 + std::abs(z(k)));
      Vector moved = z;
      moved(k) = z(k) + h;
      task.physics(moved.head(nx), moved.tail(n - nx), ignored, above);
      moved(k) = z(k) - h;
      task.physics(moved.head(nx), moved.tail(n - nx), ignored, below);
      by(k) += by_slope.cwiseProduct(above - below).sum() / (2.0 * h);
    }
    at.add_to(tape, by);
  });
  return out;
}

/// The state after a period, from features and commands before it.
VarNormal next_state(Tape& tape, const SearchTask& task, const Bumps& dynamics, const VarNormal& all) {
  const int nx = task.states, nu = task.commands();
  std::vector<int> inputs = task.model_inputs;
  for (int i = 0; i < nu; ++i) inputs.push_back(task.feature_count() + i);
  const VarMoments learnt = taped_bumps(tape, dynamics, all.part(inputs), nullptr);
  const VarMatrix across = all.covariance.part(range(0, all.size()), inputs) * learnt.gain;  // (all x nx)
  VarNormal out(nx);
  VarMatrix spread, with_learnt;
  if (task.physics) {
    std::vector<int> origin = range(0, nx);
    for (int i = 0; i < nu; ++i) origin.push_back(task.feature_count() + i);
    const Linearised known = linearise(tape, task, all.mean.part(origin, {0}));
    out.mean = known.next + learnt.mean;
    spread = known.slope * (all.covariance.part(origin, origin) * known.slope.transposed());
    with_learnt = known.slope * across.part(origin, range(0, nx));
  } else {
    out.mean = all.mean.part(range(0, nx), {0}) + learnt.mean;
    spread = all.covariance.part(range(0, nx), range(0, nx));
    with_learnt = across.part(range(0, nx), range(0, nx));
  }
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j <= i; ++j)
      out.covariance(i, j) = out.covariance(j, i) =
          0.5 * (spread(i, j) + spread(j, i)) + learnt.covariance(i, j) + with_learnt(i, j) + with_learnt(j, i);
  return out;
}

void note(const VarNormal& state, int step, double cost, Forecast& forecast) {
  forecast.mean.col(step) = state.mean.values();
  forecast.deviation.col(step) = state.covariance.values().diagonal().cwiseMax(0.0).cwiseSqrt();
  forecast.cost.push_back(cost);
}

VarNormal start_of(Tape& tape, const SearchTask& task) {
  VarNormal state(task.states);
  state.mean = VarMatrix(tape, task.start_mean);
  state.covariance = VarMatrix(tape, task.start_covariance);
  return state;
}

}  // namespace

double long_term_cost(const SearchTask& task, const Bumps& dynamics, Trainable& trainable, const Vector& parameters,
                      Vector* gradient, Forecast* forecast) {
  trainable.set(parameters);
  Tape tape;
  trainable.begin(tape);
  VarNormal state = start_of(tape, task);
  VarNormal all = with_sines(state, task.angles);
  if (forecast) {
    *forecast = {Matrix(task.states, task.horizon + 1), Matrix(task.states, task.horizon + 1), {}};
    note(state, 0, saturating_cost(tape, all, task.target, task.weight).value, *forecast);
  }
  Var total;
  for (int k = 1; k <= task.horizon; ++k) {
    state = next_state(tape, task, dynamics, with_commands(tape, task, trainable, all));
    all = with_sines(state, task.angles);
    const Var cost = saturating_cost(tape, all, task.target, task.weight);
    if (!std::isfinite(cost.value)) return std::numeric_limits<double>::quiet_NaN();
    total += cost;
    if (forecast) note(state, k, cost.value, *forecast);
  }
  if (gradient) {
    tape.sweep(total);
    *gradient = trainable.gradient(tape);
  }
  return total.value;
}

}  // namespace tiller::tools::policy
