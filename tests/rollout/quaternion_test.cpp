// A quaternion among the states: what the stepper, its derivatives and the costs make of it, in a template's kernels
// and in a model that is written in C.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "rollout/attitude.hpp"
#include "rollout/cost.hpp"
#include "rollout/cost_to_go.hpp"
#include "rollout/path.hpp"
#include "rollout/rollout.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kX = 13, kU = 4, kP = 7, kLanes = kLanePadding;
constexpr int kAttitude = 3;
using State = std::array<double, kX>;
const double kParams[kP] = {0.8, 0.17, 0.005, 0.006, 0.009, 0.016, 0.2};
const double kInput[kU] = {2.1, 1.9, 2.3, 1.6};

const tiller_model_t& quadrotor() { return *tiller_find_model("quadrotor"); }
/// The same equations as a C programmer hands them over.
const tiller_model_t& in_c() {
  static tiller_model_t model = [] {
    tiller_model_t m = quadrotor();
    m.kernels = nullptr;
    m.jacobian = nullptr;
    return m;
  }();
  return model;
}

StepSetup setup_of(tiller_integrator_t integrator, std::uint32_t substeps) {
  StepSetup s;
  s.period_s = 0.02;
  s.substeps = substeps;
  s.integrator = integrator;
  s.body = {0.0, -9.81, 0.0, 0.0};
  return s;
}

State random_state(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  State x;
  for (double& v : x) v = normal(random);
  write_quaternion(normalised(read_quaternion(&x[kAttitude])), &x[kAttitude]);
  return x;
}

struct Step {
  double next[kX * kLanes], a[kX * kX * kLanes], b[kX * kU * kLanes];
  double history[kU * (TILLER_MAX_DELAY_STEPS + 1)] = {}, effect[TILLER_MAX_EFFECT_STATES] = {};
  Step(const tiller_model_t& model, const StepSetup& setup, const State& x) {
    LineariseJob job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.state = {x.data(), 0};
    job.params = {kParams, 0};
    job.effect_state = {effect, 0};
    job.control = {kInput, 0};
    job.history = history;
    job.next_state = next;
    job.a = a;
    job.b = b;
    select_rollout(model).linearise(model, job);
  }
  double state(std::uint32_t i) const { return next[i * kLanes]; }
  double slope(std::uint32_t r, std::uint32_t c) const { return a[(r * kX + c) * kLanes]; }
};

const tiller_integrator_t kIntegrators[] = {tiller_integrator_semi_implicit_euler, tiller_integrator_midpoint,
                                            tiller_integrator_rk4};

TEST(QuaternionStep, EndsAtUnitLengthWithDerivativesInTheTangentPlane) {
  for (const tiller_model_t* model : {&quadrotor(), &in_c()})
    for (const tiller_integrator_t integrator : kIntegrators)
      for (const std::uint32_t substeps : {1u, 3u}) {
        const StepSetup setup = setup_of(integrator, substeps);
        const State x = random_state(substeps);
        const Step step(*model, setup, x);
        double square = 0;
        for (int i = kAttitude; i < kAttitude + 4; ++i) square += step.state(i) * step.state(i);
        EXPECT_NEAR(square, 1, 1e-15 * 8);
        // differences of the C model are good to 1e-9
        const double most = model == &quadrotor() ? 1e-13 : 1e-8;
        for (std::uint32_t c = 0; c < kX; ++c) {
          double along = 0;
          for (int i = kAttitude; i < kAttitude + 4; ++i) along += step.state(i) * step.slope(i, c);
          EXPECT_NEAR(along, 0, most) << "column " << c;
        }
      }
}

TEST(QuaternionStep, LengthOfTheStartDoesNotMatterToTheAttitudeAlone) {
  // without thrust nothing but the attitude's own rate sees the attitude, and that is linear in it
  const StepSetup setup = setup_of(tiller_integrator_rk4, 2);
  State x = random_state(9), longer = x;
  for (int i = kAttitude; i < kAttitude + 4; ++i) longer[i] *= 1.7;
  const Step a(quadrotor(), setup, x), b(quadrotor(), setup, longer);
  for (int i = kAttitude; i < kAttitude + 4; ++i) EXPECT_NEAR(a.state(i), b.state(i), 1e-14);
}

