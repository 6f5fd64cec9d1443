// Slips of a model without joints over a horizon (StepSetup::slip_states): every kernel against periods that are
// stepped one by one without slips, with what is left of each slip added by hand.

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "batch.hpp"
#include "rollout/path.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kLanes = tiller::kLanePadding, kHorizon = 9;
constexpr double kFades = 0.17;                       // of a period
constexpr double kSlip[] = {0.7, -0.4, 0.3};          // a second, of the first three states but the second
constexpr std::uint32_t kStates = 0b101, kSlips = 2;  // which of them slip

struct Case {
  const char* name;
  const char* model;
  bool in_c;    // the loop over the C function in the place of a kernel
  bool effect;  // steps with effects have a text of their own
};

class Slip : public ::testing::TestWithParam<Case> {
 protected:
  Slip() : model_(*tiller_find_model(GetParam().model)) {
    if (GetParam().in_c) model_.kernels = nullptr;
    config_ = tiller::plain_config(&model_);
    if (GetParam().effect) tiller::add_some_effect(config_);
    EXPECT_EQ(make_step_setup(config_, none_), tiller_status_ok);
    slipping_ = none_;
    slipping_.slip_states = kStates;
    slipping_.fading = kSlips;
    slipping_.fading_param = config_.param_count;
    table_ = &tiller::select_rollout(model_);
    nx_ = model_.state_count;
    nu_ = model_.input_count;
  }
  std::uint32_t rows() const { return config_.param_count + slipping_.extra_params(); }
  /// The configuration's parameters, slips times `scale`, their imaginary parts, how fast they fade and swing.
  double param(std::uint32_t i, double scale) const {
    const std::uint32_t np = config_.param_count;
    if (i < np) return 0.5 + 0.05 * i;
    if (i < np + kSlips) return scale * kSlip[2 * (i - np)];
    return i == np + 2 * kSlips ? kFades : 0.0;
  }
  std::vector<double> params(double scale) const {
    std::vector<double> p(rows());
    for (std::uint32_t i = 0; i < rows(); ++i) p[i] = param(i, scale);
    return p;
  }
  /// Over period k.
  double slip_of(std::uint32_t state, double k) const {
    if (state >= 32 || ((kStates >> state) & 1u) == 0) return 0.0;
    return none_.period_s * kSlip[state] * std::exp(-kFades * k);
  }

  tiller_model_t model_;
  tiller::Config config_;
  tiller::StepSetup none_, slipping_;
  const tiller::RolloutTable* table_ = nullptr;
  std::uint32_t nx_ = 0, nu_ = 0;
};

template <class T>
std::vector<T> in_lanes(const std::vector<double>& params) {
  std::vector<T> rows;
  for (const double p : params) rows.insert(rows.end(), kLanes, static_cast<T>(p));
  return rows;
}

/// The largest difference of a rollout with slips from one period after the other.
template <class T, class SlipOf>
double rollout_error(const tiller_model_t& model, const tiller::RolloutTable& table, const tiller::Config& config,
                     const tiller::StepSetup& none, const tiller::StepSetup& slipping, std::vector<T> params,
                     bool splat, const SlipOf& slip_of) {
  tiller::Batch<T> batch(config, kLanes, kHorizon);
  if (splat)
    for (std::size_t i = 0; i * kLanes < params.size(); ++i) params[i] = params[i * kLanes];
  batch.setup = slipping;
  batch.job.params = {params.data(), splat ? 0 : kLanes};
  batch.run(model, table);
  std::vector<T> state = batch.state, next(state.size());
  double worst = 0.0;
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    tiller::RolloutJob<T> one = batch.job;
    one.setup = &none;
    one.horizon = 1;
    one.state = {state.data(), kLanes};
    one.controls = {batch.controls.data() + std::size_t{k} * model.input_count * kLanes, kLanes};
    one.final_state = next.data();
    one.trajectory = nullptr;
    if constexpr (sizeof(T) == sizeof(float))
      table.rollout_f32(model, one);
    else
      table.rollout_f64(model, one);
    const T* rolled = batch.trajectory.data() + std::size_t{k + 1} * state.size();
    for (std::uint32_t i = 0; i < state.size(); ++i) {
      state[i] = next[i] + static_cast<T>(slip_of(i / kLanes, k));
      worst = std::fmax(worst, std::fabs(static_cast<double>(rolled[i] - state[i])));
    }
  }
  return worst;
}

// Rounding of states of a few metres over nine periods.
TEST_P(Slip, ARolloutIsItsPeriodsEachWithWhatIsLeft) {
  const auto slip = [this](std::uint32_t i, double k) { return slip_of(i, k); };
  for (const bool splat : {false, true}) {
    EXPECT_LT(
        rollout_error<double>(model_, *table_, config_, none_, slipping_, in_lanes<double>(params(1.0)), splat, slip),
        1e-13);
    EXPECT_LT(
        rollout_error<float>(model_, *table_, config_, none_, slipping_, in_lanes<float>(params(1.0)), splat, slip),
        2e-5);
  }
}

