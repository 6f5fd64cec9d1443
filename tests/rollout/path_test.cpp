// Kernels of gradient planners: Jacobians along a path against differences of the step, steps and costs against the
// rollout kernel, templates against the same model in C.

#include "rollout/path.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "batch.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kHorizon = 13, kScenarios = 3;  // 39 points: the last register is not full

struct Case {
  tiller_integrator_t integrator;
  std::uint32_t substeps;
  bool effects;
};
const Case kCases[] = {{tiller_integrator_semi_implicit_euler, 1, false},
                       {tiller_integrator_semi_implicit_euler, 3, false},
                       {tiller_integrator_midpoint, 1, false},
                       {tiller_integrator_midpoint, 2, false},
                       {tiller_integrator_rk4, 1, false},
                       {tiller_integrator_rk4, 2, false},
                       {tiller_integrator_rk4, 1, true},
                       {tiller_integrator_semi_implicit_euler, 2, true}};

/// A path of random states with lag at input 0 and viscous friction at joint 0, or a gain where a model has no joint,
/// where there are effects.
struct Path {
  tiller::StepSetup setup;
  std::uint32_t nx, nu, np, nz, n;
  std::vector<double> state, control, params, next, a, b;
  tiller::PathJob job;

  Path(const tiller_model_t& model, const Case& z)
      : nx(model.state_count), nu(model.input_count), np(model.param_count) {
    setup.integrator = z.integrator;
    setup.substeps = z.substeps;
    if (z.effects) {
      setup.effect_count = 2;
      setup.effects[0] = {tiller_effect_actuator_lag, 0, static_cast<std::uint16_t>(np), 0};
      const auto second = model.joint_count > 0 ? tiller_effect_viscous_friction : tiller_effect_actuator_gain;
      setup.effects[1] = {static_cast<std::uint16_t>(second), 0, static_cast<std::uint16_t>(np + 1), 0};
      setup.effect_state_count = 1;
    }
    nz = nx + setup.effect_state_count;
    n = nz + 1;  // a linear-quadratic problem with a state of its own
    const std::uint32_t rows = np + (z.effects ? 2 : 0);
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (std::uint32_t i = 0; i < (kHorizon + 1) * kScenarios * nz; ++i)
      state.push_back(normal(random) + (i % nz < nx ? tiller::state_centre(model, i % nz) : 0.0));
    for (std::uint32_t i = 0; i < kHorizon * nu; ++i) control.push_back(3.0 * normal(random));
    for (std::uint32_t j = 0; j < kScenarios; ++j)
      for (std::uint32_t i = 0; i < rows; ++i) params.push_back(i < np ? 0.5 + 0.1 * (i + j) : 0.03 + 0.01 * j);
    next.assign(std::size_t{kHorizon} * kScenarios * nz, 0.0);
    a.assign(std::size_t{kHorizon} * kScenarios * n * n, 7.0);
    b.assign(std::size_t{kHorizon} * kScenarios * n * nu, 7.0);
    job.setup = &setup;
    job.horizon = kHorizon;
    job.scenarios = kScenarios;
    job.params = params.data();
    job.param_count = rows;
    job.lq_states = n;
  }
  void run(const tiller::PathKernel& kernel, const tiller_model_t& model, bool slopes) {
    job.state = state.data();
    job.control = control.data();
    job.next = next.data();
    job.a = slopes ? a.data() : nullptr;
    job.b = slopes ? b.data() : nullptr;
    kernel.linearise(model, job);
  }
};

/// Largest difference of the Jacobians from central differences of the same kernel's step.
double slope_error(const tiller_model_t& model, const tiller::PathKernel& kernel, const Case& z) {
  Path path(model, z);
  path.run(kernel, model, true);
  const std::vector<double> a = path.a, b = path.b;
  double worst = 0.0;
  for (std::uint32_t c = 0; c < path.nz + path.nu; ++c) {
    std::vector<double> side[2];
    const double width = 1e-5;
    for (int s = 0; s < 2; ++s) {
      Path moved(model, z);
      const double by = s ? width : -width;
      for (std::size_t p = 0; c < path.nz && p < std::size_t{kHorizon} * kScenarios; ++p)
        moved.state[p * path.nz + c] += by;
      for (std::size_t k = 0; c >= path.nz && k < kHorizon; ++k) moved.control[k * path.nu + c - path.nz] += by;
      moved.run(kernel, model, false);
      side[s] = moved.next;
    }
    for (std::size_t p = 0; p < std::size_t{kHorizon} * kScenarios; ++p)
      for (std::uint32_t r = 0; r < path.nz; ++r) {
        const double slope = (side[1][p * path.nz + r] - side[0][p * path.nz + r]) / (2.0 * width);
        const double found =
            c < path.nz ? a[(p * path.n + r) * path.n + c] : b[(p * path.n + r) * path.nu + c - path.nz];
        worst = std::max(worst, std::fabs(found - slope) / (1.0 + std::fabs(slope)));
      }
  }
  for (std::size_t p = 0; p < std::size_t{kHorizon} * kScenarios; ++p)  // nothing else is touched
    for (std::uint32_t i = 0; i < path.n; ++i) {
      EXPECT_EQ(a[(p * path.n + path.nz) * path.n + i], 7.0);
      EXPECT_EQ(a[(p * path.n + i) * path.n + path.nz], 7.0);
    }
  return worst;
}

