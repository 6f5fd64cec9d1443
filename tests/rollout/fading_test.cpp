// Forces that fade and swing over a horizon (StepSetup::fading): every kernel against periods that are stepped one by
// one, each with the force that is left by then.

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <functional>
#include <string>
#include <vector>

#include "batch.hpp"
#include "rollout/path.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kLanes = tiller::kLanePadding, kHorizon = 9;
constexpr double kRate = 0.17, kTurn = 0.4;  // of a period

struct Case {
  const char* model;
  bool in_c;  // the loop over the C function in the place of a kernel
};

class Fading : public ::testing::TestWithParam<Case> {
 protected:
  Fading() : model_(*tiller_find_model(GetParam().model)) {
    if (GetParam().in_c) model_.kernels = nullptr;
    config_ = tiller::plain_config(&model_);
    EXPECT_EQ(make_step_setup(config_, setup_), tiller_status_ok);
    np_ = model_.param_count;
    joints_ = std::min<std::uint32_t>(model_.joint_count, 2);
    for (std::uint32_t j = 0; j < joints_; ++j)
      setup_.effects[setup_.effect_count++] = {tiller_effect_constant_offset, static_cast<std::uint16_t>(j),
                                               static_cast<std::uint16_t>(np_ + j), 0};
    setup_.fading = joints_;
    setup_.fading_param = np_;
  }
  /// Real and imaginary parts of each force after k periods, then how fast they fade and swing.
  double param(std::uint32_t i, double k) const {
    if (i < np_) return 0.5 + 0.05 * i;
    if (i >= np_ + 2 * joints_) return i == np_ + 2 * joints_ ? kRate : kTurn;
    const std::uint32_t j = (i - np_) % joints_;
    const std::complex<double> z = std::complex<double>(j == 0 ? 0.7 : -0.4, j == 0 ? -0.3 : 0.5) *
                                   std::exp(std::complex<double>(-kRate, kTurn) * k);
    return i < np_ + joints_ ? z.real() : z.imag();
  }
  std::uint32_t rows() const { return np_ + 2 * joints_ + 2; }
  /// The same forces, held.
  tiller::StepSetup held() const {
    tiller::StepSetup s = setup_;
    s.fading = 0;
    return s;
  }

  tiller_model_t model_;
  tiller::Config config_;
  tiller::StepSetup setup_;
  std::uint32_t np_ = 0, joints_ = 0;
};

template <class T>
void roll(const tiller::RolloutTable& table, const tiller_model_t& model, const tiller::RolloutJob<T>& job) {
  if constexpr (sizeof(T) == sizeof(float))
    table.rollout_f32(model, job);
  else
    table.rollout_f64(model, job);
}

template <class T>
double rollout_error(const tiller_model_t& model, const tiller::Config& config, const tiller::StepSetup& fading,
                     const tiller::StepSetup& held, const std::function<double(std::uint32_t, double)>& param,
                     std::uint32_t rows) {
  const tiller::RolloutTable& table = tiller::select_rollout(model);
  tiller::Batch<T> batch(config, kLanes, kHorizon);
  batch.setup = fading;
  std::vector<T> params(rows * kLanes), state = batch.state, next(state.size());
  const auto fill = [&](double k) {
    for (std::uint32_t i = 0; i < rows * kLanes; ++i) params[i] = static_cast<T>(param(i / kLanes, k));
  };
  fill(0.0);
  batch.job.params = {params.data(), kLanes};
  roll(table, model, batch.job);
  double worst = 0.0;
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    fill(k);
    tiller::RolloutJob<T> one = batch.job;
    one.setup = &held;
    one.horizon = 1;
    one.state = {state.data(), kLanes};
    one.params = {params.data(), kLanes};
    one.controls = {batch.controls.data() + std::size_t{k} * model.input_count * kLanes, kLanes};
    one.previous_input = nullptr;
    one.final_state = next.data();
    one.trajectory = nullptr;
    roll(table, model, one);
    state = next;
    const T* rolled = batch.trajectory.data() + std::size_t{k + 1} * state.size();
    for (std::size_t i = 0; i < state.size(); ++i)
      worst = std::max(worst, std::fabs(static_cast<double>(rolled[i] - state[i])) /
                                  (1.0 + std::fabs(static_cast<double>(state[i]))));
  }
  return worst;
}

TEST_P(Fading, ARolloutIsItsPeriodsEachWithWhatIsLeft) {
  const auto at = [this](std::uint32_t i, double k) { return param(i, k); };
  EXPECT_LT(rollout_error<double>(model_, config_, setup_, held(), at, rows()), 1e-10);
  EXPECT_LT(rollout_error<float>(model_, config_, setup_, held(), at, rows()), 2e-3);
}

