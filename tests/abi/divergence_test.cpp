// cost.demonstration_divergence = kl: the formula against an integral, the rows that planners see against the
// covariances that were predicted, a plan against dense least squares, and what either direction of a divergence does.

#include "executive/demonstration_divergence.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "abi/controller.hpp"
#include "rig.hpp"

namespace {

using tiller::gaussian_divergence;

// ---- the formula --------------------------------------------------------------------------------

/// Upper root W of the inverse of a covariance of two: W' W = S^-1.
std::vector<double> root_of(double a, double b, double c) {  // S = [a b; b c]
  const double det = a * c - b * b, p00 = c / det, p01 = -b / det, p11 = a / det;
  const double w00 = std::sqrt(p00), w01 = p01 / w00;
  return {w00, w01, 0.0, std::sqrt(p11 - w01 * w01)};
}

double divergence(const std::vector<double>& root, const std::vector<double>& covariance, const double* d) {
  double r[4], rest = 0.0, work[12];
  EXPECT_TRUE(gaussian_divergence(2, root.data(), covariance.data(), r, &rest, work));
  const double z0 = r[0] * d[0] + r[1] * d[1], z1 = r[2] * d[0] + r[3] * d[1];
  return 0.5 * (z0 * z0 + z1 * z1) + rest;
}

double log_density(const double* s, double x, double y) {
  const double det = s[0] * s[2] - s[1] * s[1];
  return -0.5 * (s[2] * x * x - 2.0 * s[1] * x * y + s[0] * y * y) / det - 0.5 * std::log(det) - 1.8378770664093453;
}

TEST(GaussianDivergence, is_the_integral_that_defines_it) {
  const double s[3] = {0.5, 0.2, 0.3}, p[3] = {1.2, -0.4, 0.6}, mean[2] = {0.7, -0.3};  // of the prediction
  // trapezoids over eight deviations: for such a function exact to rounding
  double sum = 0.0;
  constexpr double kStep = 0.02;
  for (double x = -6.0; x <= 6.0; x += kStep)
    for (double y = -5.0; y <= 5.0; y += kStep) {
      const double q = log_density(s, x, y);
      sum += std::exp(q) * (q - log_density(p, x - mean[0], y - mean[1])) * kStep * kStep;
    }
  const double found = divergence(root_of(s[0], s[1], s[2]), {p[0], p[1], p[1], p[2]}, mean);
  EXPECT_NEAR(found, sum, 1e-9);
  const double back = divergence(root_of(p[0], p[1], p[2]), {s[0], s[1], s[1], s[2]}, mean);
  EXPECT_GT(std::fabs(back - found), 0.1) << "the other direction is another number";
}

TEST(GaussianDivergence, of_one_dimension_is_written_in_every_book_and_is_zero_between_equals) {
  for (const double s : {0.1, 1.0, 7.0})
    for (const double p : {0.2, 1.0, 3.0}) {
      const double root = 1.0 / s, covariance = p * p, d = 0.4;
      double r = 0.0, rest = 0.0, work[3];
      ASSERT_TRUE(gaussian_divergence(1, &root, &covariance, &r, &rest, work));
      EXPECT_NEAR(0.5 * r * r * d * d + rest, std::log(p / s) + (s * s + d * d) / (2.0 * p * p) - 0.5, 1e-12);
      if (s == p) {
        EXPECT_NEAR(rest, 0.0, 1e-12);
      }
    }
}

/// Inverse and determinant of a matrix of three, by cofactors.
double invert_three(const double* m, double* inverse) {
  const auto minor_of = [&](int r, int c) {
    const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
    return m[3 * r1 + c1] * m[3 * r2 + c2] - m[3 * r1 + c2] * m[3 * r2 + c1];
  };
  const double det = m[0] * minor_of(0, 0) + m[1] * minor_of(0, 1) + m[2] * minor_of(0, 2);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) inverse[3 * c + r] = minor_of(r, c) / det;
  return det;
}

