// Physics of each effect, against closed forms or fine references.

#include <gtest/gtest.h>

#include "batch.hpp"
#include "rollout/late_reading.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

/// The pendulum without gravity: one inertia, one joint; formulas are closed.
struct Rotor {
  tiller::Config config = plain_config(tiller_find_model("pendulum"));
  static constexpr double kInertia = 0.5 * 0.8 * 0.8;
  Rotor() { config.body.gravity_z_m_s2 = 0.0; }
  Batch<double> run(double param, double rate, double torque, std::uint32_t steps) {
    return run(std::vector<double>{param}, rate, torque, steps);
  }
  Batch<double> run(const std::vector<double>& params, double rate, double torque, std::uint32_t steps,
                    double angle = 0.3) {
    Batch<double> b(config, 16, steps);
    b.set_param(0, 0.5);
    b.set_param(1, 0.8);
    b.set_param(2, 0.0);
    for (std::uint32_t i = 0; i < params.size(); ++i) b.set_param(3 + i, params[i]);
    for (std::uint32_t l = 0; l < 16; ++l) {
      b.state[l] = angle;
      b.state[16 + l] = rate;
    }
    std::fill(b.controls.begin(), b.controls.end(), torque);
    std::fill(b.effect_state.begin(), b.effect_state.end(), 0.0);
    std::fill(b.history.begin(), b.history.end(), 0.0);
    b.run(*config.model, select_rollout(*config.model));
    return b;
  }
  static double rate(const Batch<double>& b, std::uint32_t step) { return b.trajectory[(step * 2 + 1) * 16]; }
  static double angle(const Batch<double>& b, std::uint32_t step) { return b.trajectory[step * 2 * 16]; }
};

TEST(ViscousFriction, DecaysExponentially) {
  Rotor r;
  r.config.substeps = 64;
  add_effect(r.config, tiller_effect_viscous_friction, 0);
  const double damping = 0.2, seconds = 1.0;
  const auto b = r.run(damping, 3.0, 0.0, 50);
  const double want = 3.0 * std::exp(-damping / Rotor::kInertia * seconds);
  // implicit Euler: relative error rate^2 h t / 2 with h = .02/64
  const double rate = damping / Rotor::kInertia;
  EXPECT_NEAR(Rotor::rate(b, 50), want, want * rate * rate * (0.02 / 64) * seconds);
}

TEST(CoulombFriction, SticksExactlyAndSlidesAgainAboveItsLimit) {
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4}) {
    Rotor r;
    r.config.integrator = integrator;
    add_effect(r.config, tiller_effect_coulomb_friction, 0);
    const auto stuck = r.run(0.5, 0.4, 0.3, 100);  // torque below friction: comes to rest and stays
    EXPECT_EQ(Rotor::rate(stuck, 100), 0.0);
    EXPECT_EQ(Rotor::angle(stuck, 100), Rotor::angle(stuck, 60));
    const auto slides = r.run(0.5, 0.0, 0.8, 50);
    EXPECT_NEAR(Rotor::rate(slides, 50), (0.8 - 0.5) / Rotor::kInertia * 1.0, 1e-12);
  }
}

TEST(CoulombFriction, StopsAfterTheClosedFormTime) {
  Rotor r;
  r.config.substeps = 10;
  add_effect(r.config, tiller_effect_coulomb_friction, 0);
  const double friction = 0.4, rate0 = 2.0;
  const auto b = r.run(friction, rate0, 0.0, 100);
  const double stop_s = rate0 * Rotor::kInertia / friction;  // 1.6 s
  const auto step = static_cast<std::uint32_t>(std::ceil(stop_s / 0.02)) + 1;
  EXPECT_EQ(Rotor::rate(b, step), 0.0);
  EXPECT_GT(Rotor::rate(b, step - 3), 0.0);
  // way = rate^2 J / (2 F), within one substep's worth of motion
  EXPECT_NEAR(Rotor::angle(b, 100) - 0.3, rate0 * rate0 * Rotor::kInertia / (2 * friction), 2.0 * 0.002);
}

/// A level arm of two links with dry friction at both joints. What one joint's friction does to the other is as large
/// as what it does to its own joint.
struct LevelArm {
  static constexpr double kFriction[2] = {0.6, 0.3};
  tiller::Config config = plain_config(tiller_find_model("two_link_arm"));
  LevelArm() {
    config.period_s = 0.01;
    config.body.gravity_z_m_s2 = 0.0;
    for (std::uint32_t joint = 0; joint < 2; ++joint) add_effect(config, tiller_effect_coulomb_friction, joint);
  }
  /// rate, torque: largest of both joints, in units of what is drawn over [-1, 1] lane by lane.
  Batch<double> run(std::uint32_t substeps, double rate, double torque, std::uint32_t steps, std::uint64_t seed) {
    config.substeps = substeps;
    Batch<double> b(config, 16, steps, seed);
    const double arm[] = {2.0, 2.3, 0.3, 0.25, 0.15, 0.16, 0.05, 0.03, kFriction[0], kFriction[1]};
    for (std::uint32_t i = 0; i < 10; ++i) b.set_param(i, arm[i]);
    for (std::uint32_t i = 0; i < 2; ++i)
      for (std::uint32_t l = 0; l < 16; ++l) {
        b.state[(2 + i) * 16 + l] *= rate / 1.5;
        const double held = b.controls[i * 16 + l] * torque * kFriction[i] / 3.0;
        for (std::uint32_t k = 0; k < steps; ++k) b.controls[(k * 2 + i) * 16 + l] = held;
      }
    b.run(*config.model, select_rollout(*config.model));
    return b;
  }
};

TEST(CoulombFriction, HoldsJointsThatPushEachOther) {
  LevelArm arm;
  const auto b = arm.run(1, 0.0, 0.9, 100, 1);
  for (std::uint32_t i = 0; i < 2; ++i)
    for (std::uint32_t l = 0; l < 16; ++l)
      EXPECT_NEAR(b.final_state[i * 16 + l], b.state[i * 16 + l], 2e-3);  // in a second; one sweep alone creeps by 1e-2
}

TEST(CoulombFriction, OfCoupledJointsGoesWhereFineStepsGo) {
  LevelArm arm;
  double square = 0.0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    // rates at which a joint often comes to rest within the period, and torques of twice the friction
    const auto coarse = arm.run(1, 0.05, 2.0, 1, seed), fine = arm.run(64, 0.05, 2.0, 1, seed);
    for (std::uint32_t i = 2 * 16; i < 4 * 16; ++i) square += std::pow(coarse.final_state[i] - fine.final_state[i], 2);
  }
  // an imported arm's process noise is 0.01 rad/s in such a period; one sweep alone is off by 2e-2
  EXPECT_LT(std::sqrt(square / (8 * 32)), 2e-3);
}

