// Fits of windows: derivatives, elimination of start states, whitening and intervals, each against a way of its own.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <memory>

#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/fit/shooting.hpp"

namespace tiller::tools::gap {
namespace {

// A pendulum whose mass is not known exactly, with a viscous force that the hypothesis has as an effect.
struct Problem {
  Synthetic world;
  tiller::Config config;
  WindowData data;
  std::vector<Window> windows;
  Scales scales;
  Hypothesis hypothesis;
  std::unique_ptr<Shooting> shooting;
  std::vector<std::size_t> all;
  Fit fit;

  Problem(const Synthetic& s, const std::vector<EffectAt>& effects, int logs, std::uint64_t seed) : world(s) {
    config = synthetic_config(world);
    config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.4, 0.6};
    config.process_sd[1] = world.process_sd;
    config.substeps = 4;
    data = make_window_data(simulate_logs(world, logs, seed), config);
    windows = make_windows(data, config, 1.0, 0, data.grids.size());
    scales = measure_scales(data, windows, config, world.params.data());
    EXPECT_TRUE(make_hypothesis(config, effects, &scales, hypothesis));
    shooting = std::make_unique<Shooting>(data, windows, config, scales);
    for (std::size_t i = 0; i < windows.size(); ++i) all.push_back(i);
    fit = shooting->begin(hypothesis, {}, nullptr);
    for (std::size_t i = config.param_count; i < fit.params.size(); ++i) fit.params[i] = 0.02;
    shooting->prepare_whitening(hypothesis, fit);
  }
  void solve() {
    FitSettings settings;
    settings.information = true;
    settings.tolerance = 1e-9;
    settings.iterations = 30;
    shooting->fit(hypothesis, all, settings, fit);
  }
  // Half the cost with parameter `index` moved, start states at their best.
  double half_cost(std::uint32_t index, double change) {
    Fit moved = fit;
    moved.params[index] += change;
    FitSettings states;
    states.fix_params = true;
    states.tolerance = 1e-10;
    shooting->fit(hypothesis, all, states, moved);
    return 0.5 * moved.total();
  }
};

Synthetic viscous_world(double process_sd = 0) {
  Synthetic s;
  s.amplitude = 0.8;
  s.process_sd = process_sd;
  s.force = [](double, double v, double, double) { return -0.03 * v; };
  return s;
}

TEST(Shooting, SlopesAreThoseOfCentralDifferences) {
  Problem p(viscous_world(), {{tiller_effect_viscous_friction, 0}}, 2, 100001);
  FitSettings states;  // away from the optimum, start states at theirs
  states.fix_params = true;
  states.tolerance = 1e-10;
  p.shooting->fit(p.hypothesis, p.all, states, p.fit);
  FitSettings look;
  look.iterations = 0;
  look.information = true;
  p.shooting->fit(p.hypothesis, p.all, look, p.fit);
  const std::size_t nf = p.hypothesis.free.size();
  for (std::size_t f = 0; f < nf; ++f) {
    double slope = 0;
    for (std::size_t w = 0; w < p.all.size(); ++w) slope -= p.fit.slopes[w * nf + f];
    const FreeParam& free = p.hypothesis.free[f];
    const double h = 1e-4 * free.scale;
    const double central = (p.half_cost(free.index, h) - p.half_cost(free.index, -h)) / (2 * h);
    EXPECT_NEAR(slope / central, 1, 2e-3) << f;
  }
}

// Threads that share the windows change no bit of a fit with friction, whose windows are rescued now and then.
TEST(Shooting, SameBitsForAnyNumberOfThreads) {
  Synthetic world = viscous_world();
  world.force = [](double, double v, double, double) { return -0.05 * std::tanh(v / 1e-3); };
  const std::vector<EffectAt> effects = {{tiller_effect_coulomb_friction, 0}};
  Problem alone(world, effects, 2, 100003);
  alone.solve();
  for (const unsigned count : {2u, 3u, 8u}) {
    Problem shared(world, effects, 2, 100003);
    ThreadPool threads(count);
    shared.shooting = std::make_unique<Shooting>(shared.data, shared.windows, shared.config, shared.scales, &threads);
    shared.shooting->prepare_whitening(shared.hypothesis, shared.fit);
    shared.solve();
    EXPECT_EQ(shared.fit.params, alone.fit.params) << count;
    EXPECT_EQ(shared.fit.x0, alone.fit.x0) << count;
    EXPECT_EQ(shared.fit.cost, alone.fit.cost) << count;
    EXPECT_EQ(shared.fit.information, alone.fit.information) << count;
    EXPECT_EQ(shared.fit.total(), alone.fit.total()) << count;
  }
}

// A stop leaves a record that is whole: costs of the start states and parameters that it holds.
TEST(Shooting, StopsWithACostOfWhatItHas) {
  Problem p(viscous_world(), {{tiller_effect_viscous_friction, 0}}, 1, 100004);
  volatile int stop = 1;
  p.shooting->stop_at(&stop);
  const std::vector<double> before = p.fit.params;
  p.solve();
  EXPECT_EQ(p.fit.params, before);
  EXPECT_TRUE(p.fit.finite);
  EXPECT_GT(p.fit.data_cost, 0);
}

TEST(Shooting, EliminationIsADenseSolve) {
  Problem p(viscous_world(), {{tiller_effect_viscous_friction, 0}}, 1, 100002);
  p.windows.resize(3);
  p.all = {0, 1, 2};
  p.shooting = std::make_unique<Shooting>(p.data, p.windows, p.config, p.scales);
  p.fit = p.shooting->begin(p.hypothesis, p.fit.params, nullptr);
  p.shooting->prepare_whitening(p.hypothesis, p.fit);
  p.solve();
  // every start state and parameter as one vector, by central differences of the residuals themselves
  const int nx = 2, nf = static_cast<int>(p.hypothesis.free.size()), n = 3 * nx + nf;
  const auto residuals = [&](int which, double change) {
    Fit moved = p.fit;
    if (which < 3 * nx)
      moved.x0[static_cast<std::size_t>(which)] += change;
    else
      moved.params[p.hypothesis.free[static_cast<std::size_t>(which - 3 * nx)].index] += change;
    std::vector<double> all, one;
    for (const std::size_t w : p.all) {
      p.shooting->residuals(p.hypothesis, moved, w, one);
      all.insert(all.end(), one.begin(), one.end());
    }
    return Eigen::VectorXd(Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size())));
  };
  Eigen::MatrixXd jacobian(residuals(0, 0).size(), n);
  for (int c = 0; c < n; ++c) jacobian.col(c) = (residuals(c, 1e-5) - residuals(c, -1e-5)) / 2e-5;
  const Eigen::MatrixXd dense = (jacobian.transpose() * jacobian).inverse().bottomRightCorner(nf, nf);
  const Eigen::MatrixXd ours = Eigen::Map<Eigen::MatrixXd>(p.fit.information.data(), nf, nf).inverse();
  EXPECT_LT((dense - ours).norm() / dense.norm(), 1e-3);
}

