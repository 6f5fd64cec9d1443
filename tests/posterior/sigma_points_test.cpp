// Sigma points against the particles that they stand for: moments, expectations, bounds, the states that go along.

#include "posterior/sigma_points.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace {

using tiller::SigmaPoints;

/// Particles that a test has written down.
class Particles final : public tiller::Posterior {
 public:
  explicit Particles(const tiller_config_t& config) : np(config.param_count), nx(config.model->state_count) {}
  void add(std::vector<double> params, std::vector<double> state, double weight, double delay = 0.0) {
    params_.push_back(std::move(params));
    state_.push_back(std::move(state));
    weight_.push_back(weight);
    delay_.push_back(delay);
  }
  void reset() override {}
  tiller_status_t start(const double*) override { return tiller_status_ok; }
  tiller_status_t update(const tiller::Transition&) override { return tiller_status_ok; }
  tiller_status_t skip(const tiller::Transition&) override { return tiller_status_ok; }
  bool started() const override { return true; }
  void moments(double*, double*, double*, double*) const override {}
  void covariance(double*) const override {}
  double quantile(std::uint32_t, double) const override { return 0.0; }
  double effective_samples() const override { return 0.0; }
  double exponent() const override { return 1.0; }
  double noise_scale() const override { return 1.0; }
  double acceptance() const override { return 0.0; }
  std::uint64_t resamplings() const override { return 0; }
  std::uint64_t gated() const override { return 0; }
  std::uint32_t size() const override { return static_cast<std::uint32_t>(weight_.size()); }
  void particle(std::uint32_t k, double* params, double* state, double* weight) const override {
    if (params) std::copy(params_[k].begin(), params_[k].end(), params);
    if (state) std::copy(state_[k].begin(), state_[k].end(), state);
    if (weight) *weight = weight_[k];
  }
  void particle_effects(std::uint32_t k, double* effect_state) const override { effect_state[0] = 3.0 * params_[k][1]; }
  double particle_delay(std::uint32_t k) const override { return delay_[k]; }
  void draw(std::uint32_t, std::uint64_t, float*, float*, float*, float*) const override {}

  std::uint32_t np, nx;
  std::vector<std::vector<double>> params_, state_;
  std::vector<double> weight_, delay_;
};

/// A cart-pole: masses log-normal and normal, the length uniform.
tiller::Config cart_pole(std::uint32_t hypotheses) {
  tiller::Config c;
  tiller_config_default(&c, tiller_find_model("cart_pole"));
  c.planner.hypotheses = tiller_hypotheses_sigma_points;
  c.planner.particles = hypotheses;
  c.priors[0] = {tiller_prior_log_normal, 0, 1.0, 0.3, 0.0, INFINITY};
  c.priors[1] = {tiller_prior_normal, 0, 0.2, 0.05, -INFINITY, INFINITY};
  c.priors[2] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.2, 0.9};
  return c;
}

double coordinate(const tiller::Config& c, std::uint32_t j, double value) {
  return tiller::to_coordinate(c.priors[j], value);
}

struct Drawn {
  explicit Drawn(const tiller::Config& config, std::uint32_t effect_states = 0)
      : c(config), count(SigmaPoints::count(config)) {
    tiller::Arena measure;
    SigmaPoints().lay_out(measure, c, effect_states);
    storage.resize(measure.used() + tiller::Arena::kAlignment);
    void* base = storage.data();
    std::size_t space = storage.size();
    std::align(tiller::Arena::kAlignment, measure.used(), base, space);
    tiller::Arena arena(base, measure.used());
    points.lay_out(arena, c, effect_states);
    EXPECT_EQ(arena.used(), measure.used());
    EXPECT_TRUE(arena.fits());
    params.resize(std::size_t{c.param_count} * count);
    state.resize(std::size_t{c.model->state_count} * count);
    effect.resize(std::size_t{effect_states} * count + 1);
  }
  void draw(const Particles& p) { points.draw(p, params.data(), state.data(), effect.data()); }
  double param(std::uint32_t j, std::uint32_t k) const { return static_cast<double>(params[j * count + k]); }
  double at(std::uint32_t j, std::uint32_t k) const { return coordinate(c, j, param(j, k)); }
  double x(std::uint32_t i, std::uint32_t k) const { return static_cast<double>(state[i * count + k]); }
  double weight(std::uint32_t k) const { return static_cast<double>(points.weight()[k]); }
  template <class F>
  double expect(const F& f) const {
    double sum = 0.0;
    for (std::uint32_t k = 0; k < count; ++k) sum += weight(k) * f(k);
    return sum;
  }

