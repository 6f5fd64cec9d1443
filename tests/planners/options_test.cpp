// Options of the sampling planners, against their definitions.

#include <gtest/gtest.h>

#include "planners/sampler.hpp"
#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using tiller::Sampler;

const Sampler& sampler_of(const Bench& bench) { return *static_cast<const Sampler*>(bench.planner()); }

/// One knot grid of a plan whose samples are not cut by limits.
tiller::Config wide_config(std::uint32_t planner, std::uint32_t knots) {
  tiller::Config c = line_config(planner);
  c.planner.knots = knots;
  c.planner.rollouts = 8192;
  c.safety.input_low[0] = -1e6;
  c.safety.input_high[0] = 1e6;
  return c;
}

/// Second moments (knots x knots) of the coarsest samples of 40 first iterations, in units of noise_sd.
std::vector<double> sample_moments(const tiller_config_t& c) {
  const std::uint32_t n = c.planner.knots;
  std::vector<double> sum(std::size_t{n} * n, 0.0);
  double count = 0.0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    tiller::Config one = c;
    one.seed = seed;
    one.planner.horizon = 3;
    Bench bench(one);
    bench.plan();
    const Sampler& s = sampler_of(bench);
    // the samples lie around zero, the mean of a new plan; every 16th has the whole spread, and 0 is the mean itself
    for (std::uint32_t k = tiller::kScales; k < s.rollouts; k += tiller::kScales) {
      for (std::uint32_t i = 0; i < n; ++i)
        for (std::uint32_t j = 0; j < n; ++j)
          sum[i * n + j] += static_cast<double>(s.knots[i * s.rollouts + k]) *
                            static_cast<double>(s.knots[j * s.rollouts + k]) /
                            (c.planner.noise_sd[0] * c.planner.noise_sd[0]);
      count += 1.0;
    }
  }
  for (double& x : sum) x /= count;
  return sum;
}

// 20440 samples: a standard deviation of 0.7 % of a correlation, 1 % of a variance; four of them
constexpr double kMomentError = 0.04;

TEST(NoiseColour, keeps_the_spread_of_every_knot_and_has_the_spectrum) {
  constexpr std::uint32_t kKnots = 12;
  double last_neighbours = -1.0;
  for (const double colour : {0.0, 1.0, 2.0, 4.0}) {
    tiller::Config c = wide_config(tiller_planner_cem, kKnots);
    c.planner.noise_colour = colour;
    const std::vector<double> moments = sample_moments(c);
    // the power spectrum's own sum, written out over twice the knots, the constant as strong as the slowest wave
    const auto expected = [&](std::uint32_t apart) {
      double sum = 0.0, power = 0.0;
      for (int k = -static_cast<int>(kKnots) + 1; k <= static_cast<int>(kKnots); ++k) {
        const double share = std::pow(std::max(std::abs(k), 1), -colour);
        sum += share * std::cos(3.141592653589793 * k * apart / kKnots);
        power += share;
      }
      return sum / power;
    };
    for (std::uint32_t i = 0; i < kKnots; ++i)
      for (std::uint32_t j = 0; j < kKnots; ++j)
        EXPECT_NEAR(moments[i * kKnots + j], expected(i > j ? i - j : j - i), kMomentError)
            << colour << " " << i << " " << j;
    EXPECT_GT(expected(1), last_neighbours + 0.1 * (colour < 4.0));
    last_neighbours = expected(1);
    std::printf("colour %.0f: correlation of neighbouring knots %.3f, of ends %.3f\n", colour, expected(1),
                expected(kKnots - 1));
  }
}

