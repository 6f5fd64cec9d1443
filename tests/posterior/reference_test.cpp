// The references that bench_accuracy judges engines by, against closed forms, and against each other where there is
// none.

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdio>

#include "harness/accuracy/accuracy_statistics.hpp"
#include "harness/accuracy/exact_likelihood.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

/// A mass on a rail, linear in gain and damping. Through the C interface: no template, no lanes.
void slide(const double* x, const double* u, const double* f, const tiller_body_t*, const double* p, double* dxdt) {
  dxdt[0] = x[1];
  dxdt[1] = p[0] * u[0] - p[1] * x[1] + f[0];
}

const tiller_model_t& model() {
  static const char* const states[] = {"position_m", "velocity_m_s"};
  static const char* const inputs[] = {"force_N"};
  static const char* const params[] = {"gain_per_kg", "damping_per_s"};
  static const char* const forces[] = {"rail_N"};
  static const tiller_joint_t joints[] = {{"rail", 0, 1, 0, 0}};
  static const tiller_model_t m = [] {
    tiller_model_t made{};
    made.size = sizeof made;
    made.version = TILLER_MODEL_VERSION;
    made.name = "linear";
    made.state_count = 2;
    made.input_count = 1;
    made.param_count = 2;
    made.joint_count = 1;
    made.state_names = states;
    made.input_names = inputs;
    made.param_names = params;
    made.force_names = forces;
    made.joints = joints;
    made.dynamics = &slide;
    return made;
  }();
  return m;
}

/// Both parameters uniform on [low, high].
AccuracyTask linear_task(double low, double high) {
  AccuracyTask t;
  t.name = "linear";
  tiller::Config& c = t.config;
  c = {};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = &model();
  c.param_count = 2;
  c.period_s = 0.05;
  c.substeps = 1;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.priors[0] = {tiller_prior_uniform, 0, 0, 0, low, high};
  c.priors[1] = c.priors[0];
  c.posterior.noise_scale_shape = 0.5;
  c.process_sd[0] = 1e6;  // the position's row says nothing: one regression is left
  c.process_sd[1] = 0.2;
  t.inferred = {0, 1};
  t.step_rms[1] = 0.1;
  t.excitation = {3.0, 3.0, 4, {}};
  return t;
}

/// The regression of the velocity's change on (dt u, -dt v) in closed form. With flat priors the parameters are
/// Student-t with nu = 2 a0 + n - 2 degrees: a normal of covariance tau (X'X)^-1 over tau ~ InvGamma(nu/2, b), where
/// b = a0 q^2 dt + S_min / 2 (Gelman et al., Bayesian Data Analysis, section 14.2).
struct Regression {
  Eigen::Vector2d mean;
  Eigen::Matrix2d inverse;  // (X'X)^-1
  double nu, b, shape, least;
  Eigen::Matrix2d normal;  // X'X

  Regression(const AccuracyTask& task, const Episode& e) {
    const double dt = task.config.period_s;
    normal.setZero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    double squares = 0.0;
    for (std::uint32_t k = 0; k < e.ticks; ++k) {
      const Eigen::Vector2d row(dt * e.input[k], -dt * e.state[2 * k + 1]);
      const double y = e.state[2 * k + 3] - e.state[2 * k + 1];
      normal += row * row.transpose();
      right += row * y;
      squares += y * y;
    }
    inverse = normal.inverse();
    mean = inverse * right;
    least = squares - right.dot(mean);
    shape = task.config.posterior.noise_scale_shape + 0.5 * e.ticks;
    nu = 2.0 * shape - 2.0;
    b = task.config.posterior.noise_scale_shape * std::pow(task.config.process_sd[1], 2) * dt + 0.5 * least;
  }
  Eigen::Matrix2d covariance() const { return b / (0.5 * nu - 1.0) * inverse; }
  double log_posterior(const Eigen::Vector2d& at) const {
    return -shape * std::log(b + 0.5 * (at - mean).dot(normal * (at - mean)));
  }
  /// Convolved with N(0, kernel), by the trapezoidal rule over log tau.
  double log_density(const Eigen::Vector2d& at, const Eigen::Matrix2d& kernel) const {
    const double a = 0.5 * nu, centre = std::log(b / a), width = 1.0 / std::sqrt(a);
    double sum = 0.0, weight = 0.0;
    for (int i = -400; i <= 400; ++i) {
      const double v = centre + 0.03 * width * i;
      const double w = std::exp(-a * (v - centre) - b * std::exp(-v) + a);
      const Eigen::Matrix2d c = std::exp(v) * inverse + kernel;
      sum += w * std::exp(-0.5 * (at - mean).dot(c.inverse() * (at - mean))) /
             (6.283185307179586 * std::sqrt(c.determinant()));
      weight += w;
    }
    return std::log(sum / weight);
  }
};