TEST(QuaternionStep, TheTemplateAndTheModelInCAgree) {
  for (const tiller_integrator_t integrator : kIntegrators) {
    const StepSetup setup = setup_of(integrator, 2);
    const State x = random_state(4);
    const Step a(quadrotor(), setup, x), b(in_c(), setup, x);
    for (std::uint32_t r = 0; r < kX; ++r) {
      EXPECT_NEAR(a.state(r), b.state(r), 1e-13 * std::fmax(1, std::fabs(a.state(r))));
      for (std::uint32_t c = 0; c < kX; ++c) EXPECT_NEAR(a.slope(r, c), b.slope(r, c), 1e-7) << r << ", " << c;
    }
  }
}

// ---- costs ---------------------------------------------------------------------------------------------

tiller_cost_config_t cost_of(const State& target) {
  tiller_cost_config_t cost{};
  for (std::uint32_t i = 0; i < kX; ++i) {
    cost.target[i] = target[i];
    cost.state_weight[i] = i == kAttitude ? 0.0 : 1.0 + 0.3 * i;
    cost.terminal_weight[i] = i == kAttitude ? 0.0 : 2.0 + 0.1 * i;
  }
  return cost;
}

/// Value and derivatives of a stage at x.
struct Expanded {
  double value[kLanes * 2], lx[kX * kLanes * 2], lxx[kX * kX * kLanes * 2], lu[kU * kLanes * 2], lb[kU * kLanes * 2],
      luu[kU * kU * kLanes * 2], lux[kU * kX * kLanes * 2];
  Expanded(const tiller_model_t& model, const CostTerms<double>& cost, const State& x) {
    constexpr std::uint32_t lanes = 2 * kLanes;
    const StepSetup setup = setup_of(tiller_integrator_rk4, 1);
    std::vector<double> state(kX * lanes), control(kU * lanes, 0.0);
    for (std::uint32_t i = 0; i < kX; ++i) std::fill_n(&state[i * lanes], lanes, x[i]);
    QuadratiseJob job;
    job.setup = &setup;
    job.cost = &cost;
    job.lanes = lanes;
    job.stages = kLanes;
    job.terminal = true;
    job.state = {state.data(), lanes};
    job.control = {control.data(), lanes};
    job.before = {control.data(), lanes};
    job.params = {kParams, 0};
    job.value = value;
    job.lx = lx;
    job.lu = lu;
    job.lb = lb;
    job.lxx = lxx;
    job.luu = luu;
    job.lux = lux;
    select_rollout(model).quadratise(model, job);
  }
};

double plain_cost(const tiller_cost_config_t& cost, const State& x) {
  double d[kX], sum = 0, exponent = 0;
  state_differences(quadrotor(), x.data(), cost.target, d);
  for (std::uint32_t i = 0; i < kX; ++i) {
    sum += cost.state_weight[i] * d[i] * d[i];
    if (cost.saturating_width[i] > 0) exponent += std::pow(d[i] / cost.saturating_width[i], 2);
    if (cost.bound_weight[i] > 0) sum += cost.bound_weight[i] * std::pow(std::fmax(0, x[i] - cost.state_high[i]), 2);
  }
  return sum + cost.saturating_weight * (1 - std::exp(-exponent / 2));
}