TEST(StribeckFriction, BreaksLooseAtStictionAndSlidesOnCoulomb) {
  Rotor r;
  add_effect(r.config, tiller_effect_stribeck_friction, 0);
  const std::vector<double> params = {0.3, 0.2, 0.05};
  EXPECT_EQ(Rotor::rate(r.run(params, 0.0, 0.49, 50), 50), 0.0);  // below friction + extra
  EXPECT_GT(Rotor::rate(r.run(params, 0.0, 0.51, 50), 50), 0.3);
  const auto slides = r.run(params, 1.0, 0.8, 50);  // twenty Stribeck velocities: nothing of the extra is left
  EXPECT_NEAR(Rotor::rate(slides, 50), 1.0 + (0.8 - 0.3) / Rotor::kInertia, 1e-9);
  EXPECT_EQ(Rotor::rate(r.run(params, 0.4, 0.0, 100), 100), 0.0);  // stops and stays
}

// Against the same law integrated at a thousandth of the step, at speeds where the friction falls.
TEST(StribeckFriction, FollowsItsLawAgainstAFineReference) {
  Rotor r;
  r.config.substeps = 16;
  add_effect(r.config, tiller_effect_stribeck_friction, 0);
  const auto b = r.run({0.2, 0.3, 0.4}, 0.5, 0.6, 25);
  double rate = 0.5;
  for (int k = 0; k < 500000; ++k) {
    const double ratio = rate / 0.4;
    rate += 1e-6 * (0.6 - 0.2 - 0.3 * std::exp(-ratio * ratio)) / Rotor::kInertia;
  }
  EXPECT_NEAR(Rotor::rate(b, 25), rate, 2e-3);  // the level is that of the step's start: first order at 1.25 ms
}

TEST(AsymmetricFriction, TellsForwardFromBackward) {
  Rotor r;
  add_effect(r.config, tiller_effect_asymmetric_friction, 0);
  const std::vector<double> params = {0.4, 0.1};
  EXPECT_NEAR(Rotor::rate(r.run(params, 2.0, 0.0, 20), 20), 2.0 - 0.4 / Rotor::kInertia * 0.4, 1e-12);
  EXPECT_NEAR(Rotor::rate(r.run(params, -2.0, 0.0, 20), 20), -2.0 + 0.1 / Rotor::kInertia * 0.4, 1e-12);
  EXPECT_EQ(Rotor::rate(r.run(params, 0.0, 0.39, 20), 20), 0.0);
  EXPECT_EQ(Rotor::rate(r.run(params, 0.0, -0.09, 20), 20), 0.0);
  EXPECT_LT(Rotor::rate(r.run(params, 0.0, -0.2, 20), 20), 0.0);
}

TEST(QuadraticDrag, DecaysHyperbolicallyAndReachesItsTerminalSpeed) {
  Rotor r;
  add_effect(r.config, tiller_effect_quadratic_drag, 0);
  const double drag = 0.3;
  // Kahan's rule is exact for free decay: v = v0 / (1 + drag v0 t / J)
  for (std::uint32_t step : {1u, 10u, 50u})
    EXPECT_NEAR(Rotor::rate(r.run(drag, 3.0, 0.0, 50), step), 3.0 / (1.0 + drag * 3.0 * 0.02 * step / Rotor::kInertia),
                1e-12);
  const auto b = r.run(drag, 0.0, 0.8, 100);
  const double end = std::sqrt(0.8 / drag), pace = std::sqrt(0.8 * drag) / Rotor::kInertia;
  for (std::uint32_t step : {10u, 30u, 100u})  // second order: (pace 20 ms)^2 / 12
    EXPECT_NEAR(Rotor::rate(b, step), end * std::tanh(pace * 0.02 * step), end * pace * pace * 4e-4 / 6);
  EXPECT_LT(Rotor::rate(r.run(drag, -3.0, 0.0, 10), 10), -1.0);
}

TEST(LoadFriction, GoesWithTheDriveForce) {
  Rotor r;
  add_effect(r.config, tiller_effect_load_friction, 0);
  EXPECT_NEAR(Rotor::rate(r.run(0.3, 0.0, 0.8, 50), 50), 0.7 * 0.8 / Rotor::kInertia, 1e-12);
  EXPECT_EQ(Rotor::rate(r.run(0.3, 1.0, 0.0, 50), 50), 1.0);  // no load, no friction
  EXPECT_EQ(Rotor::rate(r.run(1.2, 0.0, 0.8, 50), 50), 0.0);  // locks itself
}

// The equation itself, 2 v z sigma / level kept explicit, at a hundred thousandth of a second.
TEST(LugreFriction, FollowsItsLawAgainstAFineReference) {
  const double friction = 0.2, extra = 0.15, speed = 0.1;
  struct Row {
    double stiffness, torque;
    std::uint32_t substeps;
    double tolerance;
  };
  // sliding off; and swinging on the bristles, which implicit Euler would damp by a tenth in this second
  for (const Row& row : {Row{40, 0.5, 64, 3e-4}, Row{40, 0.5, 8, 2e-3}, Row{2, 0.1, 8, 2e-5}, Row{2, 0.1, 1, 1e-3}}) {
    Rotor r;
    r.config.integrator = tiller_integrator_rk4;
    r.config.substeps = row.substeps;
    add_effect(r.config, tiller_effect_lugre_friction, 0);
    const auto b = r.run({friction, extra, speed, row.stiffness}, 0.0, row.torque, 50);
    double q = 0.3, v = 0.0, z = 0.0;
    constexpr double kDt = 1e-6;
    for (int step = 1; step <= 50; ++step) {
      for (int k = 0; k < 20000; ++k) {
        const double level = friction + extra * std::exp(-(v / speed) * (v / speed));
        z += kDt * (v - row.stiffness * std::abs(v) * z / level);
        v += kDt * (row.torque - row.stiffness * z) / Rotor::kInertia;
        q += kDt * v;
      }
      if (step % 10 != 0) continue;
      EXPECT_NEAR(Rotor::rate(b, step), v, row.tolerance) << row.stiffness << " " << row.substeps << " " << step;
      EXPECT_NEAR(Rotor::angle(b, step), q, row.tolerance) << row.stiffness << " " << row.substeps << " " << step;
    }
  }
}