/// Largest differences over ten runs: mean in deviations, covariance's entries, log density.
struct Gap {
  double mean = 0.0, covariance = 0.0, log_density = 0.0, claimed = 0.0;
};
template <class Solve>
Gap worst_gap(const Solve& solve) {
  Gap worst;
  // truths well inside of what is inferred: no bound cuts the posterior
  const AccuracyTask task = linear_task(-3.0, 6.0), narrow = linear_task(1.0, 2.0);
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Episode e = make_episode(narrow, 0.5, 120, seed);
    const ExactLikelihood likelihood(task, e);
    const Regression closed(task, e);
    const ExactPosterior p = solve(likelihood, seed);
    const Eigen::Matrix2d c = closed.covariance();
    const double h = scott(1024, 2);
    for (int j = 0; j < 2; ++j)
      worst.mean = std::fmax(worst.mean, std::fabs(p.mean[j] - closed.mean[j]) / std::sqrt(c(j, j)));
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        worst.covariance =
            std::fmax(worst.covariance, std::fabs(p.covariance(i, j) - c(i, j)) / std::sqrt(c(i, i) * c(j, j)));
    worst.log_density =
        std::fmax(worst.log_density, std::fabs(p.log_density - closed.log_density(likelihood.truth(), h * h * c)));
    worst.claimed = std::fmax(worst.claimed, p.error);
  }
  std::printf("worst of ten: mean %.2g sd, covariance %.2g, log density %.2g (claimed: %.2g)\n", worst.mean,
              worst.covariance, worst.log_density, worst.claimed);
  return worst;
}

TEST(Reference, GridIsTheClosedForm) {
  const Gap g = worst_gap([](const ExactLikelihood& l, std::uint64_t) { return exact_on_grid(l, 1024); });
  EXPECT_LT(g.mean, 1e-3);
  EXPECT_LT(g.covariance, 1e-3);
  EXPECT_LT(g.log_density, 0.01);  // what two quadratures may differ by before the grid is refined
}

/// 8192 draws, at least a quarter of them effective: 1/sqrt(2048) deviations of the mean, twice the square of it for a
/// variance; four such deviations are granted, and four claimed errors of the density.
TEST(Reference, ImportanceSamplingIsTheClosedForm) {
  const Gap g = worst_gap([](const ExactLikelihood& l, std::uint64_t s) { return exact_by_importance(l, 1024, s); });
  EXPECT_LT(g.mean, 4.0 / std::sqrt(2048.0));
  EXPECT_LT(g.covariance, 4.0 * std::sqrt(2.0 / 2048.0));
  EXPECT_LT(g.log_density, 4.0 * g.claimed);
  EXPECT_LT(g.claimed, 0.1);
}