TEST(Shooting, WhiteningIsTheInverseOfTheWindowsCovariance) {
  Problem p(viscous_world(0.05), {{tiller_effect_viscous_friction, 0}}, 1, 100003);
  // kicks of the rate at every period, through the kernel: columns of the covariance's root
  const std::size_t m = p.windows[0].points;
  const double* base = p.shooting->predict(p.hypothesis, p.fit, 0);
  std::vector<double> path(m);
  for (std::size_t k = 0; k < m; ++k) path[k] = base[k * kLanePadding];
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(m), static_cast<Eigen::Index>(m)) *
                               p.world.noise_sd * p.world.noise_sd;
  WindowRollout rollout(p.data, p.config, m);
  rollout.use(p.hypothesis);
  const auto roll = [&](const Window& w, const double* x) {
    for (int i = 0; i < 2; ++i) std::fill_n(rollout.states() + i * kLanePadding, kLanePadding, x[i]);
    for (std::size_t i = 0; i < p.fit.params.size(); ++i)
      std::fill_n(rollout.params() + i * kLanePadding, kLanePadding, p.fit.params[i]);
    rollout.run(w);
    return rollout.trajectory();
  };
  std::vector<double> states(2 * m);
  const double* whole = roll(p.windows[0], p.fit.x0.data());
  for (std::size_t k = 0; k < m; ++k)
    for (std::size_t i = 0; i < 2; ++i) states[2 * k + i] = whole[(k * 2 + i) * kLanePadding];
  for (std::size_t k = 1; k + 1 < m; ++k) {
    Window rest = p.windows[0];
    rest.start += k;
    rest.points -= static_cast<std::uint32_t>(k);
    const double kick = 1e-5, kicked[2] = {states[2 * k], states[2 * k + 1] + kick};
    const double* moved = roll(rest, kicked);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(m));
    for (std::size_t r = k; r < m; ++r)
      g(static_cast<Eigen::Index>(r)) = (moved[(r - k) * 2 * kLanePadding] - states[2 * r]) / kick;
    covariance += g * g.transpose() * p.world.process_sd * p.world.process_sd * p.config.period_s;
  }
  std::vector<double> white;
  p.shooting->residuals(p.hypothesis, p.fit, 0, white);
  double ours = 0;
  for (const double r : white) ours += r * r;
  Eigen::VectorXd residual(static_cast<Eigen::Index>(m));
  for (std::size_t k = 0; k < m; ++k)
    residual(static_cast<Eigen::Index>(k)) = p.data.measured[p.windows[0].grid][p.windows[0].start + k] - path[k];
  const double dense = residual.dot(covariance.llt().solve(residual));
  EXPECT_NEAR(ours / dense, 1, 0.02);
}

// 100 fits of 95 % intervals: 89 or more hold the truth with a probability of 99.6 % if the intervals are right.
TEST(Shooting, IntervalsCover) {
  int covered[2] = {};
  constexpr int kSeeds = 100;
  for (int seed = 0; seed < kSeeds; ++seed) {
    Problem p(viscous_world(0.02), {{tiller_effect_viscous_friction, 0}}, 2, 100100 + static_cast<std::uint64_t>(seed));
    p.solve();
    p.shooting->prepare_whitening(p.hypothesis, p.fit);
    p.solve();
    const Eigen::Matrix2d covariance = Eigen::Map<Eigen::Matrix2d>(p.fit.information.data()).inverse();
    const double truth[2] = {0.5, 0.03};
    for (int f = 0; f < 2; ++f) {
      const double error = p.fit.params[p.hypothesis.free[static_cast<std::size_t>(f)].index] - truth[f];
      covered[f] += std::fabs(error) < 1.96 * std::sqrt(covariance(f, f));
    }
  }
  std::printf("95 %% intervals that cover: mass %d, damping %d of %d\n", covered[0], covered[1], kSeeds);
  EXPECT_GE(covered[0], 89);
  EXPECT_GE(covered[1], 89);
}

}  // namespace
}  // namespace tiller::tools::gap
