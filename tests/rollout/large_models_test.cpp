// Models of many states and joints, one in each program: where a kernel has loops and passes in the place of text per
// state. Every function of its kernel against the same equations as a table in C, which is stepped in plain doubles and
// differentiated by differences.

#include <gtest/gtest.h>

#include <random>

#include "batch.hpp"
#include "large_models.hpp"
#include "rollout/path.hpp"
#include "rollout/residual.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kLanes = kLanePadding;
const std::uint32_t kStates = test::large_model()->state_count, kInputs = test::large_model()->input_count,
                    kParams = test::large_model()->param_count;

struct Case {
  std::uint32_t integrator, substeps;
  bool effects;
};
std::string name_of(const Case& z) {
  return "integrator " + std::to_string(z.integrator) + ", substeps " + std::to_string(z.substeps) +
         (z.effects ? ", effects" : "");
}
const Case kCases[] = {{0, 1, false}, {1, 1, false}, {2, 1, false}, {0, 2, false}, {1, 3, false},
                       {2, 2, false}, {0, 1, true},  {1, 2, true},  {2, 1, true}};

/// One of each kind of force that a joint may feel, at joints all over the machine.
tiller::Config config_of(const Case& z, const tiller_model_t* model, bool delay) {
  tiller::Config c = plain_config(model);
  c.integrator = z.integrator;
  c.substeps = z.substeps;
  c.body = {0.2, -9.81, 0.1, 0.0};
  if (!z.effects) return c;
  add_effect(c, tiller_effect_viscous_friction, 0);
  add_effect(c, tiller_effect_coulomb_friction, 4);
  add_effect(c, tiller_effect_constant_offset, 2);
  add_effect(c, tiller_effect_joint_inertia, 5);
  if (delay) add_effect(c, tiller_effect_input_delay, 3);
  return c;
}

struct Numbers {
  std::vector<double> state, params, control, history;
  explicit Numbers(std::uint32_t count) : history(TILLER_MAX_DELAY_STEPS * kInputs, 0.4) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (std::uint32_t i = 0; i < kStates * count; ++i) state.push_back(0.6 * unit(random));
    for (std::uint32_t i = 0; i < kInputs * count; ++i) control.push_back(2.5 + unit(random));
    for (std::uint32_t i = 0; i < TILLER_MAX_PARAMS * count; ++i) params.push_back(0.5 + 0.2 * unit(random));
    // what stands behind the model's are the effects': small forces, and a delay within the period
    for (std::uint32_t i = kParams * count; i < TILLER_MAX_PARAMS * count; ++i)
      params[i] = 0.012 + 0.004 * unit(random);
  }
};

double worst_of(const std::vector<double>& a, const std::vector<double>& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::fabs(a[i] - b[i]) / (1.0 + std::fabs(b[i])));
  return worst;
}

// A plain step: equal to rounding. Derivatives: the table takes central differences, which are good to 1e-7.
TEST(LargeModel, LinearisesAsItsTableInC) {
  for (const Case& z : kCases) {
    const Numbers numbers(kLanes);
    std::vector<double> next[2], a[2], b[2];
    const tiller_model_t* models[] = {test::large_model(), test::large_model_in_c()};
    for (int way = 0; way < 2; ++way) {
      StepSetup setup;
      ASSERT_EQ(make_step_setup(config_of(z, models[way], true), setup), tiller_status_ok);
      next[way].resize(kStates * kLanes);
      a[way].resize(kStates * kStates * kLanes);
      b[way].resize(kStates * kInputs * kLanes);
      LineariseJob job;
      job.setup = &setup;
      job.lanes = kLanes;
      job.state = {numbers.state.data(), kLanes};
      job.params = {numbers.params.data(), kLanes};
      job.effect_state = {numbers.state.data(), kLanes};
      job.control = {numbers.control.data(), kLanes};
      job.history = numbers.history.data();
      job.next_state = next[way].data();
      job.a = a[way].data();
      job.b = b[way].data();
      select_rollout(*models[way]).linearise(*models[way], job);
    }
    EXPECT_LT(worst_of(next[0], next[1]), 1e-12) << name_of(z);
    EXPECT_LT(worst_of(a[0], a[1]), 1e-6) << name_of(z);
    EXPECT_LT(worst_of(b[0], b[1]), 1e-6) << name_of(z);
  }
}