TEST(GaussianDivergence, of_three_dimensions_is_the_formula) {
  const double root[9] = {1.5, 0.4, -0.3, 0.0, 0.8, 0.6, 0.0, 0.0, 2.0};
  const double p[9] = {2.0, 0.6, -0.4, 0.6, 1.5, 0.5, -0.4, 0.5, 1.1}, d[3] = {0.4, -0.7, 0.2};
  double precision[9], s[9], p_inverse[9], r[9], rest = 0.0, work[27];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      precision[3 * i + j] = 0.0;
      for (int k = 0; k < 3; ++k) precision[3 * i + j] += root[3 * k + i] * root[3 * k + j];
    }
  const double ratio = invert_three(precision, s) * invert_three(p, p_inverse);
  double expected = -3.0 + std::log(ratio);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) expected += p_inverse[3 * i + j] * (s[3 * j + i] + d[i] * d[j]);
  ASSERT_TRUE(gaussian_divergence(3, root, p, r, &rest, work));
  double square = 0.0;
  for (int i = 0; i < 3; ++i) {
    double z = 0.0;
    for (int j = 0; j < 3; ++j) z += r[3 * i + j] * d[j];
    square += z * z;
  }
  EXPECT_NEAR(0.5 * square + rest, 0.5 * expected, 1e-12);
}

TEST(GaussianDivergence, refuses_what_is_no_covariance) {
  const double root[4] = {1.0, 2.0, 0.0, 1.0}, flat[4] = {1.0, 2.0, 2.0, 4.0}, good[4] = {1.0, 0.0, 0.0, 1.0};
  const double singular[4] = {1.0, 2.0, 0.0, 0.0}, bad[4] = {NAN, 0.0, 0.0, 1.0};
  double r[4] = {5.0, 5.0, 5.0, 5.0}, rest = 3.0, work[12];
  EXPECT_FALSE(gaussian_divergence(2, root, flat, r, &rest, work));
  EXPECT_FALSE(gaussian_divergence(2, singular, good, r, &rest, work));
  EXPECT_FALSE(gaussian_divergence(2, root, bad, r, &rest, work));
  EXPECT_EQ(rest, 3.0);
  EXPECT_EQ(r[0], 5.0);
}

// ---- in a controller ----------------------------------------------------------------------------

/// 1.5 kg on a straight axis, both states measured; the runtime's parameters are the true ones.
class AxisPlant : public rig::Plant {
 public:
  double x = 0.0, v = 0.0;
  void step(const double* command, double time_s) override {
    x += time_s * (v + 0.5 * time_s * command[0] / 1.5);
    v += time_s * command[0] / 1.5;
  }
  void measure(double* value) const override {
    value[0] = x;
    value[1] = v;
  }
};

constexpr std::uint32_t kHorizon = 15, kRows = 60;
constexpr double kPeriod_s = 0.02;

struct Rows {
  std::vector<double> mean, root;
  /// A ramp to 1 m and rest there, as far off as `sd`.
  Rows(double position_sd, double velocity_sd) {
    for (std::uint32_t k = 0; k < kRows; ++k) {
      const double share = std::fmin(k / 40.0, 1.0);
      mean.insert(mean.end(), {share, k < 40 ? 1.25 : 0.0});
      const auto w = root_of(position_sd * position_sd, 0.3 * position_sd * velocity_sd, velocity_sd * velocity_sd);
      root.insert(root.end(), w.begin(), w.end());
    }
  }
};

tiller::Config axis_config(const Rows& rows, std::uint32_t divergence) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("linear_axis")), tiller_status_ok);
  c.period_s = kPeriod_s;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.priors[0] = {tiller_prior_fixed, 0, 1.5, 0.0, -INFINITY, INFINITY};
  c.measurement_sd[0] = 0.002;
  c.measurement_sd[1] = 0.02;
  c.process_sd[1] = 0.3;
  c.planner.kind = tiller_planner_ilqr;
  c.planner.shooting = tiller_shooting_single;
  c.planner.horizon = kHorizon;
  c.planner.particles = 1;
  c.planner.iterations = 10;
  c.cost.input_weight[0] = 0.01;
  c.cost.demonstration_mean = rows.mean.data();
  c.cost.demonstration_root = rows.root.data();
  c.cost.demonstration_steps = kRows;
  c.cost.demonstration_weight = 2.0;
  c.cost.demonstration_divergence = divergence;
  c.safety.input_low[0] = -500.0;
  c.safety.input_high[0] = 500.0;
  c.safety.input_rate_per_s[0] = INFINITY;
  c.safety.frozen_ticks = 0;
  return c;
}