template <class T>
std::vector<T> rolled(const tiller_model_t& model, const tiller::RolloutTable& table, const tiller::Config& config,
                      const tiller::StepSetup& setup, const std::vector<T>& params) {
  tiller::Batch<T> batch(config, kLanes, kHorizon);
  batch.setup = setup;
  batch.job.params = {params.data(), kLanes};
  batch.run(model, table);
  return batch.trajectory;
}

TEST_P(Slip, NoneIsTheIdentityToTheLastBit) {
  EXPECT_EQ(rolled<double>(model_, *table_, config_, slipping_, in_lanes<double>(params(0.0))),
            rolled<double>(model_, *table_, config_, none_, in_lanes<double>(params(0.0))));
  EXPECT_EQ(rolled<float>(model_, *table_, config_, slipping_, in_lanes<float>(params(0.0))),
            rolled<float>(model_, *table_, config_, none_, in_lanes<float>(params(0.0))));
}

/// A measured period is what a slip acts for.
TEST_P(Slip, LastsAsLongAsThePeriod) {
  tiller::Batch<double> batch(config_, kLanes, 1);
  const std::vector<double> p = in_lanes<double>(params(1.0));
  batch.job.params = {p.data(), kLanes};
  batch.job.period_s = 0.5 * none_.period_s;
  batch.run(model_, *table_);
  const std::vector<double> without = batch.final_state;
  batch.setup = slipping_;
  batch.run(model_, *table_);
  for (std::uint32_t i = 0; i < nx_; ++i)
    EXPECT_NEAR(batch.final_state[i * kLanes] - without[i * kLanes], 0.5 * slip_of(i, 0.0), 1e-14) << i;
}

struct Linearised {
  std::vector<double> next, a, b;
};
Linearised linearised(const tiller_model_t& model, const tiller::RolloutTable& table, const tiller::StepSetup& setup,
                      const tiller::Batch<double>& batch, const std::vector<double>& params) {
  const std::size_t nx = model.state_count, nu = model.input_count;
  Linearised l = {std::vector<double>(nx * kLanes), std::vector<double>(nx * nx * kLanes),
                  std::vector<double>(nx * nu * kLanes)};
  tiller::LineariseJob job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.state = batch.job.state;
  job.params = {params.data(), kLanes};
  job.effect_state = batch.job.effect_state;
  job.control = batch.job.controls;
  job.history = batch.job.history;
  job.next_state = l.next.data();
  job.a = l.a.data();
  job.b = l.b.data();
  table.linearise(model, job);
  return l;
}

TEST_P(Slip, HasNoSlope) {
  tiller::Batch<double> batch(config_, kLanes, 1);
  const std::vector<double> p = in_lanes<double>(params(1.0));
  const Linearised with = linearised(model_, *table_, slipping_, batch, p),
                   without = linearised(model_, *table_, none_, batch, p);
  // of a model in C these are differences of two steps
  const double rounding = GetParam().in_c ? 1e-9 : 0.0;
  for (std::size_t i = 0; i < with.a.size(); ++i) EXPECT_NEAR(with.a[i], without.a[i], rounding);
  for (std::size_t i = 0; i < with.b.size(); ++i) EXPECT_NEAR(with.b[i], without.b[i], rounding);
  for (std::uint32_t i = 0; i < with.next.size(); ++i)
    EXPECT_NEAR(with.next[i] - without.next[i], slip_of(i / kLanes, 0.0), 1e-14);
  EXPECT_EQ(linearised(model_, *table_, slipping_, batch, in_lanes<double>(params(0.0))).next, without.next);
}