TEST(LargeModel, APathIsLinearisedAsItsTableInC) {
  constexpr std::uint32_t kHorizon = 9, kScenarios = 2;
  const std::uint32_t n = kStates + 1;
  for (const Case& z : kCases) {
    const Numbers numbers(kHorizon * kScenarios);
    std::vector<double> next[2], a[2], b[2];
    const tiller_model_t* models[] = {test::large_model(), test::large_model_in_c()};
    for (int way = 0; way < 2; ++way) {
      StepSetup setup;
      const tiller::Config config = config_of(z, models[way], false);
      ASSERT_EQ(make_step_setup(config, setup), tiller_status_ok);
      next[way].resize(kHorizon * kScenarios * kStates);
      a[way].assign(std::size_t{kHorizon} * kScenarios * n * n, 7.0);
      b[way].assign(std::size_t{kHorizon} * kScenarios * n * kInputs, 7.0);
      PathJob job;
      job.setup = &setup;
      job.horizon = kHorizon;
      job.scenarios = kScenarios;
      job.state = numbers.state.data();
      job.control = numbers.control.data();
      job.params = numbers.params.data() + kParams;  // effects' parameters are small ones or not: both are steps
      job.param_count = config.param_count;
      job.next = next[way].data();
      job.a = a[way].data();
      job.b = b[way].data();
      job.lq_states = n;
      select_path(select_rollout(*models[way])).linearise(*models[way], job);
    }
    EXPECT_LT(worst_of(next[0], next[1]), 1e-12) << name_of(z);
    EXPECT_LT(worst_of(a[0], a[1]), 1e-6) << name_of(z);
    EXPECT_LT(worst_of(b[0], b[1]), 1e-6) << name_of(z);
  }
}

// Single precision: a step's change of order one, to a few 1e-6 of it.
TEST(LargeModel, ResidualsAreThoseOfItsTableInC) {
  constexpr std::uint32_t kSteps = 70;
  for (const Case& z : kCases) {
    const Numbers numbers(kSteps);
    std::vector<MeasuredStep> steps(kSteps);
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      for (std::uint32_t i = 0; i < kStates; ++i) {
        steps[k].state[i] = numbers.state[k * kStates + i];
        steps[k].change[i] = 0.01 * numbers.state[(k * 5 + i) % numbers.state.size()];
      }
      for (std::uint32_t i = 0; i < kInputs; ++i) steps[k].input[i] = numbers.control[k * kInputs + i];
      steps[k].history = numbers.history.data();
    }
    std::vector<float> params;
    const Numbers lanes(kLanes);
    for (double p : lanes.params) params.push_back(static_cast<float>(p));
    std::vector<double> sums[2];
    const tiller_model_t* models[] = {test::large_model(), test::large_model_in_c()};
    for (int way = 0; way < 2; ++way) {
      StepSetup setup;
      ASSERT_EQ(make_step_setup(config_of(z, models[way], true), setup), tiller_status_ok);
      std::vector<float> residual(std::size_t{kSteps} * kStates * kLanes);
      ResidualJob job;
      job.setup = &setup;
      job.lanes = kLanes;
      job.count = kSteps;
      job.steps = steps.data();
      job.params = {params.data(), kLanes};
      job.residual = residual.data();
      select_rollout(*models[way]).residual(*models[way], job);
      sums[way].assign(residual.begin(), residual.end());
    }
    EXPECT_LT(worst_of(sums[0], sums[1]), 1e-5) << name_of(z);
  }
}

TEST(LargeModel, RollsAsItsTableInC) {
  for (const Case& z : kCases) {
    Batch<double> in_c(config_of(z, test::large_model_in_c(), true), kLanes, 12);
    Batch<double> lanes(config_of(z, test::large_model(), true), kLanes, 12);
    Batch<float> single(config_of(z, test::large_model(), true), kLanes, 12);
    select_rollout(*test::large_model_in_c()).rollout_f64(*test::large_model_in_c(), in_c.job);
    select_rollout(*test::large_model()).rollout_f64(*test::large_model(), lanes.job);
    select_rollout(*test::large_model()).rollout_f32(*test::large_model(), single.job);
    EXPECT_LT(worst_of(lanes.final_state, in_c.final_state), 1e-9) << name_of(z);
    EXPECT_LT(worst_of(lanes.cost, in_c.cost), 1e-9) << name_of(z);
    EXPECT_LT(worst_of({single.final_state.begin(), single.final_state.end()}, in_c.final_state), 2e-3) << name_of(z);
  }
}

}  // namespace
}  // namespace tiller
