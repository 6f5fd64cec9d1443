// Where a plan leads, of an axis that is measured and steered: the covariance of state and estimate together.

#include "executive/prediction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "bench.hpp"

namespace {

constexpr std::uint32_t kHorizon = 12, kAlike = 8;  // doubles that fill a line of the cache: another array follows
constexpr double kPeriod_s = 0.02, kMass_kg = 1.5, kGain[2] = {-40.0, -9.0};
constexpr double kPositionVariance = 1e-4, kProcess = 0.002, kStart = 0.01;

constexpr double kDemonstrated[4] = {}, kRoots[8] = {1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0};
float inputs[2 * kHorizon];
bool answers = false;
const float* sequence(const void*) { return inputs; }
bool feedback(const void*, std::uint32_t, double* gain, double* state, double*) {
  for (int i = 0; i < 2; ++i) gain[i] = kGain[i], state[i] = 0.0;
  return answers;
}

tiller::Config axis() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("linear_axis"));
  c.period_s = kPeriod_s;
  c.priors[0] = {tiller_prior_fixed, 0, kMass_kg, 0.0, kMass_kg, kMass_kg};
  c.safety.input_low[0] = -500.0;
  c.safety.input_high[0] = 500.0;
  c.planner.horizon = kHorizon;
  c.planner.particles = kAlike;
  c.planner.predict_spread = 1;
  c.cost.demonstration_mean = kDemonstrated;  // whose divergence asks for covariances
  c.cost.demonstration_root = kRoots;
  c.cost.demonstration_steps = 2;
  c.cost.demonstration_weight = 1.0;
  c.cost.demonstration_divergence = tiller_divergence_kl;
  return c;
}

/// Deviations of position and velocity, step by step: x and what is estimated of it as one state of four, which the
/// same noise moves. An input that is not the plan's moves both.
std::vector<std::array<double, 2>> deviations(double input_variance) {
  const double b[2] = {0.5 * kPeriod_s * kPeriod_s / kMass_kg, kPeriod_s / kMass_kg};
  double p[4][4] = {}, error[2][2] = {{kStart, 0.0}, {0.0, kStart}};
  for (int i = 0; i < 2; ++i) p[i][i] = kStart;
  std::vector<std::array<double, 2>> sd;
  for (std::uint32_t step = 0;; ++step) {
    sd.push_back({std::sqrt(p[0][0]), std::sqrt(p[1][1])});
    if (step == kHorizon) return sd;
    // the Kalman gain of a reading of the position after this period
    const double apart = error[0][1] + kPeriod_s * error[1][1];
    const double position = error[0][0] + kPeriod_s * (error[0][1] + apart), velocity = error[1][1] + kProcess;
    const double g[2] = {position / (position + kPositionVariance), apart / (position + kPositionVariance)};
    error[0][0] = (1.0 - g[0]) * position;
    error[0][1] = error[1][0] = (1.0 - g[0]) * apart;
    error[1][1] = velocity - g[1] * apart;
    double m[4][4] = {}, next[4][4] = {};
    for (int c = 0; c < 2; ++c) {
      const double a[2][2] = {{1.0, kPeriod_s}, {0.0, 1.0}};
      for (int r = 0; r < 2; ++r) {
        const double steered = step > 0 && answers ? b[r] * kGain[c] : 0.0;
        m[r][c] = a[r][c];
        m[r][2 + c] = steered;
        m[2 + r][c] = g[r] * a[0][c];
        m[2 + r][2 + c] = a[r][c] + steered - g[r] * a[0][c];
      }
    }
    const double white[4] = {0.0, 1.0, 0.0, 0.0}, read[4] = {0.0, 0.0, g[0], g[1]},
                 pushed[4] = {b[0], b[1], b[0], b[1]};
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) {
        next[r][c] = kProcess * white[r] * white[c] + kPositionVariance * read[r] * read[c] +
                     input_variance * pushed[r] * pushed[c];
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < 4; ++j) next[r][c] += m[r][i] * p[i][j] * m[c][j];
      }
    std::copy(&next[0][0], &next[0][0] + 16, &p[0][0]);
  }
}