TEST(LugreFriction, HoldsLikeASpringBeforeItSlides) {
  for (double stiffness : {1e3, 1e4, 1e8}) {  // at 20 ms: from about to far below the bristles' period
    Rotor r;
    add_effect(r.config, tiller_effect_lugre_friction, 0);
    const auto b = r.run({0.5, 0.0, 0.1, stiffness}, 0.0, 0.2, 400);
    EXPECT_NEAR(Rotor::rate(b, 400), 0.0, 1e-6) << stiffness;
    // the bristles bend by torque / stiffness and, on the way there, creep a little (z' < v)
    EXPECT_NEAR(b.final_effect[0], 0.2 / stiffness, 1e-3 * 0.2 / stiffness) << stiffness;
    EXPECT_GE(Rotor::angle(b, 400) - 0.3, 0.999 * 0.2 / stiffness);
    EXPECT_LE(Rotor::angle(b, 400) - 0.3, 4.0 * 0.2 / stiffness);
    const auto slides = r.run({0.5, 0.0, 0.1, stiffness}, 1.0, 0.8, 50);
    EXPECT_NEAR(Rotor::rate(slides, 50), 1.0 + 0.3 / Rotor::kInertia, 1.1 * 0.5 / stiffness * 50 + 1e-9);
  }
}

TEST(LinearSpring, SwingsWithItsFrequencyAndKeepsItsEnergyAtAnyStep) {
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4}) {
    Rotor r;
    r.config.integrator = integrator;
    r.config.substeps = 10;
    add_effect(r.config, tiller_effect_linear_spring, 0);
    const double stiffness = 8.0, pace = std::sqrt(stiffness / Rotor::kInertia);
    const auto b = r.run(stiffness, 0.0, 0.0, 50);
    for (std::uint32_t step : {10u, 25u, 50u})  // phase error pace^3 h^2 t / 12, and pace h / 2 of the first-order rule
      EXPECT_NEAR(Rotor::angle(b, step), 0.3 * std::cos(pace * 0.02 * step),
                  integrator == tiller_integrator_rk4 ? 1e-4 : 0.3 * pace * 0.002)
          << step;
    for (double hard : {1e2, 1e5}) {
      const auto stiff = r.run(hard, 0.0, 0.0, 500);
      for (std::uint32_t step = 1; step <= 500; ++step) ASSERT_LE(std::abs(Rotor::angle(stiff, step)), 0.6) << hard;
      if (integrator == tiller_integrator_rk4) {
        const double v = Rotor::rate(stiff, 500), q = Rotor::angle(stiff, 500);
        EXPECT_NEAR(0.5 * Rotor::kInertia * v * v + 0.5 * hard * q * q, 0.5 * hard * 0.09, 1e-9 * hard);
      }
    }
  }
}

TEST(CubicSpring, KeepsItsEnergyAndItsPeriod) {
  Rotor r;
  r.config.substeps = 10;
  add_effect(r.config, tiller_effect_cubic_spring, 0);
  const double stiffness = 40.0;
  const auto b = r.run({stiffness}, 0.0, 0.0, 200, 0.5);
  const double energy = 0.25 * stiffness * std::pow(0.5, 4);
  double crossing = 0.0;
  for (std::uint32_t step = 1; step <= 200; ++step) {
    const double q = Rotor::angle(b, step), v = Rotor::rate(b, step);
    EXPECT_NEAR(0.5 * Rotor::kInertia * v * v + 0.25 * stiffness * std::pow(q, 4), energy, 1e-3 * energy);
    const double before = Rotor::angle(b, step - 1);
    if (crossing == 0.0 && q < 0.0) crossing = 0.02 * (step - 1 + before / (before - q));
  }
  // a quarter period: sqrt(2 J / k) / amplitude times the integral of 1 / sqrt(1 - s^4), 1.31102878
  EXPECT_NEAR(crossing, 1.31102878 * std::sqrt(2 * Rotor::kInertia / stiffness) / 0.5, 1e-3);
}

TEST(SquareSpring, KeepsItsEnergy) {
  Rotor r;
  r.config.substeps = 10;
  add_effect(r.config, tiller_effect_square_spring, 0);
  const double stiffness = 20.0, energy = stiffness * std::pow(0.5, 3) / 3;
  const auto b = r.run({stiffness}, 0.0, 0.0, 200, 0.5);
  for (std::uint32_t step = 1; step <= 200; ++step) {
    const double q = Rotor::angle(b, step), v = Rotor::rate(b, step);
    EXPECT_NEAR(0.5 * Rotor::kInertia * v * v + stiffness * std::pow(std::abs(q), 3) / 3, energy, 2e-3 * energy);
  }
  const auto stiff = r.run({1e5}, 0.0, 0.0, 500, 0.5);  // far stiffer than the step can follow
  for (std::uint32_t step = 1; step <= 500; ++step) ASSERT_LE(std::abs(Rotor::angle(stiff, step)), 0.6);
}

// Half a swing on spring and damper, then free: depth and speed of the return have closed forms.
TEST(HardStop, GivesBackWhatItsDamperLeavesOnEitherSide) {
  const double place = 0.5, stiffness = 400.0, damping = 2.0, speed = 1.0;
  const double pace = std::sqrt(stiffness / Rotor::kInertia),
               share = 0.5 * damping / std::sqrt(stiffness * Rotor::kInertia),
               swing = pace * std::sqrt(1 - share * share);
  for (const double side : {1.0, -1.0}) {
    Rotor r;
    r.config.substeps = 64;
    r.config.integrator = tiller_integrator_rk4;
    add_effect(r.config, tiller_effect_hard_stop, 0);
    const auto b = r.run({side * place, side * stiffness, damping}, side * speed, 0.0, 100, side * 0.3);
    double furthest = 0.0;
    for (std::uint32_t step = 1; step <= 100; ++step) furthest = std::max(furthest, side * Rotor::angle(b, step));
    EXPECT_GT(furthest, place + 0.02);
    EXPECT_LT(furthest, place + speed / pace);
    // the spring lets go where spring and damper together would pull
    const double angle = std::atan2(2 * share * std::sqrt(1 - share * share), 1 - 2 * share * share);
    const double gone = (3.14159265358979323846 - angle) / swing;
    const double back = speed * std::exp(-share * pace * gone);
    EXPECT_NEAR(side * Rotor::rate(b, 100), -back, 0.01);
    // short of it nothing happens
    EXPECT_EQ(Rotor::rate(r.run({side * place, side * stiffness, damping}, 0.0, 0.0, 20, side * 0.45), 20), 0.0);
  }
  Rotor r;
  add_effect(r.config, tiller_effect_hard_stop, 0);
  const auto hard = r.run({0.5, 1e7, 10.0}, 1.0, 0.5, 400);  // far stiffer than the step can follow: it holds
  for (std::uint32_t step = 1; step <= 400; ++step) ASSERT_LT(Rotor::angle(hard, step), 0.55) << step;
}