  tiller::Config c;
  std::uint32_t count;
  SigmaPoints points;
  std::vector<unsigned char> storage;
  std::vector<float> params, state, effect;
};

template <class F>
double mean_over(const Particles& p, const F& f) {
  double sum = 0.0, all = 0.0;
  for (std::uint32_t k = 0; k < p.size(); ++k) {
    sum += p.weight_[k] * f(k);
    all += p.weight_[k];
  }
  return sum / all;
}

/// Correlated, skewed, of unequal weight; the states follow the parameters linearly, but for noise.
Particles skewed(const tiller::Config& c, std::uint32_t seed, double noise = 0.01, double width = 1.0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::gamma_distribution<double> gamma(2.0, 1.0);
  Particles p(c);
  for (int k = 0; k < 300; ++k) {
    const double a = normal(random), b = gamma(random) - 2.0, d = normal(random);
    const double log_mass = width * (0.1 * a + 0.05 * b), pole = 0.2 + width * (0.02 * b - 0.01 * a),
                 half = 0.5 + width * (0.03 * d + 0.01 * a);
    std::vector<double> state(4);
    for (int i = 0; i < 4; ++i) state[i] = i + log_mass + 2.0 * pole - half + noise * normal(random);
    p.add({std::exp(log_mass), pole, half}, state, 0.5 + gamma(random));
  }
  return p;
}

// rounding to float of values about one: 6e-8, of coordinates over deviations of 0.05 about 1e-6
constexpr double kRounding = 4e-6;

TEST(SigmaPoints, have_the_mean_and_covariance_of_the_particles) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    const tiller::Config c = cart_pole(8);
    const Particles p = skewed(c, seed);
    Drawn d(c);
    ASSERT_EQ(d.count, 7u);
    d.draw(p);
    EXPECT_NEAR(d.expect([](std::uint32_t) { return 1.0; }), 1.0, 1e-6);
    for (std::uint32_t i = 0; i < 3; ++i) {
      const double mean = mean_over(p, [&](std::uint32_t k) { return coordinate(c, i, p.params_[k][i]); });
      EXPECT_NEAR(d.expect([&](std::uint32_t k) { return d.at(i, k); }), mean, kRounding);
      for (std::uint32_t j = 0; j <= i; ++j) {
        const double other = mean_over(p, [&](std::uint32_t k) { return coordinate(c, j, p.params_[k][j]); });
        const double covariance = mean_over(p, [&](std::uint32_t k) {
          return (coordinate(c, i, p.params_[k][i]) - mean) * (coordinate(c, j, p.params_[k][j]) - other);
        });
        EXPECT_NEAR(d.expect([&](std::uint32_t k) { return (d.at(i, k) - mean) * (d.at(j, k) - other); }), covariance,
                    kRounding * 0.1)
            << i << " " << j;
      }
    }
  }
}

TEST(SigmaPoints, expect_of_a_quadratic_what_the_particles_do) {
  const tiller::Config c = cart_pole(7);
  const Particles p = skewed(c, 3);
  Drawn d(c);
  d.draw(p);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 20; ++trial) {
    double h[3][3], g[3];
    for (auto& row : h)
      for (double& x : row) x = normal(random);
    for (double& x : g) x = normal(random);
    const auto quadratic = [&](const double* v) {
      double sum = 1.0;
      for (int i = 0; i < 3; ++i) {
        sum += g[i] * v[i];
        for (int j = 0; j < 3; ++j) sum += v[i] * h[i][j] * v[j];
      }
      return sum;
    };
    const double exact = mean_over(p, [&](std::uint32_t k) {
      const double v[3] = {coordinate(c, 0, p.params_[k][0]), p.params_[k][1], p.params_[k][2]};
      return quadratic(v);
    });
    const double found = d.expect([&](std::uint32_t k) {
      const double v[3] = {d.at(0, k), d.at(1, k), d.at(2, k)};
      return quadratic(v);
    });
    EXPECT_NEAR(found, exact, 1e-5);
  }
}

