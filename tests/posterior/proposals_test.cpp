// Where particles are asked to go when all that is left of a cloud lies on a line.

#include "posterior/proposals.hpp"
#include "tiller/config.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace {

using tiller::Arena;
using tiller::Cloud;
using tiller::Proposal;

constexpr std::uint32_t kParticles = 64, kMoves = 32;

void propose(const Cloud& cloud, std::uint64_t tick, std::uint32_t cursor, std::uint32_t moves, Proposal* proposals,
             const tiller::Guides* guides = nullptr) {
  const tiller::Proposer proposer(cloud, tick, cursor, moves, guides);
  for (std::uint32_t m = 0; m < moves; ++m) proposer.draw(m, proposals[m]);
}

tiller::Config config_of_two() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("pendulum"));
  c.priors[0] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 10.0};
  c.priors[1] = {tiller_prior_fixed, 0, 0.5, 0.0, 0.5, 0.5};
  c.priors[2] = {tiller_prior_normal, 0, 5.0, 2.0, -INFINITY, INFINITY};
  c.posterior.particles = kParticles;
  c.posterior.prior_proposal_fraction = 0.0;
  return c;
}

class OnALine : public testing::Test {
 protected:
  OnALine() : config_(config_of_two()) {
    Arena measure;
    (void)Cloud::lay_out(measure, config_);
    storage_.resize(measure.used() + Arena::kAlignment);
    const auto at = reinterpret_cast<std::uintptr_t>(storage_.data());
    const std::size_t skip = (Arena::kAlignment - at % Arena::kAlignment) % Arena::kAlignment;
    Arena arena(storage_.data() + skip, measure.used());
    cloud_ = Cloud::lay_out(arena, config_);
    cloud_.level_weights();
    // copies of two particles: their differences and their covariance know one direction
    for (std::uint32_t i = 0; i < kParticles; ++i) {
      const double v[2] = {i % 2 ? 4.0 : 6.0, i % 2 ? 4.5 : 5.5};
      cloud_.set_coordinate(i, v);
    }
  }
  /// Twice the distance from the line through the two particles, in units of its direction (2, 1).
  static double off_line(const double* v) { return v[0] - 5.0 - 2.0 * (v[1] - 5.0); }

  tiller::Config config_;
  std::vector<unsigned char> storage_;
  Cloud cloud_;
};

TEST_F(OnALine, EveryOtherProposalLeavesItAlongOneCoordinate) {
  ASSERT_EQ(cloud_.d, 2u);
  Proposal proposals[kMoves];
  double coordinate[kMoves][2];
  for (std::uint32_t m = 0; m < kMoves; ++m) proposals[m].coordinate = coordinate[m];
  int off = 0;
  double least = INFINITY, most = 0;
  for (std::uint64_t tick = 0; tick < 50; ++tick) {
    propose(cloud_, tick, 0, kMoves, proposals);
    for (std::uint32_t m = 0; m < kMoves; ++m) {
      const double* v = proposals[m].coordinate;
      const double away = std::fabs(off_line(v));
      if (m % 2 == 0) {
        EXPECT_LT(away, 1e-6) << "as before: along the line";
        continue;
      }
      const std::uint32_t i = proposals[m].particle;
      const bool moved0 = v[0] != cloud_.coordinate[i], moved1 = v[1] != cloud_.coordinate[cloud_.n + i];
      EXPECT_LE(int{moved0} + int{moved1}, 1) << "one coordinate at a time";
      if (away == 0.0) continue;  // refused by the prior: it stands where its particle is
      ++off;
      least = std::fmin(least, away);
      most = std::fmax(most, away);
    }
  }
  EXPECT_GT(off, 25 * static_cast<int>(kMoves) * 8 / 10);
  EXPECT_LT(least, 1e-3) << "near";
  EXPECT_GT(most, 1.0) << "and far: the posterior's width is not known";
}