TEST(PositionFriction, FollowsItsLawAndHoldsWhereItIsLarge) {
  Rotor r;
  r.config.substeps = 16;
  add_effect(r.config, tiller_effect_position_friction, 0);
  const std::vector<double> params = {0.3, 0.1, -0.2, 0.7};
  const auto b = r.run(params, 1.0, 0.45, 50);
  double q = 0.3, v = 1.0;
  for (int k = 0; k < 1000000; ++k) {
    const double a = 2 * M_PI * q / 0.7;
    v += 1e-6 * (0.45 - (0.3 + 0.1 * std::cos(a) - 0.2 * std::sin(a))) / Rotor::kInertia;
    q += 1e-6 * v;
  }
  EXPECT_NEAR(Rotor::rate(b, 50), v, 1e-3);
  EXPECT_GT(Rotor::rate(r.run({0.3, 0.2, 0.0, 0.6}, 0.0, 0.2, 10, 0.3), 10), 0.01);  // 0.1 does not hold 0.2
  EXPECT_EQ(Rotor::rate(r.run({0.3, 0.2, 0.0, 0.6}, 0.0, 0.4, 50, 0.0), 50), 0.0);   // 0.5 holds 0.4
}

TEST(GainDrift, FallsBySoMuchEachSecond) {
  Rotor r;
  add_effect(r.config, tiller_effect_gain_drift, 0);
  const double drift = -0.4, torque = 0.8;
  const auto b = r.run(drift, 0.0, torque, 50);  // 1 s
  EXPECT_NEAR(Rotor::rate(b, 50), torque * (1.0 + 0.5 * drift) / Rotor::kInertia, 1e-9);
  const auto gone = r.run(-2.0, 0.0, torque, 100);  // nothing acts from 0.5 s on
  EXPECT_NEAR(Rotor::rate(gone, 100), torque * 0.25 / Rotor::kInertia, 2e-3);
}

TEST(WarmingFriction, FallsToItsShareFromTheStartOn) {
  Rotor r;
  add_effect(r.config, tiller_effect_warming_friction, 0);
  const double friction = 0.3, share = 0.4, warms_s = 0.5, torque = 0.8;
  const auto b = r.run({friction, share, warms_s}, 1.0, torque, 50);  // 1 s
  const double impulse = friction * (share + (1 - share) * warms_s * (1 - std::exp(-1 / warms_s)));
  EXPECT_NEAR(Rotor::rate(b, 50), 1.0 + (torque - impulse) / Rotor::kInertia, 1e-3);
  const auto held = r.run({friction, share, warms_s}, 0.0, 0.2, 100);  // cold it holds, warm it does not
  EXPECT_EQ(Rotor::rate(held, 20), 0.0);
  EXPECT_GT(Rotor::rate(held, 100), 0.0);
}

TEST(SupplySag, FallsWithTheMeanOfWhatWasAsked) {
  Rotor r;
  add_effect(r.config, tiller_effect_supply_sag, 0);
  const double droop = 0.5, recovery = 0.3, torque = 0.8;
  const auto b = r.run({droop, recovery}, 0.0, torque, 50);
  // impulse of u / (1 + droop u (1 - exp(-t / recovery))): with s = droop u, recovery u / (1 + s) ln((1 + s) e^(t/T) -
  // s)
  const double s = droop * torque;
  const auto impulse = [&](double t) {
    return recovery * torque / (1 + s) * std::log((1 + s) * std::exp(t / recovery) - s);
  };
  for (std::uint32_t step : {5u, 20u, 50u})
    EXPECT_NEAR(Rotor::rate(b, step) * Rotor::kInertia, impulse(0.02 * step), 2e-4) << step;
  EXPECT_EQ(Rotor::rate(r.run({0.0, recovery}, 0.0, torque, 50), 50),
            Rotor::rate(r.run({0.0, 0.0}, 0.0, torque, 50), 50));
}

// Two bodies on a spring: (1 - cos w t) u / (m + J) is the joint's acceleration, w^2 = k (1/m + 1/J).
TEST(ElasticJoint, RotorAndJointSwingAgainstEachOther) {
  const double stiffness = 30.0, rotor = 0.05, torque = 0.5, mass = Rotor::kInertia;
  const double w = std::sqrt(stiffness * (1 / mass + 1 / rotor));
  for (std::uint32_t substeps : {8u, 64u}) {
    Rotor r;
    r.config.substeps = substeps;
    add_effect(r.config, tiller_effect_elastic_joint, 0);
    const auto b = r.run({stiffness, rotor, 0.0}, 0.0, torque, 50);
    const double step_s = 0.02 / substeps, late = std::pow(w * step_s, 2) / 12 * w;  // phase error a second
    for (std::uint32_t step : {2u, 10u, 50u}) {
      const double t = 0.02 * step, size = torque / (mass + rotor);
      EXPECT_NEAR(Rotor::rate(b, step), size * (t - std::sin(w * t) / w), size / w * (late * t + 0.02)) << step;
    }
  }
  // a spring far stiffer than the step: one body
  Rotor r;
  add_effect(r.config, tiller_effect_elastic_joint, 0);
  const auto stiff = r.run({1e7, rotor, 100.0}, 0.0, torque, 50);
  EXPECT_NEAR(Rotor::rate(stiff, 50), torque / (mass + rotor), 1e-3);
  // and off to the last bit
  EXPECT_EQ(Rotor::rate(r.run({0.0, rotor, 0.1}, 1.0, torque, 50), 50),
            Rotor::rate(r.run({stiffness, 0.0, 0.1}, 1.0, torque, 50), 50));
}

// A damped oscillator about the goal: q - u = A e^(-c t) (cos w t + c / w sin w t).
TEST(PositionServo, SwingsIntoItsGoalAndIsStableAtAnyStep) {
  const double stiffness = 12.0, damping = 0.8, goal = 1.1, start = 0.3;
  const double c = 0.5 * damping / Rotor::kInertia, w = std::sqrt(stiffness / Rotor::kInertia - c * c);
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_midpoint}) {
    Rotor r;
    r.config.integrator = integrator;
    r.config.substeps = 10;
    add_effect(r.config, tiller_effect_position_servo, 0);
    const auto b = r.run({stiffness, damping, 0.0}, 0.0, goal, 50);
    for (std::uint32_t step : {5u, 15u, 50u}) {
      const double t = 0.02 * step;
      const double want = goal + (start - goal) * std::exp(-c * t) * (std::cos(w * t) + c / w * std::sin(w * t));
      // (w h)^2 / 12 of phase a swing; the first-order rule is half a step late besides
      EXPECT_NEAR(Rotor::angle(b, step), want, integrator == tiller_integrator_midpoint ? 2e-5 : 5e-3) << step;
    }
    for (double hard : {1e2, 1e5}) {  // 200 radians a period
      const auto stiff = r.run({hard, 0.0, 0.0}, 0.0, goal, 500);
      for (std::uint32_t step = 1; step <= 500; ++step)
        ASSERT_LE(std::abs(Rotor::angle(stiff, step) - goal), 1.6) << hard << " " << step;
    }
  }
}