struct Controlled {
  Controlled(const Rows& rows, std::uint32_t divergence) : Controlled(axis_config(rows, divergence)) {}
  explicit Controlled(const tiller::Config& config) : loop(config, plant) { EXPECT_TRUE(loop.ready()); }
  const tiller::Executive& executive() { return *loop.controller()->executive; }
  const double* root(std::size_t row) { return executive().config().cost.demonstration_root + 4 * row; }
  std::vector<double> plan() {
    std::vector<double> u(kHorizon);
    EXPECT_EQ(tiller_get_plan(loop.controller(), u.data(), kHorizon), kHorizon);
    return u;
  }
  AxisPlant plant;
  rig::Loop loop;
};

/// P^-1 of a covariance of two.
void invert(const double* p, double* inverse) {
  const double det = p[0] * p[3] - p[1] * p[2];
  inverse[0] = p[3] / det;
  inverse[1] = -p[1] / det;
  inverse[2] = -p[2] / det;
  inverse[3] = p[0] / det;
}

/// R' R.
void square_of(const double* r, double* s) {
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j) s[2 * i + j] = r[i] * r[j] + r[2 + i] * r[2 + j];
}

TEST(DemonstrationDivergence, rows_are_roots_of_the_inverse_predicted_covariance) {
  const Rows rows(0.1, 0.5);
  Controlled c(rows, tiller_divergence_kl);
  c.loop.activate(1);
  ASSERT_TRUE(c.executive().prediction().made());
  EXPECT_EQ(std::memcmp(c.root(0), rows.root.data(), rows.root.size() * sizeof(double)), 0)
      << "before a first plan the demonstration's own";
  for (int tick = 0; tick < 70; ++tick) {
    const std::uint64_t from = c.executive().prediction().task_step();
    std::vector<double> predicted(c.executive().prediction().covariance(0),
                                  c.executive().prediction().covariance(kHorizon + 1));
    (void)c.loop.tick();
    const std::uint64_t at = c.executive().prediction().task_step();
    ASSERT_EQ(at, from + 1);
    double given[4], demonstrated[4], expected[4], found[4], last[4] = {};
    square_of(rows.root.data(), given);
    invert(given, demonstrated);
    std::uint32_t left = 0;
    for (std::uint32_t k = 0; k <= kHorizon; ++k) {
      const double* p = predicted.data() + 4 * std::min(k + 1, kHorizon);
      double wide[4];
      for (int i = 0; i < 4; ++i) wide[i] = p[i] + 0.01 * demonstrated[i];
      if (at + k >= kRows - 1) {
        for (int i = 0; i < 4; ++i) last[i] += wide[i];
        ++left;
        continue;
      }
      invert(wide, expected);
      square_of(c.root(at + k), found);
      for (int i = 0; i < 4; ++i) ASSERT_NEAR(found[i], expected[i], 1e-9 * std::fabs(expected[0])) << tick << " " << k;
    }
    if (left > 0) {
      for (double& x : last) x /= left;
      invert(last, expected);
      square_of(c.root(kRows - 1), found);
      for (int i = 0; i < 4; ++i) ASSERT_NEAR(found[i], expected[i], 1e-9 * std::fabs(expected[0])) << tick;
    }
    // rows that are over are as they were given
    const std::size_t over = std::min<std::size_t>(at, kRows - 1);
    ASSERT_EQ(std::memcmp(c.root(0), rows.root.data(), over * 4 * sizeof(double)), 0) << tick;
  }
  // a new motion begins with the demonstration
  ASSERT_EQ(tiller_disarm(c.loop.controller()), tiller_status_ok);
  c.loop.run(2);
  c.loop.activate(1);
  EXPECT_EQ(std::memcmp(c.root(0), rows.root.data(), rows.root.size() * sizeof(double)), 0);
}