/// Two scenarios along one path; the second's forces are twice as large.
TEST_P(Fading, SoIsAPathWithItsSlopesAndItsFeedback) {
  constexpr std::uint32_t kScenarios = 2;
  const std::uint32_t nx = model_.state_count, nu = model_.input_count;
  const tiller::PathKernel& kernel = tiller::select_path(tiller::select_rollout(model_));
  tiller::Batch<double> batch(config_, kLanes, kHorizon);
  std::vector<double> start(batch.state.begin(), batch.state.begin() + nx), params, control;
  for (std::uint32_t i = 0; i < nx; ++i) start[i] = batch.state[std::size_t{i} * kLanes];
  start.insert(start.end(), start.begin(), start.begin() + nx);
  for (std::uint32_t j = 0; j < kScenarios; ++j)
    for (std::uint32_t i = 0; i < rows(); ++i)
      params.push_back(param(i, 0.0) * (i >= np_ && i < np_ + 2 * joints_ ? 1.0 + j : 1.0));
  for (std::uint32_t i = 0; i < kHorizon * nu; ++i) control.push_back(0.3 * batch.controls[i]);

  tiller::PathJob one;
  const tiller::StepSetup still = held();
  one.horizon = 1;
  one.scenarios = kScenarios;
  one.param_count = rows();
  one.lq_states = nx;
  std::vector<double> path = start, a(std::size_t{kHorizon} * kScenarios * nx * nx), b(a.size() / nx * nu),
                      left = params;
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    one.setup = &still;
    for (std::uint32_t j = 0; j < kScenarios; ++j)
      for (std::uint32_t i = np_; i < np_ + joints_; ++i) left[j * rows() + i] = param(i, k) * (1.0 + j);
    path.resize(std::size_t{k + 2} * kScenarios * nx);
    one.state = path.data() + std::size_t{k} * kScenarios * nx;
    one.control = control.data() + std::size_t{k} * nu;
    one.params = left.data();
    one.next = path.data() + std::size_t{k + 1} * kScenarios * nx;
    one.a = a.data() + std::size_t{k} * kScenarios * nx * nx;
    one.b = b.data() + std::size_t{k} * kScenarios * nx * nu;
    kernel.linearise(model_, one);
  }

  tiller::PathJob whole = one;
  std::vector<double> next(std::size_t{kHorizon} * kScenarios * nx), slopes(a.size()), inputs(b.size());
  whole.setup = &setup_;
  whole.horizon = kHorizon;
  whole.state = path.data();
  whole.control = control.data();
  whole.params = params.data();
  whole.next = next.data();
  whole.a = slopes.data();
  whole.b = inputs.data();
  kernel.linearise(model_, whole);
  const auto expect_near = [](const std::vector<double>& got, const double* expected, const char* what) {
    double worst = 0.0;
    for (std::size_t i = 0; i < got.size(); ++i)
      worst = std::max(worst, std::fabs(got[i] - expected[i]) / (1.0 + std::fabs(expected[i])));
    EXPECT_LT(worst, 1e-7) << what;  // central differences of a model in C
  };
  expect_near(next, path.data() + std::size_t{kScenarios} * nx, "next");
  expect_near(slopes, a.data(), "a");
  expect_near(inputs, b.data(), "b");

  // a line search of no step: every candidate goes along the path
  const std::vector<double> none(std::size_t{kHorizon} * nu * kScenarios * nx, 0.0), zero(nu, 0.0);
  const std::vector<double> far(nu, 1e6), back(nu, -1e6);
  const std::vector<double> alpha(tiller::kCandidates, 0.0);
  std::vector<double> cost(kScenarios * tiller::kCandidates), inputs_out(control.size() * tiller::kCandidates);
  std::vector<double> states(std::size_t{kHorizon + 1} * kScenarios * nx * tiller::kCandidates);
  tiller::FeedbackJob loop;
  loop.setup = &setup_;
  loop.horizon = kHorizon;
  loop.scenarios = kScenarios;
  loop.start = start.data();
  loop.params = params.data();
  loop.param_count = rows();
  loop.state = path.data();
  loop.control = control.data();
  loop.step = loop.gain = none.data();
  loop.lq_states = nx;
  loop.alpha = loop.beta = alpha.data();
  loop.low = back.data();
  loop.high = loop.most_change = far.data();
  loop.previous_input = zero.data();
  loop.cost = &batch.weights;
  loop.cost_out = cost.data();
  loop.state_out = states.data();
  loop.control_out = inputs_out.data();
  kernel.feedback(model_, loop);
  std::vector<double> first(states.size() / tiller::kCandidates);
  for (std::size_t i = 0; i < first.size(); ++i) first[i] = states[i * tiller::kCandidates + 3];
  expect_near(first, path.data(), "feedback");
}

INSTANTIATE_TEST_SUITE_P(Kernels, Fading,
                         ::testing::Values(Case{"pendulum", false}, Case{"pendulum", true}, Case{"cart_pole", false},
                                           Case{"cart_pole", true}, Case{"planar_quadrotor", false}),
                         [](const auto& test) {
                           return std::string(test.param.model) + (test.param.in_c ? "_in_c" : "");
                         });

}  // namespace
}  // namespace tiller_test