TEST(PositionServo, PushesNoHarderThanItsLimitAndRubsByIt) {
  Rotor r;
  r.config.integrator = tiller_integrator_midpoint;
  add_effect(r.config, tiller_effect_position_servo, 0);
  // a goal that is never reached: the limit all the time
  EXPECT_NEAR(Rotor::rate(r.run({1e3, 0.0, 0.8}, 0.0, 50.0, 50), 50), 0.8 / Rotor::kInertia, 1e-12);
  EXPECT_NEAR(Rotor::rate(r.run({1e3, 0.0, 0.8}, 0.0, -50.0, 50), 50), -0.8 / Rotor::kInertia, 1e-12);
  // what goes with the drive force goes with the servo's, whatever the number of the goal is
  add_effect(r.config, tiller_effect_load_friction, 0);
  EXPECT_NEAR(Rotor::rate(r.run({1e3, 0.0, 0.8, 0.3}, 0.0, 50.0, 50), 50), 0.7 * 0.8 / Rotor::kInertia, 1e-12);
  // and what is behind a spring is turned by it: both end at the goal
  Rotor elastic;
  elastic.config.substeps = 10;
  add_effect(elastic.config, tiller_effect_elastic_joint, 0);
  add_effect(elastic.config, tiller_effect_position_servo, 0);
  EXPECT_NEAR(Rotor::angle(elastic.run({300.0, 0.01, 0.5, 12.0, 4.0, 0.0}, 0.0, 1.1, 400), 400), 1.1, 1e-3);
}

/// Servos at both joints of the level arm, against fine steps.
TEST(PositionServo, OfCoupledJointsGoesWhereFineStepsGo) {
  const auto run = [](std::uint32_t substeps) {
    tiller::Config config = plain_config(tiller_find_model("two_link_arm"));
    config.period_s = 0.01;
    config.substeps = substeps;
    config.integrator = tiller_integrator_midpoint;
    for (std::uint32_t joint = 0; joint < 2; ++joint) add_effect(config, tiller_effect_position_servo, joint);
    Batch<double> b(config, 16, 20);
    const double arm[] = {2.0, 2.3, 0.3, 0.25, 0.15, 0.16, 0.05, 0.03, 40.0, 2.0, 0.0, 15.0, 0.6, 3.0};
    for (std::uint32_t i = 0; i < 14; ++i) b.set_param(i, arm[i]);
    b.run(*config.model, select_rollout(*config.model));
    return b;
  };
  const auto fine = run(256);
  const auto error_of = [&](std::uint32_t substeps) {
    const auto coarse = run(substeps);
    double square = 0.0;
    for (std::uint32_t i = 0; i < 4 * 16; ++i) square += std::pow(coarse.final_state[i] - fine.final_state[i], 2);
    return std::sqrt(square / 64);
  };
  // goals that jump by radians each period; the joints' servos act one after the other, which is of the first order
  EXPECT_LT(error_of(32), 0.6 * error_of(16));
  EXPECT_LT(error_of(4), 0.05 * 15.0);  // of speeds about 15 rad/s
}

TEST(Cogging, KeepsTheEnergyOfItsPotential) {
  Rotor r;
  add_effect(r.config, tiller_effect_cogging, 0);
  const double a = 0.2, c = -0.3, pitch = 0.5, wave = 2 * M_PI / pitch;
  const auto b = r.run({a, c, pitch}, 1.0, 0.0, 300);
  const auto energy = [&](std::uint32_t step) {
    const double q = wave * Rotor::angle(b, step), v = Rotor::rate(b, step);
    return 0.5 * Rotor::kInertia * v * v - (a * std::sin(q) - c * std::cos(q)) / wave;
  };
  for (std::uint32_t step = 0; step <= 300; ++step) EXPECT_NEAR(energy(step), energy(0), 5e-3 * energy(0)) << step;
}

TEST(TorqueRipple, SwingsTheDriveForceAndNothingElse) {
  Rotor r;
  r.config.substeps = 10;
  add_effect(r.config, tiller_effect_torque_ripple, 0);
  const std::vector<double> params = {0.3, -0.2, 0.1, 0.15, 0.4};
  EXPECT_EQ(Rotor::rate(r.run(params, 1.0, 0.0, 50), 50), 1.0);
  const auto b = r.run(params, 0.0, 0.7, 50);
  double q = 0.3, v = 0.0;
  for (int k = 0; k < 1000000; ++k) {
    const double x = 2 * M_PI * q / 0.4;
    v += 1e-6 * 0.7 / Rotor::kInertia *
         (1 + 0.3 * std::cos(x) - 0.2 * std::sin(x) + 0.1 * std::cos(2 * x) + 0.15 * std::sin(2 * x));
    q += 1e-6 * v;
  }
  EXPECT_NEAR(Rotor::rate(b, 50), v, 1e-3);
}

TEST(JointInertia, IsWhatAHeavierBodyWouldBe) {
  Rotor r;
  add_effect(r.config, tiller_effect_joint_inertia, 0);
  for (double inertia : {0.1, 1e4}) {
    const auto b = r.run(inertia, 0.0, 0.8, 50);
    EXPECT_NEAR(Rotor::rate(b, 50), 0.8 / (Rotor::kInertia + inertia), 1e-12);
    EXPECT_NEAR(Rotor::angle(b, 50) - 0.3, 0.5 * 0.8 / (Rotor::kInertia + inertia), 1e-12);
  }
  // at the cart, through the whole mechanism: a heavier cart
  const tiller_model_t& m = *tiller_find_model("cart_pole");
  tiller::Config config = plain_config(&m);
  config.substeps = 64;
  add_effect(config, tiller_effect_joint_inertia, 0);
  Batch<double> with(config, 16, 50), heavier(config, 16, 50);
  with.set_param(3, 0.4);
  heavier.set_param(3, 0.0);
  for (std::uint32_t l = 0; l < 16; ++l) heavier.params[l] += 0.4;
  with.run(m, select_rollout(m));
  heavier.run(m, select_rollout(m));
  for (std::size_t i = 0; i < with.final_state.size(); ++i)
    EXPECT_NEAR(with.final_state[i], heavier.final_state[i], 0.02);  // first order in the rates at 0.3 ms, 1 s
}