TEST(QuaternionCost, GradientIsThatOfTheValueAlongTheSphere) {
  const State target = random_state(1), x = random_state(2);
  for (const tiller_model_t* model : {&quadrotor(), &in_c()})
    for (const bool every : {false, true}) {
      tiller_cost_config_t cost = cost_of(target);
      State low, high, bound{};
      low.fill(-INFINITY);
      high.fill(INFINITY);
      cost.state_low = low.data();
      cost.state_high = high.data();
      cost.bound_weight = bound.data();
      if (every) {
        cost.saturating_weight = 3;
        for (std::uint32_t i = 0; i < kX; ++i) cost.saturating_width[i] = i == kAttitude ? 0 : 2.0 + 0.1 * i;
        bound[kAttitude + 1] = 5;
        high[kAttitude + 1] = x[kAttitude + 1] - 0.2;
      }
      const CostTerms<double> terms = make_cost_terms<double>(cost, kX);
      const Expanded e(*model, terms, x);
      EXPECT_NEAR(e.value[0], plain_cost(cost, x), 1e-12 * e.value[0]);
      for (int k = 1; k < 4; ++k) {  // along the three tangents
        constexpr double h = 1e-5;
        double along[kX] = {}, sum = 0;
        State more, less;
        along[kAttitude + k] = h;
        add_differences(quadrotor(), x.data(), along, more.data());
        along[kAttitude + k] = -h;
        add_differences(quadrotor(), x.data(), along, less.data());
        for (int i = kAttitude; i < kAttitude + 4; ++i) sum += e.lx[i * 2 * kLanes] * (more[i] - less[i]) / (2 * h);
        EXPECT_NEAR(sum, (plain_cost(cost, more) - plain_cost(cost, less)) / (2 * h), 1e-7 * e.value[0]);
      }
      // lengths alone cost nothing, but where a bound says so
      double radial = 0;
      for (int i = kAttitude; i < kAttitude + 4; ++i) radial += e.lx[i * 2 * kLanes] * x[i];
      if (!every) {
        EXPECT_NEAR(radial, 0, 1e-12 * e.value[0]);
      }
      for (std::uint32_t r = 0; r < kX; ++r)
        for (std::uint32_t c = 0; c < kX; ++c)
          EXPECT_NEAR(e.lxx[(r * kX + c) * 2 * kLanes], e.lxx[(c * kX + r) * 2 * kLanes], 1e-11);
    }
}

TEST(QuaternionCost, HessianAtTheTargetIsTheWeightsInTheBodysAxes) {
  const State target = random_state(3);
  const tiller_cost_config_t cost = cost_of(target);
  const Expanded e(quadrotor(), make_cost_terms<double>(cost, kX), target);
  const Quaternion<double> q = read_quaternion(&target[kAttitude]);
  for (int k = 1; k < 4; ++k) {
    const Quaternion<double> axis = {0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0, k == 3 ? 1.0 : 0.0};
    double tangent[4], sum = 0;
    write_quaternion(q * axis, tangent);
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c)
        sum += tangent[r] * e.lxx[((kAttitude + r) * kX + kAttitude + c) * 2 * kLanes] * tangent[c];
    EXPECT_NEAR(sum, 2 * cost.state_weight[kAttitude + k], 1e-12);
  }
}

TEST(QuaternionCost, RolloutsOfBothSignsCostTheSame) {
  const State target = random_state(5);
  State x = random_state(6), negative = x;
  for (int i = kAttitude; i < kAttitude + 4; ++i) negative[i] = -x[i];
  const CostTerms<double> terms = make_cost_terms<double>(cost_of(target), kX);
  const StepSetup setup = setup_of(tiller_integrator_midpoint, 1);
  double cost[2][kLanes], controls[kU * 10];
  for (int i = 0; i < 40; ++i) controls[i] = kInput[i % 4];
  for (int k = 0; k < 2; ++k) {
    RolloutJob<double> job;
    double effect[TILLER_MAX_EFFECT_STATES] = {}, history[kU * 18] = {};
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = 10;
    job.state = {k == 0 ? x.data() : negative.data(), 0};
    job.params = {kParams, 0};
    job.effect_state = {effect, 0};
    job.controls = {controls, 0};
    job.history = history;
    job.cost = &terms;
    job.cost_out = cost[k];
    select_rollout(quadrotor()).rollout_f64(quadrotor(), job);
  }
  EXPECT_GT(cost[0][0], 1.0);
  EXPECT_NEAR(cost[0][0], cost[1][0], 1e-12 * cost[0][0]);
}

// ---- differences ------------------------------------------------------------------------------------------

TEST(StateDifferences, AreUndoneByAdding) {
  const State a = random_state(7), b = random_state(8);
  double d[kX], back[kX];
  state_differences(quadrotor(), a.data(), b.data(), d);
  EXPECT_EQ(d[kAttitude], 0.0);
  add_differences(quadrotor(), b.data(), d, back);
  const double sign = dot(read_quaternion(&a[kAttitude]), read_quaternion(back + kAttitude)) < 0 ? -1 : 1;
  for (std::uint32_t i = 0; i < kX; ++i)
    EXPECT_NEAR(back[i], (i >= kAttitude && i < kAttitude + 4 ? sign : 1) * a[i], 1e-14);
}

}  // namespace
}  // namespace tiller