/// min over u of sum_k w/2 |R_k (x_k - m_k)|^2 + r u^2, by normal equations and elimination.
std::vector<double> least_squares(Controlled& c, const Rows& rows, std::uint64_t step, const double* start) {
  const double w = 2.0, r = 0.01, gain = kPeriod_s / 1.5;
  std::vector<double> h(kHorizon * kHorizon, 0.0), g(kHorizon, 0.0);
  for (std::uint32_t k = 0; k <= kHorizon; ++k) {
    const std::size_t row = std::min<std::size_t>(step + k, kRows - 1);
    double s[4];
    square_of(c.root(row), s);
    const double d[2] = {start[0] + k * kPeriod_s * start[1] - rows.mean[2 * row], start[1] - rows.mean[2 * row + 1]};
    // what input i does to position and velocity at k
    const auto effect = [&](std::uint32_t i, double* e) {
      e[0] = i < k ? gain * kPeriod_s * (k - i - 0.5) : 0.0;
      e[1] = i < k ? gain : 0.0;
    };
    for (std::uint32_t i = 0; i < k; ++i) {
      double a[2], b[2];
      effect(i, a);
      const double sa[2] = {s[0] * a[0] + s[1] * a[1], s[2] * a[0] + s[3] * a[1]};
      g[i] += w * (sa[0] * d[0] + sa[1] * d[1]);
      for (std::uint32_t j = 0; j < k; ++j) {
        effect(j, b);
        h[i * kHorizon + j] += w * (sa[0] * b[0] + sa[1] * b[1]);
      }
    }
  }
  for (std::uint32_t i = 0; i < kHorizon; ++i) h[i * kHorizon + i] += 2.0 * r;
  std::vector<double> u(kHorizon);
  for (std::uint32_t p = 0; p < kHorizon; ++p)
    for (std::uint32_t i = p + 1; i < kHorizon; ++i) {
      const double factor = h[i * kHorizon + p] / h[p * kHorizon + p];
      for (std::uint32_t j = p; j < kHorizon; ++j) h[i * kHorizon + j] -= factor * h[p * kHorizon + j];
      g[i] -= factor * g[p];
    }
  for (std::uint32_t i = kHorizon; i-- > 0;) {
    double sum = -g[i];
    for (std::uint32_t j = i + 1; j < kHorizon; ++j) sum -= h[i * kHorizon + j] * u[j];
    u[i] = sum / h[i * kHorizon + i];
  }
  return u;
}

TEST(DemonstrationDivergence, a_linear_robots_plan_is_that_of_dense_least_squares) {
  const Rows rows(0.05, 0.3);
  for (const std::uint32_t divergence : {tiller_divergence_cross_entropy, tiller_divergence_kl}) {
    tiller::Config config = axis_config(rows, divergence);
    config.planner.predict_spread = 1;  // and with it, of either, where the plan begins
    Controlled c(config);
    c.plant.x = 0.2;
    c.loop.activate(1);
    for (int tick = 0; tick < 55; ++tick) {
      (void)c.loop.tick();
      const tiller::Prediction& p = c.executive().prediction();
      const std::vector<double> u = c.plan(), exact = least_squares(c, rows, p.task_step(), p.mean(0));
      double most = 1.0;
      for (const double x : exact) most = std::fmax(most, std::fabs(x));
      // the sequence is of floats, and so is the state that the plan begins with
      for (std::uint32_t k = 0; k < kHorizon; ++k) ASSERT_NEAR(u[k], exact[k], 2e-4 * most) << tick << " " << k;
    }
  }
}

/// The plan's cost, summed up from the definition along its own motion.
TEST(DemonstrationDivergence, the_plans_cost_is_the_divergence) {
  const Rows rows(0.1, 0.5);
  Controlled c(rows, tiller_divergence_kl);
  c.plant.x = 0.1;
  c.loop.activate(1);
  for (int tick = 0; tick < 65; ++tick) {
    (void)c.loop.tick();
    const tiller::Prediction& p = c.executive().prediction();
    const std::vector<double> u = c.plan();
    double x = p.mean(0)[0], v = p.mean(0)[1], cost = 0.0;
    for (std::uint32_t k = 0; k <= kHorizon; ++k) {
      const std::size_t row = std::min<std::size_t>(p.task_step() + k, kRows - 1);
      double precision[4], covariance[4], given[4], demonstrated[4];
      square_of(c.root(row), precision);
      invert(precision, covariance);
      square_of(rows.root.data() + 4 * row, given);
      invert(given, demonstrated);
      const double d[2] = {x - rows.mean[2 * row], v - rows.mean[2 * row + 1]};
      double divergence = -2.0;
      for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) divergence += precision[2 * i + j] * (demonstrated[2 * j + i] + d[i] * d[j]);
      divergence += std::log((covariance[0] * covariance[3] - covariance[1] * covariance[2]) /
                             (demonstrated[0] * demonstrated[3] - demonstrated[1] * demonstrated[2]));
      EXPECT_GE(divergence, -1e-9) << "a divergence";
      cost += 2.0 * 0.5 * divergence;
      if (k == kHorizon) break;
      cost += 0.01 * u[k] * u[k];
      x += kPeriod_s * (v + 0.5 * kPeriod_s * u[k] / 1.5);
      v += kPeriod_s * u[k] / 1.5;
    }
    EXPECT_NEAR(c.loop.info().plan_cost, cost, 2e-3 * (1.0 + std::fabs(cost))) << tick;  // floats, squared and weighed
  }
}

