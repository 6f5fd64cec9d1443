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

}  // namespace