TEST(Filter, is_pddms_recursion_over_the_knots) {
  constexpr std::uint32_t kKnots = 6;
  constexpr double kBeta = 0.6;
  tiller::Config c = wide_config(tiller_planner_mppi, kKnots);
  c.planner.filter = kBeta;
  const std::vector<double> moments = sample_moments(c);
  for (std::uint32_t i = 0; i < kKnots; ++i)
    for (std::uint32_t j = 0; j < kKnots; ++j) {
      double expected = 0.0;  // n_t = beta sum_s (1 - beta)^(t - s) u_s
      for (std::uint32_t s = 0; s <= std::min(i, j); ++s)
        expected += kBeta * std::pow(1.0 - kBeta, i - s) * kBeta * std::pow(1.0 - kBeta, j - s);
      EXPECT_NEAR(moments[i * kKnots + j], expected, kMomentError) << i << " " << j;
    }
  c.planner.kind = tiller_planner_cem;  // which does not filter
  EXPECT_NEAR(sample_moments(c)[0], 1.0, kMomentError);
}

TEST(Cem, elites_of_equal_samples_leave_the_spread) {
  tiller::Config c = wide_config(tiller_planner_cem, 6);
  c.planner.rollouts = 8192;
  c.planner.smoothing = 0.0;
  c.planner.elite_fraction = 0.5;  // the first of equals: every scale as often as the others
  c.cost = {};
  Bench bench(c);
  bench.plan();
  for (std::uint32_t r = 0; r < 6; ++r)
    // 4096 elites on the ladder say as much as 980 of the whole spread: 2.3 %; four deviations
    EXPECT_NEAR(sampler_of(bench).spread[r], 2.0, 0.18) << r;
}

/// Deviation of every knot's samples, relative to their scales, in the last of `done` iterations of eight plans.
std::vector<double> drawn_spread(tiller::Config c, std::uint32_t done) {
  std::vector<double> sum(c.planner.knots, 0.0);
  double count = 0.0;
  c.cost = {};  // all samples are equal: random_shooting and mppi keep a mean of zero
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    c.seed = seed;
    Bench bench(c);
    bench.request.deadline.iterations = done;
    bench.plan();
    const Sampler& s = sampler_of(bench);
    for (std::uint32_t k = 2; k < s.rollouts; ++k)
      for (std::uint32_t j = 0; j < c.planner.knots; ++j) {
        const double x = static_cast<double>(s.knots[j * s.rollouts + k] - s.row_mean[j]) /
                         static_cast<double>(s.scale[k % tiller::kScales]);
        sum[j] += x * x;
      }
    count += s.rollouts - 2;
  }
  for (double& x : sum) x = std::sqrt(x / count);
  return sum;
}

/// The formula, written out for the tests' noise_sd of 2.
double annealed_sd(const tiller::Config& c, std::uint32_t iteration, std::uint32_t knot) {
  const double i = iteration, j = knot, most_i = c.planner.iterations - 1.0, most_j = c.planner.knots - 1.0;
  return 2.0 * std::exp(-c.planner.anneal_iterations * i / most_i) *
         std::exp(-c.planner.anneal_horizon * (1.0 - j / most_j));
}

TEST(Annealing, samples_have_the_spread_of_the_schedule) {
  for (const std::uint32_t kind : {tiller_planner_random_shooting, tiller_planner_mppi})
    for (const double over_iterations : {0.0, 1.5})
      for (const double over_knots : {0.0, 0.8}) {
        tiller::Config c = wide_config(kind, 6);
        c.planner.iterations = 4;
        c.planner.anneal_iterations = over_iterations;
        c.planner.anneal_horizon = over_knots;
        for (std::uint32_t i = 0; i < 4; ++i) {
          const std::vector<double> sd = drawn_spread(c, i + 1);
          // 65520 samples: a deviation of 0.28 % of a deviation; five of them, of some 200 comparisons
          for (std::uint32_t j = 0; j < 6; ++j)
            EXPECT_NEAR(sd[j] / annealed_sd(c, i, j), 1.0, 0.014) << kind << " " << i << " " << j;
        }
      }
}