/// A mean over the whole cloud of what is linear in the parameters themselves, drawn hypotheses have only by chance.
TEST(SigmaPoints, expect_of_what_is_linear_what_the_particles_do) {
  tiller::Config c = cart_pole(3);  // one axis of three
  c.priors[0] = {tiller_prior_normal, 0, 1.0, 0.3, -INFINITY, INFINITY};
  const Particles p = skewed(c, 4);
  Drawn d(c);
  ASSERT_EQ(d.count, 3u);
  d.draw(p);
  const auto cost = [](double a, double b, double l) { return 3.0 * a - 7.0 * b + 11.0 * l; };
  const double exact =
      mean_over(p, [&](std::uint32_t k) { return cost(p.params_[k][0], p.params_[k][1], p.params_[k][2]); });
  EXPECT_NEAR(d.expect([&](std::uint32_t k) { return cost(d.param(0, k), d.param(1, k), d.param(2, k)); }), exact,
              1e-5);
}

TEST(SigmaPoints, fewer_than_all_axes_are_the_widest) {
  const tiller::Config all = cart_pole(7), some = cart_pole(5), two = cart_pole(2);
  const Particles p = skewed(all, 5);
  Drawn d(all), e(some), mean(two);
  d.draw(p);
  e.draw(p);
  mean.draw(p);
  ASSERT_EQ(e.count, 5u);
  ASSERT_EQ(mean.count, 1u) << "a pair does not fit";
  EXPECT_EQ(mean.weight(0), 1.0);
  EXPECT_NEAR(mean.at(1, 0), mean_over(p, [&](std::uint32_t k) { return p.params_[k][1]; }), kRounding);
  EXPECT_GT(d.points.variance(0), d.points.variance(1));
  EXPECT_GT(d.points.variance(1), d.points.variance(2));
  const double prior_sd[3] = {0.3, 0.05, 0.7 / std::sqrt(12.0)};
  for (std::uint32_t i = 0; i < 2; ++i) {
    EXPECT_EQ(e.points.variance(i), d.points.variance(i));
    // along the axis, in deviations of the prior
    const auto along = [&](std::uint32_t k) {
      double sum = 0.0;
      for (std::uint32_t j = 0; j < 3; ++j) sum += e.points.axis(i)[j] * (e.at(j, k) - e.at(j, 0)) / prior_sd[j];
      return sum;
    };
    EXPECT_NEAR(e.expect([&](std::uint32_t k) { return along(k) * along(k); }), d.points.variance(i), 1e-5);
    // two axes: the fourth moment is a Gaussian's
    EXPECT_NEAR(e.expect([&](std::uint32_t k) { return std::pow(along(k), 4.0); }),
                3.0 * std::pow(d.points.variance(i), 2.0), 1e-5);
  }
  // nothing along the third
  for (std::uint32_t k = 0; k < 5; ++k) {
    double sum = 0.0;
    for (std::uint32_t j = 0; j < 3; ++j) sum += d.points.axis(2)[j] * (e.at(j, k) - e.at(j, 0)) / prior_sd[j];
    EXPECT_NEAR(sum, 0.0, 1e-5);
  }
}

TEST(SigmaPoints, three_axes_weigh_all_points_alike) {
  const tiller::Config c = cart_pole(7);
  Drawn d(c);
  d.draw(skewed(c, 6));
  for (std::uint32_t k = 0; k < 7; ++k) EXPECT_NEAR(d.weight(k), 1.0 / 7.0, 1e-7);
}

