// The batch sampler of bench_table1 against quadrature, on one episode of the pendulum and one of the cart-pole.
#include "harness/accuracy/batch_smc.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tiller::bench {
namespace {

struct Moments {
  Eigen::VectorXd mean, sd;
};

Moments moments(const Eigen::MatrixXd& point) {
  Moments m{point.rowwise().mean(), {}};
  m.sd = ((point.colwise() - m.mean).array().square().rowwise().sum() / static_cast<double>(point.cols())).sqrt();
  return m;
}

class BatchSmc : public testing::TestWithParam<std::size_t> {
 protected:
  BatchSmc() : task_(accuracy_tasks()[GetParam()]), episode_(make_episode(task_, 0.03, 200, 5)) {}
  AccuracyTask task_;
  Episode episode_;
};

TEST_P(BatchSmc, HasTheExactMoments) {
  const ExactLikelihood likelihood(task_, episode_);
  const ExactPosterior exact = exact_on_grid(likelihood, 1024);
  const BatchPosterior batch = batch_smc(likelihood, 1000, 60000, 7);
  EXPECT_EQ(batch.exponent, 1.0);
  const Moments m = moments(batch.point);
  for (int j = 0; j < 2; ++j) {
    const double sd = std::sqrt(exact.covariance(j, j));
    // 1,000 points after dozens of moves: a mean is known to .03 deviations, a deviation to .022; four of them
    EXPECT_NEAR(m.mean[j], exact.mean[j], 0.13 * sd);
    EXPECT_NEAR(m.sd[j] / sd, 1.0, 0.09);
  }
}

TEST_P(BatchSmc, KeepsItsBudgetAndSaysHowFarItCame) {
  const ExactLikelihood likelihood(task_, episode_);
  const BatchPosterior small = batch_smc(likelihood, 400, 1500, 7), table = batch_smc(likelihood, 400, 10000, 7);
  EXPECT_EQ(small.simulations, 1200u);  // the prior and two steps
  EXPECT_GT(small.exponent, 0.0);
  EXPECT_LT(small.exponent, 0.1) << "the posterior is a hundred times narrower than the prior in each parameter";
  EXPECT_EQ(table.simulations, 10000u);
  EXPECT_EQ(table.exponent, 1.0) << "the table's budget is enough";
  EXPECT_EQ(batch_smc(likelihood, 400, 10000, 7).point, table.point);
  for (Eigen::Index i = 0; i < small.point.cols(); ++i)
    for (int j = 0; j < 2; ++j) {
      ASSERT_GE(small.point(j, i), 0.1);
      ASSERT_LE(small.point(j, i), 1.0);
    }
}

INSTANTIATE_TEST_SUITE_P(Tasks, BatchSmc, testing::Values(0, 1));

}  // namespace
}  // namespace tiller::bench