/// A prior that cuts the posterior through its middle: against sums over a lattice of the closed form's density.
TEST(Reference, GridKeepsToThePriorsEdge) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const AccuracyTask narrow = linear_task(1.0, 2.0);
    const Episode e = make_episode(narrow, 0.5, 60, seed);
    AccuracyTask cut = linear_task(-3.0, 6.0);
    cut.config.priors[0].low = Regression(narrow, e).mean[0];
    const ExactLikelihood likelihood(cut, e);
    const Regression closed(cut, e);
    const Eigen::Matrix2d c = closed.covariance();
    double mass = 0.0, first = 0.0, second = 0.0;
    for (int i = 0; i < 600; ++i)
      for (int j = 0; j < 600; ++j) {
        const Eigen::Vector2d at(closed.mean[0] + 9.0 * std::sqrt(c(0, 0)) * (i + 0.5) / 600,
                                 closed.mean[1] + 18.0 * std::sqrt(c(1, 1)) * ((j + 0.5) / 600 - 0.5));
        if (at[1] < -3.0 || at[1] > 6.0 || at[0] > 6.0) continue;
        const double w = std::exp(closed.log_posterior(at) - closed.log_posterior(closed.mean));
        mass += w;
        first += w * at[0];
        second += w * at[0] * at[0];
      }
    const double mean = first / mass, sd = std::sqrt(second / mass - mean * mean);
    const ExactPosterior p = exact_on_grid(likelihood, 1024);
    std::printf("seed %d: mean off by %.2g sd, sd by %.2g of it\n", static_cast<int>(seed), (p.mean[0] - mean) / sd,
                std::sqrt(p.covariance(0, 0)) / sd - 1.0);
    EXPECT_NEAR(p.mean[0], mean, 2e-3 * sd);
    EXPECT_NEAR(std::sqrt(p.covariance(0, 0)), sd, 2e-3 * sd);
  }
}

/// On the nonlinear tasks the two references share the likelihood alone. Twenty-four comparisons, five errors each.
TEST(Reference, GridAndImportanceSamplingAgreeOnTheTasks) {
  double worst = 0.0;
  for (const AccuracyTask& task : accuracy_tasks())
    for (const double sigma : {0.03, 0.3})
      for (std::uint64_t seed = 1; seed <= 3 && task.inferred.size() == 2; ++seed) {
        const Episode e = make_episode(task, sigma, 100, 100000 + seed);
        const ExactLikelihood likelihood(task, e);
        const ExactPosterior grid = exact_on_grid(likelihood, 1024),
                             drawn = exact_by_importance(likelihood, 1024, seed);
        worst = std::fmax(worst, std::fabs(grid.log_density - drawn.log_density) / (grid.error + drawn.error));
      }
  std::printf("largest difference: %.2g claimed errors\n", worst);
  EXPECT_LT(worst, 5.0);
}

/// The noise of the tasks is stated in round figures; they are what they are said to be. The motions are chaotic: the
/// mean square over 100 draws scatters by a few per cent.
TEST(Reference, StepRmsIsWhatItIsSaidToBe) {
  for (const AccuracyTask& task : accuracy_tasks()) {
    const std::vector<double> rms = measure_step_rms(task, 100);
    std::printf("%s:", task.name.c_str());
    for (std::uint32_t r = 0; r < task.states(); ++r) {
      std::printf(" %.3f", rms[r] / task.step_rms[r]);
      EXPECT_NEAR(rms[r] / task.step_rms[r], 1.0, 0.15);
    }
    std::printf("\n");
  }
}

TEST(Statistics, TailsAndBoundsAreTheTables) {
  EXPECT_NEAR(chi_square_tail(30.1435, 19.0), 0.05, 1e-5);  // printed tables
  EXPECT_NEAR(chi_square_tail(36.1909, 19.0), 0.01, 1e-5);
  // 100 throws of a fair coin: P(X <= 39) = .0176, P(X <= 40) = .0284
  const Bounds b = binomial_bounds(100, 0.5, 0.05);
  EXPECT_EQ(b.low, 40);
  EXPECT_EQ(b.high, 60);
}

}  // namespace