// Metropolis with these proposals alone comes to the posterior: a normal of known deviations that lies across the line.
TEST_F(OnALine, MovesFindTheWholePosterior) {
  const double sd[2] = {0.5, 0.02};
  const auto log_target = [&](const double* v) {
    return -0.5 * (std::pow((v[0] - 5.0) / sd[0], 2) + std::pow((v[1] - 5.0) / sd[1], 2));
  };
  Proposal proposals[kMoves];
  double coordinate[kMoves][2];
  for (std::uint32_t m = 0; m < kMoves; ++m) proposals[m].coordinate = coordinate[m];
  std::uint32_t cursor = 0;
  double sum[2] = {}, square[2] = {}, count = 0;
  for (std::uint64_t tick = 0; tick < 4000; ++tick) {
    propose(cloud_, tick, cursor, kMoves, proposals);
    for (const Proposal& p : proposals) {
      const double present[2] = {cloud_.coordinate[p.particle], cloud_.coordinate[cloud_.n + p.particle]};
      if (log_target(p.coordinate) - log_target(present) > p.log_uniform)
        cloud_.set_coordinate(p.particle, p.coordinate);
    }
    cursor = (cursor + kMoves) % kParticles;
    if (tick < 1000) continue;
    for (std::uint32_t i = 0; i < kParticles; ++i, ++count)
      for (std::uint32_t j = 0; j < 2; ++j) {
        sum[j] += cloud_.coordinate[j * cloud_.n + i];
        square[j] += std::pow(cloud_.coordinate[j * cloud_.n + i], 2);
      }
  }
  for (int j = 0; j < 2; ++j) {
    const double mean = sum[j] / count, deviation = std::sqrt(square[j] / count - mean * mean);
    std::printf("coordinate %d: %.4f +- %.4f, target 5 +- %.4f\n", j, mean, deviation, sd[j]);
    // some 1,500 independent draws of the cloud at an acceptance of a quarter and more: 3 % of a deviation, four times
    EXPECT_NEAR(mean, 5.0, 0.12 * sd[j]);
    EXPECT_NEAR(deviation, sd[j], 0.12 * sd[j]);
  }
}

/// A crescent under the priors: its quadratic is wrong wherever a walk gets to.
double crescent(const double* v) {
  const double off = v[1] - 4.0 - 0.5 * (v[0] - 5.0) * (v[0] - 5.0);
  return -0.5 * (std::pow((v[0] - 5.0) / 1.2, 2) + std::pow(off / 0.4, 2));
}

struct Moments {
  double mean[2] = {}, deviation[2] = {};
};

/// Of prior x exp(crescent), on a grid.
Moments exact_moments(const tiller::PriorDistribution& prior) {
  double sum[2] = {}, square[2] = {}, all = 0.0;
  for (double x = 0.005; x < 10.0; x += 0.01)
    for (double y = -5.0; y < 15.0; y += 0.01) {
      const double v[2] = {x, y}, density = std::exp(crescent(v) + prior.log_density(v));
      all += density;
      for (int j = 0; j < 2; ++j) {
        sum[j] += density * v[j];
        square[j] += density * v[j] * v[j];
      }
    }
  Moments m;
  for (int j = 0; j < 2; ++j) {
    m.mean[j] = sum[j] / all;
    m.deviation[j] = std::sqrt(square[j] / all - m.mean[j] * m.mean[j]);
  }
  return m;
}

