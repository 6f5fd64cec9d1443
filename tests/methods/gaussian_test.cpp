// The Gaussian that SimOpt refits: what it begins with.
#include "tools/identify/gaussian.hpp"

#include <gtest/gtest.h>

#include "problems.hpp"

namespace tiller::tools {
namespace {

TEST(Gaussian, OfAMixturePriorHasItsMeanAndCovariance) {
  TestLog log = linear_log(1);
  const double weight[] = {1.0}, mean[] = {0.9, -0.4}, root[] = {0.2, 0.0, 0.12, 0.05};
  tiller_mixture_t mixture{sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, 1, 2, weight, mean, root};
  log.config.prior_mixture = &mixture;
  const Gaussian one = Gaussian::of_prior(log.config, Coordinates(log.config));
  EXPECT_EQ(one.mean, (std::vector<double>{0.9, -0.4}));
  const std::vector<double> square = {0.04, 0.024, 0.024, 0.0169};  // root root'
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(one.covariance[i], square[i], 1e-15);

  // two of half the weight, 0.4 apart in the first coordinate: 0.2^2 between them
  const double halves[] = {0.5, 0.5}, means[] = {0.7, -0.4, 1.1, -0.4};
  const double roots[] = {0.2, 0.0, 0.12, 0.05, 0.2, 0.0, 0.12, 0.05};
  mixture = {sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, 2, 2, halves, means, roots};
  const Gaussian both = Gaussian::of_prior(log.config, Coordinates(log.config));
  EXPECT_NEAR(both.mean[0], 0.9, 1e-15);
  EXPECT_NEAR(both.covariance[0], 0.08, 1e-15);
  EXPECT_NEAR(both.covariance[1], 0.024, 1e-15);
  EXPECT_NEAR(both.covariance[3], 0.0169, 1e-15);
}

TEST(Gaussian, OfMarginalsHasTheirVariancesAlone) {
  const TestLog log = pendulum_log(1);
  const Gaussian prior = Gaussian::of_prior(log.config, Coordinates(log.config));
  EXPECT_NEAR(prior.mean[0], 0.55, 1e-3);  // uniform on [.1, 1], from 2048 even draws
  EXPECT_NEAR(prior.covariance[0], 0.81 / 12, 1e-4);
  EXPECT_EQ(prior.covariance[1], 0.0);
}

}  // namespace
}  // namespace tiller::tools