/// How far the axis is from the demonstration in the first 40 periods, root of the mean square.
double off(const Rows& rows, std::uint32_t divergence, double process_sd) {
  tiller::Config config = axis_config(rows, divergence);
  config.process_sd[1] = process_sd;
  config.measurement_sd[0] = 1e-3 + 0.03 * process_sd;
  config.measurement_sd[1] = 1e-2 + 0.3 * process_sd;
  config.cost.input_weight[0] = 1.0;
  Controlled c(config);
  c.loop.activate(1);
  double sum = 0.0;
  for (std::uint32_t k = 0; k < 40; ++k) {
    (void)c.loop.tick();
    sum += std::pow(c.plant.x - rows.mean[2 * std::min(k + 1, kRows - 1)], 2.0);
  }
  return std::sqrt(sum / 40.0);
}

/// The cross-entropy weighs by how closely the demonstrations agree, whatever is known of the robot; kl by how sure the
/// prediction is. The two change places.
TEST(DemonstrationDivergence, each_direction_weighs_by_the_other_distribution) {
  const Rows broad(0.5, 3.0), narrow(0.01, 0.06);
  const double sure = 0.01, unsure = 5.0;
  const double broad_ce = off(broad, tiller_divergence_cross_entropy, sure),
               broad_kl = off(broad, tiller_divergence_kl, sure);
  const double narrow_ce = off(narrow, tiller_divergence_cross_entropy, unsure),
               narrow_kl = off(narrow, tiller_divergence_kl, unsure);
  std::printf("broad demonstration, sure prediction: %.4f m off by cross-entropy, %.4f m by kl\n", broad_ce, broad_kl);
  std::printf("narrow demonstration, unsure prediction: %.4f m off by cross-entropy, %.4f m by kl\n", narrow_ce,
              narrow_kl);
  EXPECT_LT(broad_kl, 0.7 * broad_ce);
  EXPECT_LT(narrow_ce, 0.7 * narrow_kl);
}

TEST(DemonstrationDivergence, is_refused_by_name) {
  const Rows rows(0.1, 0.5);
  const auto field_of = [](const tiller::Config& c) {
    const char* field = "";
    const tiller_status_t status = tiller_config_check(&c, &field);
    EXPECT_TRUE(status == tiller_status_ok || status == tiller_status_bad_cost);
    return std::string(status == tiller_status_ok ? "" : field);
  };
  tiller::Config c = axis_config(rows, tiller_divergence_kl);
  EXPECT_EQ(field_of(c), "");
  c.cost.demonstration_weight = 0.0;
  EXPECT_EQ(field_of(c), "cost.demonstration_divergence") << "nothing to diverge from";
  c = axis_config(rows, 2);
  EXPECT_EQ(field_of(c), "cost.demonstration_divergence");
  Rows flat(0.1, 0.5);
  flat.root[4 * 7] = flat.root[4 * 7 + 1] = 0.0;  // one period says nothing of a direction
  c = axis_config(flat, tiller_divergence_kl);
  EXPECT_EQ(field_of(c), "cost.demonstration_root");
  c.cost.demonstration_divergence = tiller_divergence_cross_entropy;
  EXPECT_EQ(field_of(c), "") << "which the cross-entropy bears";
}

// ---- predictions over weighted hypotheses ---------------------------------------------------------

float zero_inputs[kHorizon] = {};
const float* no_inputs(const void*) { return zero_inputs; }