// Dry friction feels the sum: the joint stops when the heavier one does, and stands.
TEST(JointInertia, StandsBeforeFriction) {
  for (bool first : {true, false}) {
    Rotor r;
    add_effect(r.config, first ? tiller_effect_joint_inertia : tiller_effect_coulomb_friction, 0);
    add_effect(r.config, first ? tiller_effect_coulomb_friction : tiller_effect_joint_inertia, 0);
    const double inertia = 0.2, friction = 0.4;
    const auto b = first ? r.run({inertia, friction}, 1.0, 0.0, 100) : r.run({friction, inertia}, 1.0, 0.0, 100);
    const double stop_s = (Rotor::kInertia + inertia) / friction;
    const auto step = static_cast<std::uint32_t>(std::ceil(stop_s / 0.02)) + 1;
    EXPECT_EQ(Rotor::rate(b, step), 0.0);
    EXPECT_GT(Rotor::rate(b, step - 3), 0.0);
  }
}

TEST(InputShapes, AreWhatTheySay) {
  const auto rate = [](tiller_effect_kind_t kind, double param, double torque) {
    Rotor r;
    add_effect(r.config, kind, 0);
    return Rotor::rate(r.run(param, 0.0, torque, 50), 50) * Rotor::kInertia;  // mean force over 1 s
  };
  EXPECT_EQ(rate(tiller_effect_dead_zone, 0.3, 0.2), 0.0);
  EXPECT_NEAR(rate(tiller_effect_dead_zone, 0.3, 0.8), 0.5, 1e-12);
  EXPECT_NEAR(rate(tiller_effect_dead_zone, 0.3, -0.8), -0.5, 1e-12);
  EXPECT_NEAR(rate(tiller_effect_saturation, 0.3, 0.8), 0.3, 1e-12);
  EXPECT_NEAR(rate(tiller_effect_saturation, 0.3, -0.8), -0.3, 1e-12);
  EXPECT_NEAR(rate(tiller_effect_saturation, 0.3, 0.2), 0.2, 1e-12);
  EXPECT_NEAR(rate(tiller_effect_actuator_gain, -0.25, 0.8), 0.6, 1e-12);
}

TEST(RateLimit, RampsExactlyWhereverTheStepsFall) {
  Rotor r;
  add_effect(r.config, tiller_effect_rate_limit, 0);
  const double torque = 0.9, limit = 1.7;
  const auto b = r.run(limit, 0.0, torque, 50);
  for (std::uint32_t step : {1u, 20u, 27u, 50u}) {
    const double t = 0.02 * step, ramp = std::min(t, torque / limit);
    EXPECT_NEAR(Rotor::rate(b, step) * Rotor::kInertia, 0.5 * limit * ramp * ramp + torque * (t - ramp), 1e-12);
  }
  EXPECT_EQ(b.final_effect[0], torque);
}

TEST(Backlash, CrossesTheGapAndThenDrivesBoth) {
  Rotor r;
  r.config.substeps = 64;
  add_effect(r.config, tiller_effect_backlash, 0);
  const double gap = 0.2, rotor = 0.05, torque = 0.5;
  const auto b = r.run({gap, rotor}, 0.0, torque, 50);
  const double hit_s = std::sqrt(gap * rotor / torque);  // half a gap at torque / rotor: 0.141 s
  for (std::uint32_t step : {2u, 5u, 7u}) EXPECT_EQ(Rotor::rate(b, step), 0.0) << hit_s;
  for (std::uint32_t step : {8u, 20u, 50u})  // inelastic: one momentum, whatever happened between
    EXPECT_NEAR(Rotor::rate(b, step), torque * 0.02 * step / (Rotor::kInertia + rotor), 1e-9);
  EXPECT_NEAR(b.final_effect[0], 0.5 * gap, 1e-12);
  // without drive the joint runs through the gap and then takes the rotor along
  Batch<double> coasts = r.run({gap, rotor}, 0.0, 0.0, 50);
  for (std::uint32_t l = 0; l < 16; ++l) {
    coasts.state[16 + l] = 1.0;
    coasts.effect_state[32 + l] = 1.0;  // begun: the rotor stands
  }
  coasts.run(*r.config.model, select_rollout(*r.config.model));
  EXPECT_EQ(Rotor::rate(coasts, 4), 1.0);  // half the gap takes 0.1 s
  EXPECT_NEAR(Rotor::rate(coasts, 6), Rotor::kInertia / (Rotor::kInertia + rotor), 1e-12);
}

// The rotor never leaves the gap, whatever the step and however light it is.
TEST(Backlash, StaysInTheGap) {
  for (double rotor : {1e-9, 1e-3, 1.0})
    for (std::uint32_t substeps : {1u, 4u}) {
      tiller::Config config = plain_config(tiller_find_model("pendulum"));
      config.substeps = substeps;
      add_effect(config, tiller_effect_backlash, 0);
      Batch<double> b(config, 16, 200);
      b.set_param(3, 0.3);
      b.set_param(4, rotor);
      std::fill(b.effect_state.begin(), b.effect_state.end(), 0.0);
      b.run(*config.model, select_rollout(*config.model));
      for (std::uint32_t l = 0; l < 16; ++l) {
        EXPECT_LE(std::abs(b.final_effect[l]), 0.15 + 1e-12);
        EXPECT_LT(std::abs(b.final_state[16 + l]), 100.0);
      }
    }
}

TEST(Body, PayloadAndTiltAreTheConfigurationsOwn) {
  for (const tiller_model_t* model : all_models()) {
    tiller::Config with = plain_config(model), plain = plain_config(model);
    add_effect(with, tiller_effect_payload, 0);
    add_effect(with, tiller_effect_tilt, 0);
    add_effect(plain, tiller_effect_payload, 0);
    add_effect(plain, tiller_effect_tilt, 0);
    plain.body.payload_kg = 0.3;
    plain.body.gravity_x_m_s2 = 9.81 * std::sin(0.2);
    plain.body.gravity_z_m_s2 = -9.81 * std::cos(0.2);
    for (Isa isa : all_isas()) {
      Batch<double> a(with, 16, 20), b(plain, 16, 20);
      a.set_param(model->param_count, 0.3);
      a.set_param(model->param_count + 1, 0.2);
      b.set_param(model->param_count, 0.0);
      b.set_param(model->param_count + 1, 0.0);
      a.run(*model, select_rollout(*model, isa));
      b.run(*model, select_rollout(*model, isa));
      for (std::size_t i = 0; i < a.final_state.size(); ++i)
        EXPECT_NEAR(a.final_state[i], b.final_state[i], 1e-9 * (1 + std::abs(b.final_state[i]))) << model->name;
    }
  }
}

