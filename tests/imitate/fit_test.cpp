// Weights found again from motions that are optimal under them, limits met and not; the smoother; imitating networks.

#include <gtest/gtest.h>

#include <cmath>

#include "core/rng.hpp"
#include "tools/imitate/adversarial.hpp"
#include "tools/imitate/demonstration.hpp"
#include "tools/imitate/matching.hpp"
#include "tools/imitate/replan.hpp"

namespace tiller::tools::imitate {
namespace {

constexpr int kSteps = 60;

/// A pendulum that is held off its rest.
Scene pendulum(double limit_Nm) {
  Config config;
  EXPECT_EQ(tiller_config_default(&config, tiller_find_model("pendulum")), tiller_status_ok);
  config.period_s = 0.02;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    config.priors[i] = {tiller_prior_fixed, 0, i == 2 ? 0.05 : 0.5, 0.0, -INFINITY, INFINITY};
  config.safety.input_low[0] = -limit_Nm;
  config.safety.input_high[0] = limit_Nm;
  config.measurement_count = 1;
  config.measured_state[0] = 0;
  config.measurement_sd[0] = 0.002;
  config.process_sd[0] = 0;
  config.process_sd[1] = 0.01;
  CostEdit cost(config);
  cost.clear();
  cost.set({CostTerm::state, 0, "", 0}, 4);
  cost.set({CostTerm::state, 1, "", 0}, 0.2);
  cost.set({CostTerm::terminal, 0, "", 0}, 20);
  cost.set({CostTerm::terminal, 1, "", 0}, 1);
  cost.set({CostTerm::input, 0, "", 0}, 0.1);
  config = cost.get();
  config.cost.target[0] = 0.8;
  config.bound_weight[0] = 100;
  config.state_high[0] = 3;
  Scene scene;
  std::string error;
  EXPECT_TRUE(scene.make(config, error)) << error;
  return scene;
}

std::vector<CostTerm> learnt_terms() {
  return {{CostTerm::state, 0, "angle", 1},
          {CostTerm::state, 1, "rate", 1},
          {CostTerm::terminal, 0, "end angle", 1},
          {CostTerm::terminal, 1, "end rate", 1},
          {CostTerm::bound, 0, "bound", 7}};
}

std::vector<Motion> motions_of(const Scene& scene) {
  std::vector<Motion> motions;
  for (const double angle : {-0.5, 0.2, 1.5}) {
    const Vector start = (Vector(2) << angle, 2 * angle - 1).finished();
    motions.push_back(replan(scene, scene.config, start, Matrix::Zero(1, kSteps)));
  }
  return motions;
}

MaxentFit fit(const Scene& scene, const std::vector<Motion>& motions, double limit_share, double noise_Nm = 1e-4) {
  std::vector<Expansion> all;
  ExpandOptions how;
  how.limit_share = limit_share;
  for (Motion m : motions) {
    for (int k = 0; k < kSteps; ++k)  // a little noise where there is room, or nothing limits the scale
      if (std::fabs(m.input(0, k)) < 0.999 * scene.config.safety.input_high[0])
        m.input(0, k) += noise_Nm * std::sin(37.0 * k * k);
    m.state = scene.roll(m.state.col(0), m.input);
    all.push_back(expand(scene, m, scene.config, learnt_terms(), how));
  }
  MaxentFit result;
  std::string error;
  EXPECT_TRUE(fit_maxent(all, learnt_terms(), {}, result, error)) << error;
  return result;
}

TEST(Maxent, FindsTheWeightsAgain) {
  const Scene scene = pendulum(1e3);
  const MaxentFit result = fit(scene, motions_of(scene), 1e-3);
  EXPECT_NEAR(result.weights[0].value, 4, 0.04);
  EXPECT_NEAR(result.weights[1].value, 0.2, 0.01);
  EXPECT_NEAR(result.weights[2].value, 20, 1);
  EXPECT_TRUE(result.weights[0].identified);
  EXPECT_GT(result.log_likelihood, result.before);
}

TEST(Maxent, FindsTheTargetWithTheWeights) {
  const Scene scene = pendulum(1e3);  // its target is 0.8 rad
  Config believed = scene.config;
  believed.cost.target[0] = 0.3;
  CostTarget target;
  target.value = 0.3;
  target.of[0] = 1;  // angle
  target.of[1] = 3;  // end angle
  target.kept[0] = target.kept[1] = 1;
  std::vector<Expansion> all;
  for (Motion m : motions_of(scene)) {
    for (int k = 0; k < kSteps; ++k) m.input(0, k) += 1e-4 * std::sin(37.0 * k * k);
    m.state = scene.roll(m.state.col(0), m.input);
    all.push_back(expand(scene, m, believed, learnt_terms(), {}, {0}));
  }
  MaxentFit result;
  std::string error;
  ASSERT_TRUE(fit_maxent(all, learnt_terms(), {target}, {}, result, error)) << error;
  EXPECT_NEAR(result.targets[0].value, 0.8, 0.002);  // as the weights: a hundredth of the way
  EXPECT_NEAR(result.weights[0].value, 4, 0.04);
  EXPECT_TRUE(result.targets[0].identified);
}

TEST(Maxent, EndsSoonWhereThereIsHardlyNoise) {
  const Scene scene = pendulum(1e3);
  const std::vector<Motion> motions = motions_of(scene);
  for (const double noise_Nm : {1e-6, 1e-8, 0.0}) {
    const MaxentFit result = fit(scene, motions, 1e-3, noise_Nm);
    EXPECT_TRUE(result.converged) << noise_Nm;
    EXPECT_LT(result.iterations, 50) << noise_Nm;  // of 100; damped by the weights they crawled to the last
    EXPECT_NEAR(result.weights[0].value, 4, 0.04) << noise_Nm;
  }
}

TEST(Maxent, NamesWhatNeverVaries) {
  const Scene scene = pendulum(1e3);
  const MaxentFit result = fit(scene, motions_of(scene), 1e-3);
  EXPECT_FALSE(result.weights[4].varies);
  EXPECT_FALSE(result.weights[4].identified);
  EXPECT_EQ(result.weights[4].value, 7);  // as the file has it
}

TEST(Maxent, LimitedInputsAreNoGradients) {
  const Scene scene = pendulum(1.4);
  const std::vector<Motion> motions = motions_of(scene);
  const MaxentFit one_sided = fit(scene, motions, 1e-3), as_free = fit(scene, motions, -1);
  EXPECT_GT(one_sided.limited, 5);
  EXPECT_EQ(as_free.limited, 0);
  EXPECT_NEAR(one_sided.weights[0].value, 4, 0.4);
  EXPECT_GT(std::fabs(as_free.weights[0].value - 4), 5 * std::fabs(one_sided.weights[0].value - 4));
}

TEST(Replan, EndsWhereNoInputIsBetter) {
  const Scene scene = pendulum(1.4);
  const Motion best = motions_of(scene)[0];
  const double least = scene.cost(scene.config, best.state, best.input);
  for (int k = 0; k < kSteps; k += 7)
    for (const double by : {1e-3, -1e-3}) {
      Matrix u = best.input;
      u(0, k) = std::clamp(u(0, k) + by, -1.4, 1.4);
      EXPECT_GE(scene.cost(scene.config, scene.roll(best.state.col(0), u), u), least - 1e-9) << k;
    }
}

TEST(Matching, SpendsNoMoreThanTheDemonstrations) {
  const Scene scene = pendulum(1e3);
  const std::vector<CostTerm> learnt = {{CostTerm::state, 0, "angle", 1}, {CostTerm::terminal, 0, "end", 1}};
  MatchingOptions options;
  options.rounds = 60;
  const MatchingFit result = fit_matching(scene, motions_of(scene), learnt, options);
  EXPECT_LT(result.bound, 1e-6);   // the demonstrations are optimal: nothing beats them under any weights
  EXPECT_LT(result.excess, 0.15);  // sqrt(2 log 3 / 60) = 0.19 is the game's guarantee
}

TEST(Smoother, KnowsMoreThanTheSensor) {
  const Scene scene = pendulum(1e3);
  const Motion truth = motions_of(scene)[0];
  Grid grid;
  grid.period_s = 0.02;
  grid.state.assign(2, std::vector<double>(kSteps + 1, NAN));
  grid.input.assign(1, std::vector<double>(kSteps + 1, 0.0));
  Rng rng(3, kRngPrior, 0);
  for (int k = 0; k <= kSteps; ++k)
    grid.state[0][static_cast<std::size_t>(k)] = truth.state(0, k) + 0.002 * rng.normal();
  for (int k = 0; k < kSteps; ++k) grid.input[0][static_cast<std::size_t>(k)] = truth.input(0, k);
  Smoothed smoothed;
  std::string error;
  ASSERT_TRUE(smooth_motion(scene, grid, smoothed, error)) << error;
  const Matrix off = smoothed.motion.state - truth.state;
  EXPECT_LT(off.row(0).norm() / std::sqrt(kSteps), 0.001);  // half the sensor's
  EXPECT_LT(off.row(1).norm() / std::sqrt(kSteps), 0.01);   // differences of readings would be 0.14
  EXPECT_NEAR(smoothed.misfit, 1, 0.5);
}

TEST(Observer, SlopesAreThoseOfDifferences) {
  const Scene scene = pendulum(1e3);
  const Observer observer(scene);
  ASSERT_EQ(observer.rows, 3);
  const Vector x = (Vector(2) << 0.7, -1.1).finished(), by = (Vector(3) << 0.3, -2, 0.5).finished();
  const Matrix slope = observer.back(x, by);
  for (int i = 0; i < 2; ++i) {
    Vector up = x, down = x;
    up(i) += 1e-6;
    down(i) -= 1e-6;
    EXPECT_NEAR(slope(i, 0), by.dot(Vector((observer.of(up) - observer.of(down)) / 2e-6)), 1e-8);
  }
}

TEST(Adversarial, SameSeedSameBits) {
  const Scene scene = pendulum(5);
  const std::vector<Motion> motions = motions_of(scene);
  AdversarialOptions options;
  options.iterations = 5;
  options.steps = 20;
  for (const bool wasserstein : {false, true}) {
    options.wasserstein = wasserstein;
    const AdversarialFit a = fit_adversarial(scene, motions, options), b = fit_adversarial(scene, motions, options);
    EXPECT_TRUE(a.policy.mlp.weights == b.policy.mlp.weights);
    options.seed = 2;
    EXPECT_FALSE(a.policy.mlp.weights == fit_adversarial(scene, motions, options).policy.mlp.weights);
    options.seed = 1;
  }
}

}  // namespace
}  // namespace tiller::tools::imitate