TEST(Prediction, of_weighted_hypotheses_is_that_of_likelier_ones_held_twice) {
  const Rows rows(0.1, 0.5);
  tiller::Config c = axis_config(rows, tiller_divergence_kl);
  c.planner.particles = 4;
  tiller::StepSetup setup;
  ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  tiller::PlannerTable planner{};
  planner.sequence = no_inputs;
  tiller::StateSpread spread;
  spread.states = 2;
  spread.covariance[0] = spread.covariance[3] = 0.01;
  spread.process[3] = 0.002;
  std::fill(spread.sensor_variance, spread.sensor_variance + TILLER_MAX_STATES, HUGE_VAL);
  // two states each of four hypotheses, the last two alike; as three, the last of which weighs twice
  const float mass[4] = {1.0f, 1.5f, 2.0f, 2.0f}, weight[3] = {0.25f, 0.25f, 0.5f};
  const float four[8] = {0.0f, 0.1f, 0.4f, 0.4f, 1.0f, 2.0f, -1.0f, -1.0f},
              three[6] = {0.0f, 0.1f, 0.4f, 1.0f, 2.0f, -1.0f};
  tiller::Belief alike, weighted;
  alike.count = 4;
  weighted.count = 3;
  alike.params = weighted.params = mass;
  alike.state = four;
  weighted.state = three;
  weighted.weight = weight;
  alike.spread = weighted.spread = &spread;
  const auto predict = [&](const tiller::Belief& belief, tiller::Prediction& p, rig::Block& block) {
    tiller::Arena arena(block.memory(), block.size());
    p.lay_out(arena, c, setup, table);
    ASSERT_TRUE(arena.fits());
    p.predict(belief, planner, nullptr, 0);
  };
  tiller::Arena measure;
  tiller::Prediction().lay_out(measure, c, setup, table);
  rig::Block one(measure.used()), other(measure.used());
  tiller::Prediction a, b;
  predict(alike, a, one);
  predict(weighted, b, other);
  EXPECT_NEAR(a.mean(0)[0], 0.225, 1e-7);
  for (std::uint32_t k = 0; k <= kHorizon; ++k) {
    for (int i = 0; i < 2; ++i) {
      EXPECT_NEAR(a.mean(k)[i], b.mean(k)[i], 1e-12);
      EXPECT_NEAR(a.sd(k)[i], b.sd(k)[i], 1e-12);
      EXPECT_NEAR(a.covariance(k)[3 * i], a.sd(k)[i] * a.sd(k)[i], 1e-12);
    }
    for (int i = 0; i < 4; ++i) EXPECT_NEAR(a.covariance(k)[i], b.covariance(k)[i], 1e-12);
  }
}

TEST(Prediction, counts_the_force_that_is_not_known) {
  const Rows rows(0.1, 0.5);
  tiller::Config c = axis_config(rows, tiller_divergence_kl);
  c.planner.particles = 2;
  tiller::StepSetup setup;
  ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  const std::uint32_t row = c.param_count;
  setup.effects[setup.effect_count++] = {tiller_effect_constant_offset, 0, static_cast<std::uint16_t>(row), 0};
  setup.fading = 1;
  setup.fading_param = row;
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  tiller::PlannerTable planner{};
  planner.sequence = no_inputs;
  constexpr double kSd_N = 0.7, kSize_N = 1.1, kKept = 0.8;
  tiller::StateSpread spread;
  spread.states = 2;
  std::fill(spread.sensor_variance, spread.sensor_variance + TILLER_MAX_STATES, HUGE_VAL);
  spread.forces = 1;
  spread.force_kept = kKept;
  spread.force_sd[0] = kSd_N;
  spread.force_size[0] = kSize_N;
  // both hypotheses alike, so that nothing but the force is not known; a mean force has no say in the spread
  const float mass = 1.5f;
  std::vector<float> params(std::size_t{row + 4} * 2, mass), state(4, 0.0f);
  params[2 * row] = params[2 * row + 1] = 0.4f;
  params[2 * row + 4] = params[2 * row + 5] = static_cast<float>(-std::log(kKept));
  for (std::uint32_t i : {2, 3, 6, 7}) params[2 * row + i] = 0.0f;  // it does not swing
  tiller::Belief belief;
  belief.count = 2;
  belief.params = params.data();
  belief.state = state.data();
  belief.spread = &spread;
  tiller::Arena measure;
  tiller::Prediction p;
  p.lay_out(measure, c, setup, table);
  rig::Block block(measure.used());
  tiller::Arena arena(block.memory(), block.size());
  p.lay_out(arena, c, setup, table);
  ASSERT_TRUE(arena.fits());
  tiller::Belief nothing = belief;
  nothing.count = 0;
  p.predict(nothing, planner, nullptr, 0);
  EXPECT_FALSE(p.made()) << "of no hypothesis";
  nothing = belief;
  nothing.spread = nullptr;
  p.predict(nothing, planner, nullptr, 0);
  EXPECT_FALSE(p.made()) << "of none that knows its spread";
  p.predict(belief, planner, nullptr, 0);
  // of unit impulses of the force: what each has made of the velocity, summed in squares
  for (std::uint32_t k = 1; k <= kHorizon; ++k) {
    double variance = 0.0;
    for (std::uint32_t from = 0; from < k; ++from) {
      double velocity = 0.0;
      for (std::uint32_t i = from; i < k; ++i) velocity += std::pow(kKept, i - from) * c.period_s / 1.5;
      const double square = from == 0 ? kSd_N * kSd_N : kSize_N * kSize_N * (1.0 - kKept * kKept);
      variance += square * velocity * velocity;
    }
    EXPECT_NEAR(p.sd(k)[1], std::sqrt(variance), 1e-6 * std::sqrt(variance)) << k;
    EXPECT_NEAR(p.covariance(k)[3], variance, 1e-5 * variance) << k;
  }
}