TEST(Annealing, one_iteration_does_not_fall_and_a_deadline_does_not_change_the_schedule) {
  tiller::Config c = wide_config(tiller_planner_mppi, 6);
  c.planner.anneal_iterations = 3.0;
  c.planner.iterations = 1;
  EXPECT_NEAR(drawn_spread(c, 1)[0], 2.0, 0.028);
  c.planner.iterations = 5;
  EXPECT_NEAR(drawn_spread(c, 2)[0], 2.0 * std::exp(-3.0 / 4.0), 0.014 * 2.0) << "the second of five, not of two";
}

/// Elites chosen by chance leave the spread, whatever share of it they were drawn with.
TEST(Annealing, refitted_spreads_are_those_before_annealing) {
  for (const std::uint32_t adapts : {0u, 1u}) {
    tiller::Config c = wide_config(tiller_planner_cem, 6);
    c.planner.smoothing = 0.0;
    c.planner.elite_fraction = adapts ? 1.0 : 0.5;
    c.planner.adapt_covariance = adapts;
    c.planner.iterations = 3;
    c.planner.anneal_iterations = 2.0;
    c.planner.anneal_horizon = 1.0;
    c.cost = {};
    Bench bench(c);
    bench.plan();
    // three refits of 2.3 % each (980 samples' worth of the whole spread), four deviations of their sum
    for (std::uint32_t r = 0; r < 6; ++r) EXPECT_NEAR(sampler_of(bench).spread[r], 2.0, 0.32) << adapts << " " << r;
  }
}

/// Neither samples a millionth of their mean apart nor the best one of an earlier iteration are a measure of a spread.
TEST(Annealing, what_was_not_drawn_or_is_rounded_away_is_not_refitted) {
  tiller::Config c = wide_config(tiller_planner_cem, 6);
  c.planner.iterations = 8;
  c.planner.smoothing = 0.0;
  c.planner.anneal_iterations = 20.0;
  Bench bench(c);
  bench.set_state({1000.0, 0.0});  // the mean goes far from zero
  bench.plan();
  const Sampler& s = sampler_of(bench);
  EXPECT_GT(std::fabs(s.mean[0]), 1.0);
  for (std::uint32_t r = 0; r < 6; ++r) EXPECT_LT(s.spread[r], 4.0) << "either, over e^-20, would be at the ceiling";
}

TEST(Annealing, off_draws_the_same_bits_and_mcts_does_not_anneal) {
  for (const std::uint32_t kind : {tiller_planner_cem, tiller_planner_mcts}) {
    tiller::Config c = line_config(kind);
    c.planner.iterations = 3;
    Bench plain(c);
    c.planner.anneal_iterations = kind == tiller_planner_mcts ? 2.0 : 0.0;
    Bench annealed(c);
    EXPECT_EQ(plain.bytes(), annealed.bytes());
    plain.set_state({1.0, 0.0});
    annealed.set_state({1.0, 0.0});
    for (int t = 0; t < 20; ++t) {
      plain.plan();
      annealed.plan();
      ASSERT_EQ(plain.command[0], annealed.command[0]) << t;
    }
  }
}

TEST(Annealing, the_same_seed_plans_the_same_commands) {
  for (const std::uint32_t kind :
       {tiller_planner_random_shooting, tiller_planner_cem, tiller_planner_mppi, tiller_planner_hybrid}) {
    tiller::Config c = line_config(kind);
    c.planner.iterations = 4;
    const double plain = [&] {
      Bench bench(c);
      bench.set_state({1.0, 0.0});
      bench.plan();
      return bench.command[0];
    }();
    c.planner.anneal_iterations = 1.0;
    c.planner.anneal_horizon = 1.0;
    Bench one(c), other(c);
    one.set_state({1.0, 0.0});
    other.set_state({1.0, 0.0});
    for (int t = 0; t < 10; ++t) {
      one.plan();
      other.plan();
      ASSERT_EQ(one.command[0], other.command[0]) << kind << " " << t;
      // refinement ends at the one minimum of this problem, whatever it began from
      if (t == 0 && kind != tiller_planner_hybrid) {
        EXPECT_NE(one.command[0], plain) << kind;
      }
    }
  }
}