TEST(Sensor, EffectsComposeInTheirOrder) {
  tiller::Config c = plain_config(tiller_find_model("pendulum"));
  c.measurement_count = 2;
  c.measured_state[0] = 1;
  c.measured_state[1] = 0;
  const double params[] = {1, 1, 1, 0.5, 0.1};
  EXPECT_EQ(measured_value(c, params, 0, {2.0}), 2.0);
  add_effect(c, tiller_effect_sensor_bias, 0);
  EXPECT_TRUE(has_sensor_effects(c));
  add_effect(c, tiller_effect_sensor_scale, 0);
  EXPECT_EQ(measured_value(c, params, 0, {2.0}), 2.0);  // of the rate: no effect there
  EXPECT_NEAR(measured_value(c, params, 1, {2.0}), 1.1 * (2.0 + 0.5), 1e-15);
  EXPECT_NEAR(state_of_measured(c, params, 0, 2.75), 2.0, 1e-15);
}

TEST(Sensor, AnEccentricEncoderReadsTooFarWithThePosition) {
  tiller::Config c = plain_config(tiller_find_model("pendulum"));
  c.measurement_count = 1;
  add_effect(c, tiller_effect_sensor_scale, 0);
  add_effect(c, tiller_effect_encoder_eccentricity, 0);
  const double params[] = {1, 1, 1, 0.1, 0.05, -0.08, 2.5};
  const auto read = [&](double x) {
    const double scaled = 1.1 * x, a = 2 * M_PI * scaled / 2.5;
    return scaled + 0.05 * std::cos(a) - 0.08 * std::sin(a);
  };
  for (const double x : {-3.0, -0.4, 0.0, 0.7, 4.2}) {
    EXPECT_NEAR(measured_value(c, params, 0, {x}), read(x), 1e-14);
    EXPECT_NEAR(measurement_map(c, 0, {x}, params).gain, (read(x + 1e-6) - read(x - 1e-6)) / 2e-6, 1e-8);
    EXPECT_NEAR(state_of_measured(c, params, 0, read(x)), x, 1e-14);
  }
}

// Along a motion of constant acceleration: exact by the path, at any delay, and by the derivatives.
TEST(Sensor, ALateReadingIsOfTheStateBefore) {
  tiller::Config c = plain_config(tiller_find_model("pendulum"));
  c.measurement_count = 2;
  c.measured_state[0] = 0;
  c.measured_state[1] = 1;
  add_effect(c, tiller_effect_sensor_scale, 0);
  add_effect(c, tiller_effect_sensor_delay, 0);
  add_effect(c, tiller_effect_sensor_delay, 1);
  constexpr double kPeriod_s = 0.01, kA = 30.0, kV = -2.0, kX = 0.4;
  const auto x = [](double t) { return kX + kV * t + 0.5 * kA * t * t; };
  const auto v = [](double t) { return kV + kA * t; };
  double path[2 * 12];
  for (int k = 0; k < 12; ++k) path[2 * k] = x(k * kPeriod_s), path[2 * k + 1] = v(k * kPeriod_s);
  for (const double late : {0.0, 0.003, 0.01, 0.0471}) {
    const double params[] = {1, 1, 1, 0.1, late, 0.5 * late};
    EXPECT_NEAR(tiller::reading_on_path(c, params, 0, path, 9, kPeriod_s), 1.1 * x(0.09 - late), 1e-12);
    EXPECT_NEAR(tiller::reading_on_path(c, params, 1, path, 9, kPeriod_s), v(0.09 - 0.5 * late), 1e-12);
    const double* const now = path + 2 * 9;
    const auto place = tiller::sight_of(*c.model, 0, now, 1, now - 2, 1, kPeriod_s);
    const auto speed = tiller::sight_of(*c.model, 1, now, 1, now - 2, 1, kPeriod_s);
    EXPECT_NEAR(measured_value(c, params, 0, place), 1.1 * x(0.09 - late), 1e-12);
    EXPECT_NEAR(measured_value(c, params, 1, speed), v(0.09 - 0.5 * late), 1e-12);
  }
  const double before[] = {1, 1, 1, 0.0, 0.13, 0.11};
  EXPECT_NEAR(tiller::reading_on_path(c, before, 0, path, 9, kPeriod_s), x(-0.04), 1e-12) << "as at the first row";
  EXPECT_NEAR(tiller::reading_on_path(c, before, 1, path, 9, kPeriod_s), v(-0.02), 1e-12);
}

// A torque that swings: the joint turns round several times, within steps. Against a reference at a microsecond.
TEST(DryFriction, IsSecondOrderThroughReversals) {
  const auto error = [](tiller_effect_kind_t kind, const std::vector<double>& params, std::uint32_t substeps) {
    Rotor r;
    r.config.substeps = substeps;
    add_effect(r.config, kind, 0);
    Batch<double> b = r.run(params, 1.0, 0.0, 100);
    for (std::uint32_t k = 0; k < 100; ++k)
      for (std::uint32_t l = 0; l < 16; ++l) b.controls[k * 16 + l] = 0.9 * std::sin(0.23 * k);
    b.run(*r.config.model, select_rollout(*r.config.model));
    double v = 1.0, worst = 0.0;
    constexpr double kDt = 1e-6;
    for (std::uint32_t k = 0; k < 100; ++k) {
      for (int i = 0; i < 20000; ++i) {
        const double free = v + kDt * 0.9 * std::sin(0.23 * k) / Rotor::kInertia;
        const double ratio = params.size() > 2 ? v / params[2] : 0.0;
        double level = params[0] + (params.size() > 2 ? params[1] * std::exp(-ratio * ratio) : 0.0);
        if (kind == tiller_effect_asymmetric_friction && v < 0.0) level = params[1];
        const double most = kDt * level / Rotor::kInertia;
        v = std::abs(free) < most ? 0.0 : free - std::copysign(most, free);
      }
      worst = std::max(worst, std::abs(v - Rotor::rate(b, k + 1)));
    }
    return worst;
  };
  for (const auto& [kind, params] : {std::pair{tiller_effect_coulomb_friction, std::vector<double>{0.3}},
                                     std::pair{tiller_effect_asymmetric_friction, std::vector<double>{0.3, 0.15}},
                                     std::pair{tiller_effect_stribeck_friction, std::vector<double>{0.2, 0.2, 0.5}}}) {
    // first order would be level dt / J = 0.019 at each of the reversals; the reference itself is good to 1e-6
    const bool bends = kind == tiller_effect_stribeck_friction;
    EXPECT_LT(error(kind, params, 1), bends ? 1e-3 : 1e-5) << effect_info(kind).name;
    EXPECT_LT(error(kind, params, 4), bends ? 6e-5 : 1e-5) << effect_info(kind).name;
  }
}

TEST(ConstantOffset, AcceleratesSteadily) {
  Rotor r;
  add_effect(r.config, tiller_effect_constant_offset, 0);
  const auto b = r.run(-0.25, 0.0, 0.0, 50);
  EXPECT_NEAR(Rotor::rate(b, 50), -0.25 / Rotor::kInertia, 1e-12);
}

