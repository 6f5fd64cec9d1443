#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "linear_rig.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace rig {

/// A pendulum of its own equations (Euler and Cromer, 0.1 ms) under a torque of three lines, beside a posterior that
/// reads its encoder.
struct DrivenPendulum {
  static constexpr double kLength_m = 0.5, kGravity_m_s2 = 9.81, kPeriod_s = 0.02, kEncoder_rad = 0.002;

  double least_kg = 0.3, most_kg = 0.7;  // between which the first mass is drawn
  int steps = 500;
  std::function<double(double time_s)> share = [](double) { return 1.0; };     // mass over the first
  std::function<double(double time_s)> force_Nm = [](double) { return 0.0; };  // beside the torque

  /// The model of it; mass and damping are learnt.
  static tiller::Config config(const tiller_prior_t& mass) {
    tiller::Config c;
    EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
    c.period_s = kPeriod_s;
    c.priors[0] = mass;
    c.priors[1] = fixed(kLength_m);
    c.priors[2] = uniform(0.0, 0.1);
    c.measurement_sd[0] = kEncoder_rad;
    c.process_sd[1] = 0.02;
    c.initial_state_sd[0] = c.initial_state_sd[1] = 0.01;
    c.safety.input_low[0] = -1.5;
    c.safety.input_high[0] = 1.5;
    c.posterior.adequacy = 0;
    c.posterior.moves_per_tick = 16;
    return c;
  }

  /// Runs a posterior of `c` beside it; visit(posterior, step, present mass) after each update and once at the end,
  /// where the step is `steps`.
  template <class Visit>
  void run(const tiller::Config& c, unsigned seed, const Visit& visit) const {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> n;
    std::uniform_real_distribution<double> u01;
    const double first_kg = least_kg + (most_kg - least_kg) * u01(random), damping = 0.01 + 0.08 * u01(random);
    double phase[3];
    for (double& p : phase) p = 6.283 * u01(random);
    double angle = 0.01 * n(random), rate = 0.01 * n(random), mass_kg = first_kg;

    tiller::StepSetup setup;
    ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
    Instance posterior(c, nullptr, tiller::select_rollout(*c.model), &setup);
    const double first = angle + kEncoder_rad * n(random);
    ASSERT_EQ(posterior->start(&first), tiller_status_ok);
    for (int k = 0; k < steps; ++k) {
      const double t = k * kPeriod_s;
      double torque = 0.0;
      for (int i = 0; i < 3; ++i) torque += 0.4 * std::sin((1.3 + 2.1 * i) * t + phase[i]);
      for (int i = 0; i < 200; ++i) {
        mass_kg = first_kg * share(t + 1e-4 * i);
        const double push = torque + force_Nm(t + 1e-4 * i) - damping * rate;
        rate += 1e-4 * (push / (mass_kg * kLength_m * kLength_m) - kGravity_m_s2 / kLength_m * std::sin(angle));
        angle += 1e-4 * rate;
      }
      tiller::Transition transition;
      transition.period_s = kPeriod_s;
      transition.input[0] = torque;
      transition.measured[0] = angle + kEncoder_rad * n(random);
      EXPECT_TRUE(works(posterior->update(transition)));
      visit(*posterior, k, mass_kg);
    }
    visit(*posterior, steps, mass_kg);
  }
};

}  // namespace rig