/// Bounds from where they cut one side to where they leave no room for the variance.
TEST(SigmaPoints, stay_within_the_priors_bounds) {
  bool stands = false, falls = false;
  for (const std::uint32_t hypotheses : {3u, 5u, 7u})
    for (const double below : {0.2, 0.06, 0.03, 0.01})
      for (const double above : {0.2, 0.06, 0.03, 0.01}) {
        tiller::Config c = cart_pole(hypotheses);
        const Particles p = skewed(c, 7);
        const double mean = mean_over(p, [&](std::uint32_t k) { return p.params_[k][1]; });
        c.priors[1].low = mean - below;
        c.priors[1].high = mean + above;
        Drawn d(c);
        d.draw(p);
        double sum = 0.0;
        for (std::uint32_t k = 0; k < d.count; ++k) {
          EXPECT_GE(d.param(1, k), c.priors[1].low - 1e-8);
          EXPECT_LE(d.param(1, k), c.priors[1].high + 1e-8);
          EXPECT_GE(d.weight(k), 0.0);
          sum += d.weight(k);
        }
        EXPECT_NEAR(sum, 1.0, 1e-6);
        const std::uint32_t axes = (d.count - 1) / 2;
        const double centre = 1.0 - axes / (axes + std::fmax(3.0 - axes, 0.5));
        EXPECT_GE(d.weight(0), 0.5 * centre - 1e-6);
        for (std::uint32_t i = 0; i < 3; ++i) {
          const double of_particles = mean_over(p, [&](std::uint32_t k) { return coordinate(c, i, p.params_[k][i]); });
          EXPECT_NEAR(d.expect([&](std::uint32_t k) { return d.at(i, k); }), of_particles, kRounding);
        }
        for (std::uint32_t i = 0; i < axes; ++i) {
          EXPECT_LE(d.points.kept_variance(i), d.points.variance(i) * (1.0 + 1e-9));
          (d.points.kept_variance(i) > d.points.variance(i) * (1.0 - 1e-9) ? stands : falls) = true;
        }
      }
  EXPECT_TRUE(stands);
  EXPECT_TRUE(falls) << "or the bounds never mattered";
}

/// One side cut to a third of the distance, the other open: mean and variance stand.
TEST(SigmaPoints, a_bound_on_one_side_leaves_the_moments) {
  tiller::Config c = cart_pole(3);
  c.priors[0].kind = c.priors[2].kind = tiller_prior_fixed;
  c.priors[2].a = 0.5;
  const Particles p = skewed(c, 8);
  const double mean = mean_over(p, [&](std::uint32_t k) { return p.params_[k][1]; });
  const double variance = mean_over(p, [&](std::uint32_t k) { return std::pow(p.params_[k][1] - mean, 2.0); });
  c.priors[1].low = mean - 0.6 * std::sqrt(3.0 * variance);
  Drawn d(c);
  d.draw(p);
  ASSERT_EQ(d.count, 3u);
  EXPECT_NEAR(d.param(1, 2), c.priors[1].low, 1e-7);
  EXPECT_GT(d.param(1, 1) - mean, 1.5 * std::sqrt(3.0 * variance)) << "farther, as the near one is nearer";
  EXPECT_NEAR(d.expect([&](std::uint32_t k) { return d.param(1, k); }), mean, 1e-7);
  EXPECT_NEAR(d.expect([&](std::uint32_t k) { return std::pow(d.param(1, k) - mean, 2.0); }), variance,
              1e-4 * variance);
  EXPECT_NEAR(d.weight(0), 2.0 / 3.0, 1e-6);
}