/// Two scenarios along one path; the second slips twice as much.
TEST_P(Slip, SoIsAPathWithItsSlopesAndItsFeedback) {
  constexpr std::uint32_t kScenarios = 2;
  const tiller::PathKernel& kernel = tiller::select_path(*table_);
  tiller::Batch<double> batch(config_, kLanes, kHorizon);
  std::vector<double> path, control, p = params(1.0);
  for (std::uint32_t j = 0; j < kScenarios; ++j)
    for (std::uint32_t i = 0; i < nx_; ++i) path.push_back(batch.state[std::size_t{i} * kLanes]);
  const std::vector<double> start = path, twice = params(2.0);
  p.insert(p.end(), twice.begin(), twice.end());
  for (std::uint32_t i = 0; i < kHorizon * nu_; ++i) control.push_back(0.3 * batch.controls[i]);

  // period after period, the slips by hand
  const std::size_t row = std::size_t{kScenarios} * nx_;
  path.resize((kHorizon + 1) * row);
  std::vector<double> a(kHorizon * row * nx_), b(kHorizon * row * nu_);
  tiller::PathJob job;
  job.scenarios = kScenarios;
  job.params = p.data();
  job.param_count = rows();
  job.lq_states = nx_;
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    job.setup = &none_;
    job.horizon = 1;
    job.state = path.data() + k * row;
    job.control = control.data() + k * nu_;
    job.next = path.data() + (k + 1) * row;
    job.a = a.data() + k * row * nx_;
    job.b = b.data() + k * row * nu_;
    kernel.linearise(model_, job);
    for (std::uint32_t j = 0; j < kScenarios; ++j)
      for (std::uint32_t i = 0; i < nx_; ++i) job.next[j * nx_ + i] += (1.0 + j) * slip_of(i, k);
  }

  std::vector<double> next(kHorizon * row), slopes(a.size()), inputs(b.size());
  job.setup = &slipping_;
  job.horizon = kHorizon;
  job.state = path.data();
  job.control = control.data();
  job.next = next.data();
  job.a = slopes.data();
  job.b = inputs.data();
  kernel.linearise(model_, job);
  const double difference = GetParam().in_c ? 1e-8 : 1e-13;  // slopes of a model in C are differences
  for (std::size_t i = 0; i < next.size(); ++i) EXPECT_NEAR(next[i], path[row + i], 1e-13);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(slopes[i], a[i], difference);
  for (std::size_t i = 0; i < b.size(); ++i) EXPECT_NEAR(inputs[i], b[i], difference);

  // a line search of no step: every candidate goes along the path
  const std::vector<double> none(kHorizon * nu_ * row, 0.0), zero(nu_, 0.0), far(nu_, 1e6), back(nu_, -1e6);
  const std::vector<double> alpha(tiller::kCandidates, 0.0);
  std::vector<double> cost(kScenarios * tiller::kCandidates), inputs_out(control.size() * tiller::kCandidates);
  std::vector<double> states(path.size() * tiller::kCandidates);
  tiller::FeedbackJob loop;
  loop.setup = &slipping_;
  loop.horizon = kHorizon;
  loop.scenarios = kScenarios;
  loop.start = start.data();
  loop.params = p.data();
  loop.param_count = rows();
  loop.state = path.data();
  loop.control = control.data();
  loop.step = loop.gain = none.data();
  loop.lq_states = nx_;
  loop.alpha = loop.beta = alpha.data();
  loop.low = back.data();
  loop.high = loop.most_change = far.data();
  loop.previous_input = zero.data();
  loop.cost = &batch.weights;
  loop.cost_out = cost.data();
  loop.state_out = states.data();
  loop.control_out = inputs_out.data();
  kernel.feedback(model_, loop);
  for (std::size_t i = 0; i < path.size(); ++i) EXPECT_NEAR(states[i * tiller::kCandidates + 3], path[i], 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Kernels, Slip,
                         ::testing::Values(Case{"skid_steer", "skid_steer", false, false},
                                           Case{"skid_steer_in_c", "skid_steer", true, false},
                                           Case{"skid_steer_with_an_effect", "skid_steer", false, true},
                                           Case{"pusher_slider", "pusher_slider", false, false}),
                         [](const auto& test) { return std::string(test.param.name); });

/// The whole recursion by hand, the model's equations with it: the classical method of Runge and Kutta, then the slip.
TEST(SlipByHand, IsWhatAnyRolloutOfABaseIs) {
  const tiller_model_t& model = *tiller_find_model("skid_steer");
  const tiller::Config config = tiller::plain_config(&model);
  tiller::Batch<double> batch(config, kLanes, kHorizon);
  const double radius = 0.1, axle = 0.6, offset = 0.03, h = config.period_s, slip[] = {0.02, 0.1, -0.05}, fades = 0.2;
  const double values[] = {radius, axle, offset, slip[0], slip[1], slip[2], 0.0, 0.0, 0.0, fades, 0.0};
  const std::vector<double> params = in_lanes<double>({std::begin(values), std::end(values)});
  batch.setup.slip_states = 0b111;
  batch.setup.fading = 3;
  batch.setup.fading_param = 3;
  batch.job.params = {params.data(), kLanes};
  batch.run(model, tiller::select_rollout(model));
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    double x[3];
    for (int i = 0; i < 3; ++i) x[i] = batch.state[i * kLanes + lane];
    for (std::uint32_t k = 0; k < kHorizon; ++k) {
      const double left = batch.controls[(2 * k) * kLanes + lane], right = batch.controls[(2 * k + 1) * kLanes + lane];
      const double turn = radius * (right - left) / axle, ahead = 0.5 * radius * (left + right), aside = -offset * turn;
      const auto rate = [&](double heading, int i) {
        return i == 0   ? ahead * std::cos(heading) - aside * std::sin(heading)
               : i == 1 ? ahead * std::sin(heading) + aside * std::cos(heading)
                        : turn;
      };
      const double half = x[2] + 0.5 * h * turn, end = x[2] + h * turn;
      for (int i = 0; i < 3; ++i) {
        const double change = h / 6.0 * (rate(x[2], i) + 4.0 * rate(half, i) + rate(end, i));
        if (i < 2) x[i] += change + h * slip[i] * std::exp(-fades * k);
      }
      x[2] = end + h * slip[2] * std::exp(-fades * k);
      for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(batch.trajectory[((k + 1) * 3 + i) * kLanes + lane], x[i], 1e-12) << k << " " << i;
    }
  }
}

}  // namespace
}  // namespace tiller_test