TEST(AdaptCovariance, leaves_the_spread_where_all_samples_are_equal) {
  for (const std::uint32_t kind : {std::uint32_t{tiller_planner_mppi}, std::uint32_t{tiller_planner_cem}}) {
    tiller::Config c = wide_config(kind, 6);
    c.planner.rollouts = 1024;
    c.planner.adapt_covariance = 1;
    c.planner.elite_fraction = 1.0;
    c.cost = {};
    Bench bench(c);
    bench.request.deadline.iterations = 10;
    bench.plan();
    for (std::uint32_t r = 0; r < 6; ++r)
      // 1024 samples say as much as 240 of the whole spread: 5 % an iteration, a random walk of 10; three deviations
      EXPECT_NEAR(sampler_of(bench).spread[r], 2.0, 0.9) << kind << " " << r;
  }
}

TEST(AdaptCovariance, narrows_to_what_matters_between_floor_and_ceiling) {
  for (const std::uint32_t kind : {std::uint32_t{tiller_planner_mppi}, std::uint32_t{tiller_planner_cem}}) {
    tiller::Config c = wide_config(kind, 6);
    c.planner.rollouts = 1024;
    c.planner.adapt_covariance = 1;
    c.cost = {};
    c.cost.terminal_weight[1] = 1.0;  // the velocity at the end: every input counts the same, their differences nothing
    c.cost.input_weight[0] = 1.0;
    c.planner.noise_sd[0] = 20.0;
    Bench bench(c);
    bench.request.deadline.iterations = 30;
    bench.plan();
    const Sampler& s = sampler_of(bench);
    for (std::uint32_t r = 0; r < 6; ++r) {
      EXPECT_GE(s.spread[r], 2.0 * (1.0 - 1e-12)) << "the floor";
      EXPECT_LT(s.spread[r], 12.0) << "a sharp optimum wants less than 20 N";
    }
    bench.reset();
    EXPECT_EQ(s.spread[0], 20.0);
  }
}

TEST(AdaptCovariance, never_leaves_floor_and_ceiling_and_moves_with_the_knots) {
  tiller::Config c = line_config(tiller_planner_mppi);
  c.planner.adapt_covariance = 1;
  Bench bench(c);
  const Sampler& s = sampler_of(bench);
  double least = 1e9, most = 0.0;
  for (int t = 0; t < 500; ++t) {
    bench.set_state({std::sin(0.3 * t), std::cos(0.2 * t)});
    bench.plan();
    for (std::uint32_t r = 0; r < s.rows; ++r) {
      least = std::min(least, s.spread[r]);
      most = std::max(most, s.spread[r]);
    }
  }
  std::printf("spread from %.3f to %.3f, noise_sd 2\n", least, most);
  EXPECT_GE(least, 0.2 * (1.0 - 1e-12));
  EXPECT_LE(most, 4.0 * (1.0 + 1e-12));
  EXPECT_LT(least, 1.0) << "or nothing adapted";
  bench.request.tick += 1000;  // every knot is new
  bench.request.deadline.iterations = 0;
  bench.plan();
  for (std::uint32_t r = 0; r < s.rows; ++r) EXPECT_EQ(s.spread[r], 2.0);
}

TEST(Interpolation, cubic_plans_slide_unchanged) {
  tiller::Config c = line_config(tiller_planner_mppi);
  c.planner.interpolation = tiller_interpolation_cubic;
  Bench bench(c);
  bench.set_state({1.0, 0.0});
  bench.plan();
  const std::vector<float> old(bench.sequence(), bench.sequence() + 50);
  bench.request.deadline.iterations = 0;
  for (std::uint32_t t = 1; t < 50; ++t) {
    bench.plan();
    EXPECT_NEAR(bench.command[0], static_cast<double>(old[t]), 1e-5) << t;  // rounding of float at 5 N
  }
}

