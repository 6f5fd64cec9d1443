#include "harness/accuracy/accuracy_run.hpp"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>

namespace tiller::bench {
namespace {

constexpr std::uint32_t kReadingStream = 121, kDrawStream = 122;

struct Free {
  void operator()(void* p) const { std::free(p); }
};

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double rank_below(const Eigen::MatrixXd& point, const Eigen::VectorXd& weight, int row, double truth) {
  double below = 0.0;
  for (int i = 0; i < point.cols(); ++i)
    below += weight[i] * (point(row, i) < truth ? 1.0 : point(row, i) == truth ? 0.5 : 0.0);
  return below;
}

double true_value(const AccuracyTask& task, const Episode& episode, int j) {
  return episode.truth[task.inferred[static_cast<std::size_t>(j)]];
}

}  // namespace

EngineResult run_engine(const AccuracyTask& task, const tiller_config_t& config, const Episode& episode,
                        const double* reading_sd, const std::function<void(std::uint32_t, const Posterior&)>& on_tick) {
  StepSetup setup;
  if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
  const RolloutTable& table = select_rollout(*config.model);
  Arena measure;
  Posterior::lay_out(measure, config, setup, table, nullptr);
  const std::unique_ptr<void, Free> memory(std::aligned_alloc(TILLER_ALIGNMENT, measure.used()));
  Arena arena(memory.get(), measure.used());
  Posterior* posterior = Posterior::lay_out(arena, config, setup, table, nullptr);
  if (!posterior) std::abort();

  Rng noise(config.seed, kReadingStream, 0);
  std::vector<Transition> transitions(episode.ticks + 1);
  for (std::uint32_t k = 0; k <= episode.ticks; ++k) {
    Transition& t = transitions[k];
    if (k > 0) t = episode.transition(k - 1, config.period_s);
    for (std::uint32_t i = 0; i < config.measurement_count; ++i)
      t.measured[i] = episode.state[k * episode.nx + config.measured_state[i]] +
                      (reading_sd ? reading_sd[i] * noise.normal() : 0.0);
  }

  EngineResult out;
  out.bytes = measure.used();
  posterior->reset();
  const double begun = thread_seconds();
  if (posterior->start(transitions[0].measured) != tiller_status_ok) ++out.faults;
  for (std::uint32_t k = 1; k <= episode.ticks; ++k) {
    const tiller_status_t said = posterior->update(transitions[k]);
    out.faults += said != tiller_status_ok && said < 200;
    if (on_tick) on_tick(k, *posterior);
  }
  out.seconds = thread_seconds() - begun;

  const int d = static_cast<int>(task.inferred.size()), n = static_cast<int>(posterior->size());
  out.point.resize(d, n);
  out.weight.resize(n);
  double params[TILLER_MAX_PARAMS];
  for (int i = 0; i < n; ++i) {
    posterior->particle(static_cast<std::uint32_t>(i), params, nullptr, &out.weight[i]);
    for (int j = 0; j < d; ++j) out.point(j, i) = params[task.inferred[static_cast<std::size_t>(j)]];
  }
  for (int j = 0; j < d; ++j) out.rank.push_back(rank_below(out.point, out.weight, j, true_value(task, episode, j)));
  return out;
}

double own_log_density(const AccuracyTask& task, const Episode& episode, const EngineResult& online) {
  const int d = static_cast<int>(task.inferred.size());
  Eigen::VectorXd truth(d);
  for (int j = 0; j < d; ++j) truth[j] = true_value(task, episode, j);
  const Eigen::MatrixXd centred = online.point.colwise() - online.point * online.weight;
  const double h = scott(static_cast<std::uint32_t>(online.weight.size()), d);
  return log_kernel_density(online.point, online.weight, truth,
                            h * h * (centred * online.weight.asDiagonal() * centred.transpose()));
}

Accuracy compare(const AccuracyTask& task, const tiller_config_t& config, const Episode& episode, std::uint64_t seed) {
  const int d = static_cast<int>(task.inferred.size());
  const std::uint32_t n = config.posterior.particles;
  const ExactLikelihood likelihood(task, episode);
  const ExactPosterior exact = exact_posterior(likelihood, n, seed);
  const double h = scott(n, d);
  const Eigen::MatrixXd kernel = h * h * exact.covariance;

  Accuracy a;
  a.exact = exact.log_density;
  a.exact_error = exact.error;
  for (int j = 0; j < d; ++j)
    a.exact_rank.push_back(rank_below(exact.point, exact.weight, j, true_value(task, episode, j)));

  // systematic draws would flatter it: independent ones
  Rng rng(seed, kDrawStream, 0);
  Eigen::VectorXd sum(exact.weight.size());
  double total = 0.0;
  for (int i = 0; i < sum.size(); ++i) sum[i] = total += exact.weight[i];
  Eigen::MatrixXd drawn(d, n);
  for (int i = 0; i < drawn.cols(); ++i)
    drawn.col(i) = exact.point.col(std::lower_bound(sum.begin(), sum.end() - 1, rng.uniform() * total) - sum.begin());
  a.drawn = log_kernel_density(drawn, Eigen::VectorXd::Constant(drawn.cols(), 1.0 / n), likelihood.truth(), kernel);

  const EngineResult online = run_engine(task, config, episode);
  a.online = log_kernel_density(online.point, online.weight, likelihood.truth(), kernel);
  a.rank = online.rank;
  a.seconds = online.seconds;
  a.bytes = online.bytes;
  a.faults = online.faults;
  return a;
}

}  // namespace tiller::bench