// Guides say where to go, the data whether: with a shape that is wrong and a law of swings that has a peak of its own
// the target is what it is.
TEST_F(OnALine, GuidesLeaveThePosteriorAsItIs) {
  std::vector<unsigned char> storage(1 << 16);
  const auto at = reinterpret_cast<std::uintptr_t>(storage.data());
  Arena arena(storage.data() + (Arena::kAlignment - at % Arena::kAlignment) % Arena::kAlignment, 1 << 15);
  tiller::LikelihoodShape shape = tiller::LikelihoodShape::lay_out(arena, 2);
  tiller::SwingLaw swing = tiller::SwingLaw::lay_out(arena, 1);
  shape.clear();
  config_.priors[2].low = -5.0;
  config_.priors[2].high = 15.0;
  swing.begin(cloud_.prior, 0, 0, 1e-3);
  for (int k = 0; k < 4000; ++k) {
    const double force = std::sin(0.4 * k);
    swing.observe(&force);
  }
  std::vector<double> log_likelihood(kParticles);
  for (std::uint32_t i = 0; i < kParticles; ++i) {
    const double v[2] = {4.0 + 2.0 * i / kParticles, 3.5 + (i * 7 % kParticles) * 1.0 / kParticles};
    cloud_.set_coordinate(i, v);
    log_likelihood[i] = crescent(v);
  }
  Proposal proposals[kMoves];
  double coordinate[kMoves][2];
  for (std::uint32_t m = 0; m < kMoves; ++m) proposals[m].coordinate = coordinate[m];
  const tiller::Guides guides = {&shape, log_likelihood.data(), 1.0, &swing};
  std::uint32_t cursor = 0;
  double sum[2] = {}, square[2] = {}, count = 0;
  int fitted = 0;
  for (std::uint64_t tick = 0; tick < 6000; ++tick) {
    propose(cloud_, tick, cursor, kMoves, proposals, &guides);
    fitted += shape.fitted();
    for (const Proposal& p : proposals) {
      const double there = crescent(p.coordinate);
      if (!(there - log_likelihood[p.particle] + p.log_correction > p.log_uniform)) continue;
      cloud_.set_coordinate(p.particle, p.coordinate);
      log_likelihood[p.particle] = there;
    }
    cursor = (cursor + kMoves) % kParticles;
    if (tick < 1000) continue;
    for (std::uint32_t i = 0; i < kParticles; ++i, ++count)
      for (std::uint32_t j = 0; j < 2; ++j) {
        sum[j] += cloud_.coordinate[j * cloud_.n + i];
        square[j] += std::pow(cloud_.coordinate[j * cloud_.n + i], 2);
      }
  }
  EXPECT_GT(fitted, 5000) << "or the test shows nothing";
  const Moments exact = exact_moments(cloud_.prior);
  for (int j = 0; j < 2; ++j) {
    const double mean = sum[j] / count, deviation = std::sqrt(square[j] / count - mean * mean);
    std::printf("coordinate %d: %.4f +- %.4f, target %.4f +- %.4f\n", j, mean, deviation, exact.mean[j],
                exact.deviation[j]);
    // some 10,000 independent draws of the cloud: 1 % of a deviation, four times
    EXPECT_NEAR(mean, exact.mean[j], 0.04 * exact.deviation[j]);
    EXPECT_NEAR(deviation, exact.deviation[j], 0.04 * exact.deviation[j]);
  }
}

// A force that swings once a second is looked for there: within an eighth of its frequency lies most of what is not
// spread evenly.
TEST_F(OnALine, ASwingIsAskedForWhereTheForceHasItsPower) {
  std::vector<unsigned char> storage(1 << 14);
  const auto at = reinterpret_cast<std::uintptr_t>(storage.data());
  Arena arena(storage.data() + (Arena::kAlignment - at % Arena::kAlignment) % Arena::kAlignment, 1 << 13);
  tiller::SwingLaw swing = tiller::SwingLaw::lay_out(arena, 1);
  config_.priors[2] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 3.4};  // the logarithm of omega
  swing.begin(cloud_.prior, 0, 0, 0.02);
  for (int k = 0; k < 500; ++k) {
    const double force = 0.7 + 0.3 * std::sin(6.2832 * 0.02 * k);
    swing.observe(&force);
  }
  int near = 0;
  const double present[2] = {5.0, 1.0};
  for (std::uint32_t k = 0; k < 1000; ++k) {
    tiller::Rng rng(1, tiller::kRngMove, k);
    double to[2];
    (void)swing.step(cloud_.prior, rng, present, to);
    near += std::fabs(to[1] - 1.838) < 0.2;
  }
  std::printf("%d of 1000 near\n", near);
  EXPECT_GT(near, 300);  // half of the draws are even, of which these are one in eight
}

}  // namespace