struct Predicted {
  Predicted() : config(axis()) {
    std::fill(mass, mass + kAlike, static_cast<float>(kMass_kg));
    EXPECT_EQ(tiller::make_step_setup(config, setup), tiller_status_ok);
    const tiller::RolloutTable& table = tiller::select_rollout(*config.model);
    tiller::Arena measure;
    tiller::Prediction().lay_out(measure, config, setup, table);
    storage = std::make_unique<bench::Storage>(measure.used());
    tiller::Arena arena = storage->arena();
    prediction.lay_out(arena, config, setup, table);
    spread.states = 2;
    spread.covariance[0] = spread.covariance[3] = kStart;
    spread.process[3] = kProcess;
    std::fill(spread.sensor_variance, spread.sensor_variance + TILLER_MAX_STATES, HUGE_VAL);
    spread.sensor_variance[0] = kPositionVariance;
    belief.count = kAlike;
    belief.params = mass;
    belief.state = state;
    belief.spread = &spread;
    planner.sequence = sequence;
    planner.feedback = feedback;
  }
  void predict() { prediction.predict(belief, planner, nullptr, 0); }
  void expect(double input_variance) const {
    const auto sd = deviations(input_variance);
    for (std::uint32_t k = 0; k <= kHorizon; ++k)
      for (int i = 0; i < 2; ++i) {
        EXPECT_NEAR(prediction.sd(k)[i], sd[k][i], 1e-9 * sd[k][i]) << "step " << k << ", state " << i;
        EXPECT_NEAR(std::sqrt(prediction.covariance(k)[3 * i]), sd[k][i], 1e-9 * sd[k][i]) << "step " << k;
      }
  }

  float mass[kAlike], state[2 * kAlike] = {};
  tiller::Config config;
  tiller::StepSetup setup;
  std::unique_ptr<bench::Storage> storage;
  tiller::StateSpread spread;
  tiller::Belief belief;
  tiller::PlannerTable planner{};
  tiller::Prediction prediction;
};

TEST(Prediction, SpreadsAsStateAndEstimateTogether) {
  for (const bool steered : {false, true}) {
    std::fill(inputs, inputs + kHorizon, 0.0f);
    answers = steered;
    Predicted p;
    p.predict();
    p.expect(0.0);
  }
}

TEST(Prediction, PlansThatAreMadeAnewSpreadIt) {
  std::fill(inputs, inputs + kHorizon, 0.0f);
  answers = true;
  Predicted p;
  p.predict();
  inputs[0] = 4.0f;  // of which the plan before said zero, and feedback, at its reference, added nothing
  p.predict();
  p.expect(4.0 * 4.0 / 20.0);  // a twentieth of its square: the first of some 20 plans
}

/// Means of an arm's states under torques that stay, which have done so before: step by step.
std::vector<double> under_constant_torques(double delay_s) {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("two_link_arm"));
  c.planner.horizon = kHorizon;
  c.planner.particles = 1;
  c.planner.predict_spread = 1;
  std::vector<float> params(c.model->param_count, 0.5f);
  for (std::uint32_t i = 0; i < 2 && delay_s > 0.0; ++i) {
    c.effects[c.effect_count++] = {tiller_effect_input_delay, i};
    params.push_back(static_cast<float>(delay_s));
  }
  c.param_count = static_cast<std::uint32_t>(params.size());
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    c.priors[i] = {tiller_prior_fixed, 0, static_cast<double>(params[i]), 0.0, -HUGE_VAL, HUGE_VAL};
  for (std::uint32_t i = 0; i < 2; ++i) c.safety.input_low[i] = -5.0, c.safety.input_high[i] = 5.0;
  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  EXPECT_EQ(setup.delay_steps > 1, delay_s > 0.0);
  std::vector<float> history;
  for (std::uint32_t k = 0; k < setup.delay_steps; ++k) history.insert(history.end(), {0.7f, -0.4f});
  for (std::uint32_t k = 0; k < kHorizon; ++k) inputs[2 * k] = 0.7f, inputs[2 * k + 1] = -0.4f;
  answers = false;
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  tiller::Arena measure;
  tiller::Prediction().lay_out(measure, c, setup, table);
  bench::Storage storage(measure.used());
  tiller::Arena arena = storage.arena();
  tiller::Prediction prediction;
  prediction.lay_out(arena, c, setup, table);
  tiller::StateSpread spread;
  spread.states = 4;
  tiller::PlannerTable planner{};
  planner.sequence = sequence;
  const float state[4] = {0.3f, -0.2f, 0.0f, 0.0f};
  tiller::Belief belief;
  belief.count = 1;
  belief.params = params.data();
  belief.state = state;
  belief.history = history.data();
  belief.spread = &spread;
  prediction.predict(belief, planner, nullptr, 0);
  return {prediction.mean(0), prediction.mean(kHorizon) + 4};
}

TEST(Prediction, OfInputsThatStayIsTheSameWhateverTheirDelay) {
  const auto at_once = under_constant_torques(0.0), later = under_constant_torques(0.035);
  ASSERT_EQ(at_once.size(), later.size());
  // a period that a delay divides is integrated in two parts
  for (std::size_t i = 0; i < later.size(); ++i) EXPECT_NEAR(later[i], at_once[i], 1e-7) << i;
}

}  // namespace
