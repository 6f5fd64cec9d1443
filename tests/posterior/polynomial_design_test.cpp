// Polynomials of the parameters: what has the terms that they have is known exactly, wherever the cloud goes.

#include "posterior/polynomial_design.hpp"
#include "tiller/config.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace {

using tiller::Arena;
using tiller::Cloud;
using tiller::PolynomialDesign;

constexpr std::uint32_t kParticles = 256;

/// A model with as many parameters as it takes, which moves nothing.
struct Parameters {
  explicit Parameters(std::uint32_t d) {
    for (std::uint32_t i = 0; i < d; ++i) names.push_back("p" + std::to_string(i));
    for (const std::string& name : names) pointers.push_back(name.c_str());
    static const char* const state[] = {"x_m"};
    static const char* const input[] = {"u_N"};
    model.size = sizeof model;
    model.version = TILLER_MODEL_VERSION;
    model.name = "parameters";
    model.state_count = model.input_count = 1;
    model.param_count = d;
    model.state_names = state;
    model.input_names = input;
    model.param_names = pointers.data();
    model.dynamics = [](const double*, const double*, const double*, const tiller_body_t*, const double*,
                        double* dxdt) { dxdt[0] = 0.0; };
    (void)tiller_config_default(&config, &model);
    for (std::uint32_t i = 0; i < d; ++i) config.priors[i] = {tiller_prior_normal, 0, 1.0, 0.5, -INFINITY, INFINITY};
    config.posterior.particles = kParticles;
  }
  std::vector<std::string> names;
  std::vector<const char*> pointers;
  tiller_model_t model{};
  tiller::Config config;
};

/// A block that ends where what was laid out ends.
class Block {
 public:
  template <class LayOut>
  auto fill(const LayOut& lay_out) {
    Arena measure;
    (void)lay_out(measure);
    storage_.resize(measure.used() + Arena::kAlignment);
    const auto at = reinterpret_cast<std::uintptr_t>(storage_.data());
    Arena arena(storage_.data() + (Arena::kAlignment - at % Arena::kAlignment) % Arena::kAlignment, measure.used());
    return lay_out(arena);
  }

 private:
  std::vector<unsigned char> storage_;
};

/// Slopes in every coordinate, products of the first eight.
struct Function {
  explicit Function(std::uint32_t dimension, std::mt19937& random) : d(dimension), slope(d), product(d * d) {
    std::normal_distribution<double> normal;
    for (double& s : slope) s = normal(random);
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c < d; ++c) product[r * d + c] = r < 8 && c < 8 ? normal(random) : 0.0;
  }
  double operator()(const double* v) const {
    double sum = 0.3;
    for (std::uint32_t r = 0; r < d; ++r) {
      sum += slope[r] * v[r];
      for (std::uint32_t c = 0; c < d; ++c) sum += product[r * d + c] * v[r] * v[c];
    }
    return sum;
  }
  std::uint32_t d;
  std::vector<double> slope, product;
};

class Polynomials : public testing::TestWithParam<std::uint32_t> {
 protected:
  Polynomials()
      : d_(GetParam()),
        parameters_(d_),
        cloud_(cloud_block_.fill([this](Arena& a) { return Cloud::lay_out(a, parameters_.config); })),
        design_(design_block_.fill([this](Arena& a) { return PolynomialDesign::lay_out(a, d_, 2.5); })) {}

  /// A cloud around `centre`, narrower and tilted by `width`.
  void place_cloud(double centre, double width) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    cloud_.level_weights();
    for (std::uint32_t i = 0; i < kParticles; ++i) {
      std::vector<double> v(d_);
      const double shared = normal(random);
      for (std::uint32_t j = 0; j < d_; ++j) v[j] = centre + width * (normal(random) + 0.5 * shared);
      cloud_.set_coordinate(i, v.data());
    }
  }
  std::vector<double> fitted(const Function& f) const {
    std::vector<double> value(design_.points()), coefficients(design_.terms()), v(d_);
    for (std::uint32_t k = 0; k < design_.points(); ++k) {
      for (std::uint32_t j = 0; j < d_; ++j) v[j] = design_.at()[j * design_.points() + k];
      value[k] = f(v.data());
    }
    design_.fit(value.data(), coefficients.data());
    return coefficients;
  }
  /// The largest error at the particles, by the lanes, as a share of the function's own size there.
  double error_at_particles(const Function& f, const std::vector<double>& coefficients) const {
    std::vector<double> read(kParticles, 0.0), v(d_);
    tiller::PolynomialJob job = design_.job(kParticles, cloud_.coordinate, kParticles);
    job.linear = 1;
    job.tilt = coefficients.data();
    job.sums = read.data();
    job.stride = kParticles;
    tiller::filter_table().polynomial(job);
    double worst = 0.0, size = 0.0;
    for (std::uint32_t i = 0; i < kParticles; ++i) {
      for (std::uint32_t j = 0; j < d_; ++j) v[j] = cloud_.coordinate[j * kParticles + i];
      size = std::fmax(size, std::fabs(f(v.data())));
      if (!std::isnan(read[i])) worst = std::fmax(worst, std::fabs(read[i] - f(v.data())));  // NaN: far outside
    }
    return worst / size;
  }

  std::uint32_t d_;
  Parameters parameters_;
  Block cloud_block_, design_block_;
  Cloud cloud_;
  PolynomialDesign design_;
};

/// The fit has a little ridge (1e-9 of the points): hence the tolerance.
TEST_P(Polynomials, AreExactWhereTheyHaveTheTerms) {
  std::mt19937 random(d_);
  const Function f(d_, random);
  place_cloud(1.0, 0.4);
  design_.centre_on(cloud_);
  EXPECT_EQ(design_.curved(), d_ < 8 ? d_ : 8);
  EXPECT_LE(design_.terms(), PolynomialDesign::kMaxTerms);
  EXPECT_LT(error_at_particles(f, fitted(f)), 1e-5);
}

TEST_P(Polynomials, AreCarriedOverToWhereTheCloudGoes) {
  std::mt19937 random(d_);
  const Function f(d_, random);
  place_cloud(1.0, 0.4);
  design_.centre_on(cloud_);
  std::vector<double> coefficients = fitted(f), scratch(design_.terms());
  place_cloud(0.8, 0.2);
  design_.centre_on(cloud_);
  design_.translate(coefficients.data(), scratch.data());
  EXPECT_LT(error_at_particles(f, coefficients), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Dimensions, Polynomials, testing::Values(1u, 3u, 8u, 9u, 20u, 44u, TILLER_MAX_PARAMS));

}  // namespace