TEST(Prediction, counts_the_slip_that_is_not_known) {
  constexpr double kSd = 0.3, kSize = 0.5, kKept = 0.8;  // a second, of the second state alone
  tiller::Config c;
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("skid_steer")), tiller_status_ok);
  c.planner.horizon = kHorizon;
  c.planner.particles = 2;
  c.planner.predict_spread = 1;
  tiller::StepSetup setup;
  ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  setup.slip_states = 0b010;
  setup.fading = 1;
  setup.fading_param = c.param_count;
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  tiller::PlannerTable planner{};
  planner.sequence = no_inputs;
  tiller::StateSpread spread;
  spread.states = 3;
  std::fill(spread.sensor_variance, spread.sensor_variance + TILLER_MAX_STATES, HUGE_VAL);
  spread.forces = 1;
  spread.force_kept = kKept;
  spread.force_sd[0] = kSd;
  spread.force_size[0] = kSize;
  // wheels, the mean slip and its imaginary part, how fast it fades and swings: of both hypotheses
  const float fades = static_cast<float>(-std::log(kKept));
  const std::vector<float> params = {0.1f, 0.1f, 0.6f, 0.6f,  0.0f,  0.0f, 0.2f,
                                     0.2f, 0.0f, 0.0f, fades, fades, 0.0f, 0.0f},
                           state(6, 0.0f);
  tiller::Belief belief;
  belief.count = 2;
  belief.params = params.data();
  belief.state = state.data();
  belief.spread = &spread;
  tiller::Arena measure;
  tiller::Prediction p;
  p.lay_out(measure, c, setup, table);
  rig::Block block(measure.used());
  tiller::Arena arena(block.memory(), block.size());
  p.lay_out(arena, c, setup, table);
  ASSERT_TRUE(arena.fits());
  p.predict(belief, planner, nullptr, 0);
  double mean = 0.0;
  for (std::uint32_t k = 1; k <= kHorizon; ++k) {
    mean += 0.2 * c.period_s * std::pow(kKept, k - 1);
    double variance = 0.0;
    for (std::uint32_t from = 0; from < k; ++from) {
      double moved = 0.0;
      for (std::uint32_t i = from; i < k; ++i) moved += std::pow(kKept, i - from) * c.period_s;
      variance += (from == 0 ? kSd * kSd : kSize * kSize * (1.0 - kKept * kKept)) * moved * moved;
    }
    EXPECT_NEAR(p.mean(k)[1], mean, 1e-6 * mean) << k;
    EXPECT_NEAR(p.sd(k)[1], std::sqrt(variance), 1e-6 * std::sqrt(variance)) << k;
    EXPECT_EQ(p.sd(k)[0], 0.0);
    EXPECT_EQ(p.sd(k)[2], 0.0);
  }
}

}  // namespace