TEST(Path, jacobians_are_those_of_the_step) {
  for (std::uint32_t index = 0; const tiller_model_t* model = tiller_builtin_model(index); ++index) {
    double worst = 0.0, worst_c = 0.0;
    tiller_model_t in_c = *model;
    in_c.kernels = nullptr;
    for (const Case& z : kCases) {
      worst = std::max(worst, slope_error(*model, tiller::select_path(tiller::select_rollout(*model)), z));
      worst_c = std::max(worst_c, slope_error(in_c, tiller::select_path(tiller::select_rollout(in_c)), z));
    }
    std::printf("%s: largest relative error %.1e, as a model in C %.1e\n", model->name, worst, worst_c);
    EXPECT_LT(worst, 1e-7);    // differences: 1e-16 / 1e-5 of the state, and curvature times 1e-10
    EXPECT_LT(worst_c, 1e-6);  // differenced twice, at two widths
  }
}

/// All candidates of a rollout with feedback, along a path.
struct Feedback {
  Path path;
  std::vector<double> step, gain, cost_out, state_out, control_out;
  tiller::CostTerms<double> cost{};
  tiller::FeedbackJob job;
  double alpha[tiller::kCandidates], beta[tiller::kCandidates], low[4], high[4], change[4], before[4];

  Feedback(const tiller_model_t& model, const Case& z) : path(model, z) {
    tiller_cost_config_t terms{};
    for (int i = 0; i < TILLER_MAX_STATES; ++i) terms.state_weight[i] = 1.0 + i, terms.terminal_weight[i] = 10.0;
    for (int i = 0; i < TILLER_MAX_INPUTS; ++i) terms.input_weight[i] = 0.1, terms.input_rate_weight[i] = 0.02;
    cost = tiller::make_cost_terms<double>(terms, model.state_count);
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (std::uint32_t i = 0; i < kHorizon * path.nu; ++i) step.push_back(normal(random));
    for (std::uint32_t i = 0; i < kHorizon * path.nu * kScenarios * path.n; ++i) gain.push_back(0.1 * normal(random));
    cost_out.resize(kScenarios * tiller::kCandidates);
    state_out.resize(std::size_t{kHorizon + 1} * kScenarios * path.nz * tiller::kCandidates);
    control_out.resize(std::size_t{kHorizon} * path.nu * tiller::kCandidates);
    for (std::uint32_t i = 0; i < tiller::kCandidates; ++i) {
      alpha[i] = 1.0 / (1.0 + i);
      beta[i] = i % 2 ? 1.0 : 0.5;
    }
    for (int i = 0; i < 4; ++i) low[i] = -2.0, high[i] = 2.5, change[i] = 1.5, before[i] = 0.5;
    job.setup = &path.setup;
    job.horizon = kHorizon;
    job.scenarios = kScenarios;
    job.start = path.state.data() + path.nz;  // off the path
    job.params = path.params.data();
    job.param_count = path.job.param_count;
    job.state = path.state.data();
    job.control = path.control.data();
    job.step = step.data();
    job.gain = gain.data();
    job.lq_states = path.nz;
    job.alpha = alpha;
    job.beta = beta;
    job.low = low;
    job.high = high;
    job.most_change = change;
    job.previous_input = before;
    job.cost = &cost;
    job.cost_out = cost_out.data();
    job.state_out = state_out.data();
    job.control_out = control_out.data();
  }
};

TEST(Path, feedback_is_the_same_in_lanes_and_in_c) {
  for (std::uint32_t index = 0; const tiller_model_t* model = tiller_builtin_model(index); ++index) {
    tiller_model_t in_c = *model;
    in_c.kernels = nullptr;
    double worst = 0.0;
    for (const Case& z : kCases) {
      Feedback lanes(*model, z), plain(in_c, z);
      tiller::select_path(tiller::select_rollout(*model)).feedback(*model, lanes.job);
      tiller::select_path(tiller::select_rollout(in_c)).feedback(in_c, plain.job);
      const auto compare = [&](const std::vector<double>& x, const std::vector<double>& y) {
        for (std::size_t i = 0; i < x.size(); ++i) {
          ASSERT_TRUE(std::isfinite(x[i]));
          worst = std::max(worst, std::fabs(x[i] - y[i]) / (1.0 + std::fabs(y[i])));
        }
      };
      compare(lanes.cost_out, plain.cost_out);
      compare(lanes.state_out, plain.state_out);
      compare(lanes.control_out, plain.control_out);
      for (std::uint32_t lane = 0; lane < tiller::kCandidates; ++lane)
        for (std::uint32_t k = 0; k < kHorizon; ++k) {
          const double u = lanes.control_out[k * model->input_count * tiller::kCandidates + lane];
          const double last =
              k > 0 ? lanes.control_out[(k - 1) * model->input_count * tiller::kCandidates + lane] : 0.5;
          ASSERT_GE(u, -2.0);
          ASSERT_LE(u, 2.5);
          ASSERT_LE(std::fabs(u - last), 1.5 + 1e-12);
        }
    }
    std::printf("%s: largest relative difference %.1e\n", model->name, worst);
    EXPECT_LT(worst, 1e-9);  // rounding, grown by 13 steps of an unstable motion
  }
}

}  // namespace
}  // namespace tiller_test