TEST(ActuatorLag, StepResponse) {
  Rotor r;
  add_effect(r.config, tiller_effect_actuator_lag, 0);
  const double lag = 0.07, torque = 0.9;
  const auto b = r.run(lag, 0.0, torque, 50);
  EXPECT_NEAR(b.final_effect[0], torque * (1 - std::exp(-1.0 / lag)), 1e-12);
  for (std::uint32_t step : {1u, 5u, 50u}) {
    const double t = step * 0.02;  // rate = torque / J (t - T (1 - e^(-t/T))): exact, the mean over each step acts
    EXPECT_NEAR(Rotor::rate(b, step), torque / Rotor::kInertia * (t - lag * (1 - std::exp(-t / lag))), 1e-12);
  }
}

TEST(InputDelay, ShiftsTheCommandByAnyFraction) {
  for (double delay : {0.006, 0.02, 0.05, 0.033, 0.1})
    for (std::uint32_t substeps : {1u, 3u}) {
      Rotor r;
      r.config.integrator = tiller_integrator_rk4;
      r.config.substeps = substeps;
      add_effect(r.config, tiller_effect_input_delay, 0);
      const double torque = 0.9;
      const auto b = r.run(delay, 0.0, torque, 50);
      for (std::uint32_t step : {1u, 2u, 3u, 5u, 20u}) {
        const double t = step * 0.02, gone = std::max(0.0, t - delay), rate = torque / Rotor::kInertia * gone;
        EXPECT_NEAR(Rotor::rate(b, step), rate, 1e-12) << delay << " step " << step;
        EXPECT_NEAR(Rotor::angle(b, step), 0.3 + 0.5 * rate * gone, 1e-12) << delay << " step " << step;
      }
    }
}

// Every lane and every input with a delay of its own, against commands shifted on a grid twenty times as fine.
TEST(InputDelay, IsTheShiftedCommandLaneByLane) {
  constexpr std::uint32_t kSteps = 12, kFine = 20, kLanes = 16;
  for (const char* name : {"cart_pole", "planar_quadrotor"})
    for (std::uint32_t substeps : {1u, 10u}) {
      tiller::Config config = plain_config(tiller_find_model(name)), fine = config;
      const std::uint32_t nu = config.model->input_count, first = config.param_count;
      config.integrator = fine.integrator = tiller_integrator_rk4;
      config.substeps = substeps;
      fine.period_s = config.period_s / kFine;
      for (std::uint32_t i = 0; i < nu; ++i) add_effect(config, tiller_effect_input_delay, i);
      Batch<double> a(config, kLanes, kSteps), b(fine, kLanes, kSteps * kFine);
      const auto shift = [](std::uint32_t i, std::uint32_t l) { return static_cast<int>((7 * l + 3 * i) % 47); };
      for (std::uint32_t l = 0; l < kLanes; ++l)
        for (std::uint32_t i = 0; i < nu; ++i) {
          a.params[(first + i) * kLanes + l] = shift(i, l) * fine.period_s;
          for (int k = 0; k < static_cast<int>(kSteps * kFine); ++k) {
            const int at = k - shift(i, l), step = at >= 0 ? at / int{kFine} : -1 - (-at - 1) / int{kFine};
            b.controls[(static_cast<std::uint32_t>(k) * nu + i) * kLanes + l] =
                step >= 0 ? a.controls[(static_cast<std::uint32_t>(step) * nu + i) * kLanes + l]
                          : a.history[static_cast<std::uint32_t>(-step - 1) * nu + i];
          }
        }
      b.state = a.state;
      std::copy_n(a.params.begin(), first * kLanes, b.params.begin());
      a.run(*config.model, select_rollout(*config.model));
      b.run(*fine.model, select_rollout(*fine.model));
      // what is left is the integrator's: h^5 a step of 20 ms or 2 ms
      const double tolerance = substeps == 1 ? 2e-5 : 1e-8;
      for (std::size_t i = 0; i < a.final_state.size(); ++i)
        EXPECT_NEAR(a.final_state[i], b.final_state[i], tolerance) << name << " " << substeps << " lane " << i % kLanes;
    }
}

TEST(InputDelay, ReadsTheHistoryOfCommands) {
  Rotor r;
  add_effect(r.config, tiller_effect_input_delay, 0);
  Batch<double> b(r.config, 16, 3);
  b.set_param(0, 0.5);
  b.set_param(1, 0.8);
  b.set_param(2, 0.0);
  b.set_param(3, 0.04);  // two periods
  std::fill(b.state.begin(), b.state.end(), 0.0);
  const double past[] = {0.7, -0.2};  // one and two periods ago
  b.history[0] = past[0];
  b.history[1] = past[1];
  b.run(*r.config.model, select_rollout(*r.config.model));
  const double gain = 0.02 / Rotor::kInertia;
  EXPECT_NEAR(Rotor::rate(b, 1), past[1] * gain, 1e-14);
  EXPECT_NEAR(Rotor::rate(b, 2), (past[1] + past[0]) * gain, 1e-14);
  EXPECT_NEAR(Rotor::rate(b, 3), (past[1] + past[0] + b.controls[0]) * gain, 1e-14);
}

// Friction at the cart's joint must act through the whole mechanism: momentum along the rail is kept but for friction.
TEST(Friction, GoesThroughTheModelsOwnInertia) {
  const tiller_model_t& m = *tiller_find_model("cart_pole");
  tiller::Config config = plain_config(&m);
  config.substeps = 64;
  config.body.gravity_z_m_s2 = 0.0;
  add_effect(config, tiller_effect_viscous_friction, 0);
  Batch<double> b(config, 16, 50);
  std::fill(b.controls.begin(), b.controls.end(), 0.0);
  const double damping = 0.3;
  b.set_param(3, damping);
  b.run(m, select_rollout(m));
  for (std::uint32_t l = 0; l < 16; ++l) {
    const double cart = b.params[l], pole = b.params[16 + l], half = b.params[32 + l];
    const auto at = [&](std::uint32_t step, int i) { return b.trajectory[(step * 4 + i) * 16 + l]; };
    const auto momentum = [&](std::uint32_t k) {
      return (cart + pole) * at(k, 2) + pole * half * std::cos(at(k, 1)) * at(k, 3);
    };
    const double lost = damping * (at(50, 0) - at(0, 0));  // integral of damping * velocity, exactly
    EXPECT_NEAR(momentum(50) - momentum(0), -lost, 2e-4 * (1.0 + std::abs(lost)));  // first order at 0.3 ms
  }
}

}  // namespace
}  // namespace tiller