/// A planar quadrotor, 0.5 kg between two rotors: two inputs, each with limits and a rate limit of its own.
TEST(TwoInputs, every_option_and_the_tree_fly_within_the_limits) {
  for (const std::uint32_t kind : {std::uint32_t{tiller_planner_random_shooting}, std::uint32_t{tiller_planner_cem},
                                   std::uint32_t{tiller_planner_mppi}, std::uint32_t{tiller_planner_mcts}}) {
    tiller::Config c = line_config(kind);
    c.model = tiller_find_model("planar_quadrotor");
    ASSERT_NE(c.model, nullptr);
    c.param_count = c.model->param_count;
    c.integrator = tiller_integrator_midpoint;
    c.body.gravity_z_m_s2 = -9.81;
    switch_options_on(c);
    c.planner.filter = 1.0;
    c.planner.rollouts = 256;
    c.planner.iterations = 3;
    c.planner.particles = 2;
    c.planner.levels = 5;
    c.planner.hold_steps = 4;
    c.cost = {};
    const double q[6] = {2.0, 2.0, 1.0, 0.2, 0.2, 0.1};
    for (int i = 0; i < 6; ++i) {
      c.cost.state_weight[i] = q[i];
      c.cost.terminal_weight[i] = 20.0 * q[i];
    }
    const double high[2] = {5.0, 6.0}, rate[2] = {60.0, 90.0};
    for (int i = 0; i < 2; ++i) {
      c.safety.input_low[i] = 0.0;
      c.safety.input_high[i] = high[i];
      c.safety.input_rate_per_s[i] = rate[i];
      c.planner.noise_sd[i] = 1.5;
    }
    Bench bench(c, nullptr, tiller::select_rollout(*c.model));
    const float params[4] = {0.5f, 0.2f, 0.008f, 0.1f};
    for (std::uint32_t i = 0; i < 4; ++i)
      for (std::uint32_t m = 0; m < 2; ++m) bench.params[i * 2 + m] = params[i] * (m ? 1.05f : 0.95f);
    bench.last_command[0] = bench.last_command[1] = 2.45;
    std::vector<double> x = {-0.5, 0.2, 0.0, 0.0, 0.0, 0.0};
    double off = 0.0;
    for (int t = 0; t < 250; ++t) {
      bench.set_state(x);
      const double before[2] = {bench.last_command[0], bench.last_command[1]};
      ASSERT_EQ(bench.plan().status, tiller_status_ok);
      for (int i = 0; i < 2; ++i) {
        ASSERT_GE(bench.command[i], 0.0);
        ASSERT_LE(bench.command[i], high[i]);
        ASSERT_LE(std::fabs(bench.command[i] - before[i]), rate[i] * c.period_s);
      }
      tiller::StepSetup setup;
      setup.period_s = c.period_s;
      setup.integrator = tiller_integrator_midpoint;
      setup.body = c.body;
      double next[6 * tiller::kLanePadding], p[4];
      for (int i = 0; i < 4; ++i) p[i] = static_cast<double>(params[i]);
      tiller::RolloutJob<double> job;
      job.setup = &setup;
      job.lanes = tiller::kLanePadding;
      job.horizon = 1;
      job.state = {x.data(), 0};
      job.params = {p, 0};
      job.controls = {bench.command, 0};
      job.final_state = next;
      tiller::select_rollout(*c.model).rollout_f64(*c.model, job);
      for (std::size_t i = 0; i < 6; ++i) x[i] = next[i * tiller::kLanePadding];
      if (t >= 200) off += std::hypot(x[0], x[1]) / 50.0;
    }
    std::printf("%s: %.3f m from the goal in the fifth second\n", tiller::find_planner(kind)->name, off);
    // 0.54 m off at the start; the tree hovers by values 1.25 N apart, each good for 2.5 m/s2 or 30 rad/s2
    EXPECT_LT(off, kind == tiller_planner_mcts ? 0.5 : 0.05);
  }
}

}  // namespace
}  // namespace tiller_test