/// Against the regression by normal equations; angles on both sides of the cut.
TEST(SigmaPoints, states_go_along_by_their_regression) {
  const tiller::Config c = cart_pole(7);
  Particles p = skewed(c, 9, 0.02);
  for (auto& state : p.state_) {
    state[1] += 3.1 - 1.0;  // an angle around half a turn
    state[1] -= state[1] > 3.141592653589793 ? 6.283185307179586 : 0.0;
  }
  Drawn d(c, 1);
  d.draw(p);
  const auto v = [&](std::uint32_t k, std::uint32_t j) { return coordinate(c, j, p.params_[k][j]); };
  const auto state = [&](std::uint32_t k, std::uint32_t i) {
    const double x = p.state_[k][i];
    return i == 1 && x < 0.0 ? x + 6.283185307179586 : x;
  };
  double mean[3];
  for (std::uint32_t j = 0; j < 3; ++j) mean[j] = mean_over(p, [&](std::uint32_t k) { return v(k, j); });
  for (std::uint32_t i = 0; i < 4; ++i) {
    const double middle = mean_over(p, [&](std::uint32_t k) { return state(k, i); });
    double a[3][4];
    for (std::uint32_t r = 0; r < 3; ++r) {
      for (std::uint32_t q = 0; q < 3; ++q)
        a[r][q] = mean_over(p, [&](std::uint32_t k) { return (v(k, r) - mean[r]) * (v(k, q) - mean[q]); });
      a[r][3] = mean_over(p, [&](std::uint32_t k) { return (v(k, r) - mean[r]) * (state(k, i) - middle); });
    }
    for (int r = 0; r < 3; ++r)  // Gauss and Jordan
      for (int o = 0; o < 3; ++o) {
        if (o == r) continue;
        const double factor = a[o][r] / a[r][r];
        for (int q = r; q < 4; ++q) a[o][q] -= factor * a[r][q];
      }
    for (std::uint32_t k = 0; k < d.count; ++k) {
      double expected = middle;
      for (std::uint32_t j = 0; j < 3; ++j) expected += a[j][3] / a[j][j] * (d.at(j, k) - mean[j]);
      EXPECT_NEAR(tiller::state_difference(*c.model, i, d.x(i, k), expected), 0.0, 2e-5) << i << " " << k;
    }
  }
  // an effect's state that is a function of a parameter
  for (std::uint32_t k = 0; k < d.count; ++k) EXPECT_NEAR(static_cast<double>(d.effect[k]), 3.0 * d.param(1, k), 1e-5);
}

TEST(SigmaPoints, the_delay_is_one_more_coordinate) {
  tiller::Config c = cart_pole(9);
  c.posterior.delay_hypotheses = 3;
  Particles p(c);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 400; ++k) {
    const double a = 0.01 * normal(random), delay = k % 2 ? 1.0 : 2.0;
    p.add({std::exp(0.05 * normal(random)), 0.2 + a, 0.5 + 0.005 * normal(random)}, {0.0, 0.0, 0.0, 0.0}, 1.0, delay);
  }
  Drawn d(c);
  ASSERT_EQ(d.count, 9u);
  d.draw(p);
  EXPECT_NEAR(d.expect([&](std::uint32_t k) { return d.points.delay(k); }), 1.5, 1e-5);
  // half a period either way; at two deviations both bounds cut, and the points weigh what they have room for
  const double variance = d.expect([&](std::uint32_t k) { return std::pow(d.points.delay(k) - 1.5, 2.0); });
  EXPECT_GT(variance, 0.05);
  EXPECT_LT(variance, 0.2501);
  for (std::uint32_t k = 0; k < d.count; ++k) {
    EXPECT_GE(d.points.delay(k), 1.0);
    EXPECT_LE(d.points.delay(k), 2.0);
  }
}

TEST(SigmaPoints, one_particle_or_none_that_is_a_number_is_no_trouble) {
  const tiller::Config c = cart_pole(7);
  Particles one(c), bad(c);
  one.add({1.1, 0.21, 0.5}, {0.1, 0.2, 0.3, 0.4}, 1.0);
  Drawn d(c);
  d.draw(one);
  for (std::uint32_t k = 0; k < 7; ++k) {
    EXPECT_FLOAT_EQ(d.params[k], 1.1f);
    EXPECT_FLOAT_EQ(d.state[7 + k], 0.2f);
    EXPECT_NEAR(d.weight(k), 1.0 / 7.0, 1e-7);
  }
  bad.add({1.1, 0.21, 0.5}, {0.1, 0.2, 0.3, 0.4}, 0.6);
  bad.add({NAN, 0.25, 0.5}, {0.1, NAN, 0.3, 0.4}, 0.4);
  d.draw(bad);
  for (std::uint32_t k = 0; k < 7; ++k) EXPECT_FLOAT_EQ(d.params[k], 1.1f);
}

TEST(SigmaPoints, take_no_memory_where_hypotheses_are_drawn) {
  tiller::Config c = cart_pole(7);
  c.planner.hypotheses = tiller_hypotheses_drawn;
  tiller::Arena arena;
  SigmaPoints().lay_out(arena, c, 3);
  EXPECT_EQ(arena.used(), 0u);
}

}  // namespace
