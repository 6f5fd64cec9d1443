// What knowing more is worth, against what is known exactly: mutual information by quadrature, and two problems whose
// optimal policy comes from dynamic programming over the belief.

#include "planners/probe_value.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

namespace tiller {
namespace {

/// Plan 0 costs the same for both of two hypotheses; plans 1 and 2 are right for one and wrong for the other.
RegretTable two_sided(double hedged, double right, double wrong) {
  const double cost[] = {hedged, hedged, right, wrong, wrong, right};
  RegretTable table;
  table.fill(2, cost);
  return table;
}

TEST(ProbeValue, NothingToldSavesNothingAndEverythingSavesTheHedgedRegret) {
  const RegretTable table = two_sided(5.0, 1.0, 20.0);
  EXPECT_DOUBLE_EQ(table.hedged, 4.0);
  double before = -1.0;
  for (const double apart : {0.0, 0.1, 1.0, 5.0, 30.0, 1e4}) {
    const double pair[] = {0.0, apart, 0.0, 0.0};
    const double saving = expected_saving(table, pair);
    EXPECT_GT(saving, before) << apart;  // more told saves more
    EXPECT_GE(saving, 0.0);
    EXPECT_LE(saving, table.hedged);
    before = saving;
  }
  const double all[] = {0.0, 1e6, 0.0, 0.0}, nothing[] = {0.0, 0.0, 0.0, 0.0};
  EXPECT_DOUBLE_EQ(expected_saving(table, all), 4.0);
  EXPECT_DOUBLE_EQ(expected_saving(table, nothing), 0.0);
}

TEST(ProbeValue, HypothesesThatWantTheSamePlanAreNotWorthTellingApart) {
  const double cost[] = {3.0, 7.0, 3.0, 7.0, 3.0, 7.0};  // every plan costs a hypothesis the same
  RegretTable table;
  table.fill(2, cost);
  const double pair[] = {0.0, 1e6, 0.0, 0.0};
  EXPECT_EQ(expected_saving(table, pair), 0.0);
}

/// What is left of the chance to take one of two Gaussians for the other, by quadrature: 2 times the integral of
/// p q / (p + q).
double exact_confusion(double apart) {
  const double half = 0.5 * std::sqrt(2.0 * apart), step = 1e-3;
  double sum = 0.0;
  for (double y = -half - 12.0; y < half + 12.0; y += step) {
    const double p = std::exp(-0.5 * (y - half) * (y - half)), q = std::exp(-0.5 * (y + half) * (y + half));
    if (p + q > 0.0) sum += 2.0 * p * q / (p + q) * step;
  }
  return sum / 2.5066282746310002;
}

TEST(ProbeValue, TheConfusionOfTwoGaussiansIsItsQuadratureToAPercent) {
  for (const double apart : {0.0, 0.01, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 20.0, 200.0})
    EXPECT_NEAR(confusion(apart) / exact_confusion(apart), 1.0, 0.01) << apart;
  EXPECT_NEAR((1.0 - confusion(1e-4)) / 1e-4, 0.5, 1e-3);  // first order
}

/// Mutual information between which of the means it is and a value seen under unit noise, by quadrature.
double exact_information(const std::vector<double>& mean) {
  const double step = 1e-3, count = static_cast<double>(mean.size());
  double sum = 0.0;
  for (double y = -15.0; y < 25.0; y += step) {
    double mixture = 0.0;
    for (const double m : mean) mixture += std::exp(-0.5 * (y - m) * (y - m)) / count;
    for (const double m : mean) {
      const double p = std::exp(-0.5 * (y - m) * (y - m));
      if (p > 1e-300) sum += step * p / count / 2.5066282746310002 * std::log(p / mixture);
    }
  }
  return sum;
}

TEST(ProbeValue, TheMutualInformationLiesBetweenItsBounds) {
  for (const double scale : {0.1, 0.5, 1.0, 2.0, 4.0}) {
    const std::vector<double> mean = {0.0, scale, 1.5 * scale, 2.5 * scale};
    double pair[16] = {};
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) pair[4 * i + j] = 0.5 * (mean[i] - mean[j]) * (mean[i] - mean[j]);
    const InformationBounds bounds = mixture_information(4, pair);
    const double exact = exact_information(mean);
    EXPECT_LE(bounds.low, exact + 1e-6) << scale;
    EXPECT_GE(bounds.high, exact - 1e-6) << scale;
  }
}

TEST(ProbeValue, TheGaussianInformationIsTheChannelsCapacityFormula) {
  // draws -2..2 of a parameter of variance 2.5 seen through gain 3 and unit noise, twice: 1/2 log(1 + 2 * 9 * 2.5)
  constexpr int kDraws = 5;
  double gram[kDraws * kDraws] = {};
  for (int i = 0; i < kDraws; ++i)
    for (int j = i; j < kDraws; ++j) gram[i * kDraws + j] = gram[j * kDraws + i] = 2.0 * 9.0 * (i - 2) * (j - 2);
  EXPECT_NEAR(gaussian_information(kDraws, gram), 0.5 * std::log(1.0 + 2.0 * 9.0 * 2.5), 1e-12);
}

// ---- the two-armed bandit -----------------------------------------------------------------------

/// A safe arm that pays `safe`, and a risky one that pays `low` or `high` on average, under noise; so many pulls. Once
/// the safe arm is best it is for good, for it tells nothing.
struct Bandit {
  double safe = 0.5, low = 0.2, high = 0.8, noise = 0.5;
  int pulls = 20;
  double mean(double belief) const { return belief * high + (1.0 - belief) * low; }
};

constexpr int kGrid = 100, kNodes = 21;

/// Value of a policy (whether to pull the risky arm) by dynamic programming over the belief that it pays `high`.
double bandit_value(const Bandit& b, double start,
                    const std::function<bool(int left, double belief, double risky)>& pulls_risky) {
  std::vector<double> next(kGrid + 1, 0.0), value(kGrid + 1);
  const auto at = [&](const std::vector<double>& v, double belief) {
    const double x = belief * kGrid;
    const int i = std::min(static_cast<int>(x), kGrid - 1);
    return v[i] + (x - i) * (v[i + 1] - v[i]);
  };
  for (int left = 1; left <= b.pulls; ++left) {
    for (int i = 0; i <= kGrid; ++i) {
      const double belief = static_cast<double>(i) / kGrid;
      double risky = b.mean(belief), weights = 0.0, later = 0.0;
      for (int pays_high = 0; pays_high < 2; ++pays_high)
        for (int n = 0; n < kNodes; ++n) {
          const double z = -5.0 + 10.0 * n / (kNodes - 1), weight = std::exp(-0.5 * z * z);
          const double y = (pays_high ? b.high : b.low) + b.noise * z;
          const double odds = (y - 0.5 * (b.high + b.low)) * (b.high - b.low) / (b.noise * b.noise);
          const double share = pays_high ? belief : 1.0 - belief;
          const double after = belief / (belief + (1.0 - belief) * std::exp(-odds));
          if (pays_high) weights += weight;
          later += share * weight * at(next, belief > 0.0 ? after : 0.0);
        }
      risky += later / weights;
      value[i] = pulls_risky(left, belief, risky) ? risky : b.safe * left;
    }
    next = value;
  }
  return at(next, start);
}

/// Whether to pull the risky arm n times more for what it tells, n = 1.., and then to decide.
bool probes(const Bandit& b, int left, double belief) {
  const double loss = b.safe - b.mean(belief);  // of a pull
  if (loss <= 0.0) return true;
  // two hypotheses of unequal weight are copies of equal ones
  constexpr int kCopies = 20;
  const int high = std::clamp(static_cast<int>(std::lround(belief * kCopies)), 0, kCopies);
  double best = 0.0;
  for (int n = 1; n < left; ++n) {
    const double rest = left - n, d = n * (b.high - b.low) * (b.high - b.low) / (2.0 * b.noise * b.noise);
    std::vector<double> cost(static_cast<std::size_t>(kCopies + 1) * kCopies), apart(kCopies * kCopies, 0.0);
    for (int i = 0; i < kCopies; ++i) {
      const bool pays = i < high;
      const double risky = rest * (1.0 - (pays ? b.high : b.low)), safe = rest * (1.0 - b.safe);
      cost[i] = safe;
      for (int j = 0; j < kCopies; ++j) {
        cost[static_cast<std::size_t>(1 + j) * kCopies + i] = j < high ? risky : safe;
        if (i < j && (i < high) != (j < high)) apart[i * kCopies + j] = d;
      }
    }
    RegretTable table;
    table.fill(kCopies, cost.data());
    best = std::max(best, expected_saving(table, apart.data()) - n * loss);
  }
  return best > 0.0;
}

TEST(ProbeValue, ABanditIsPlayedWithinTwoPercentOfTheOptimum) {
  for (const double belief : {0.2, 0.3, 0.4, 0.45})
    for (const double noise : {0.3, 0.5, 0.8})
      for (const int pulls : {5, 20, 60}) {
        const Bandit b{0.5, 0.2, 0.8, noise, pulls};
        const double best =
            bandit_value(b, belief, [&](int left, double, double risky) { return risky > b.safe * left; });
        const double probing = bandit_value(b, belief, [&](int left, double p, double) { return probes(b, left, p); });
        const double passive = b.safe * pulls;  // never learns: the safe arm is better on average
        EXPECT_GE(probing, 0.98 * best) << belief << " " << noise << " " << pulls << " passive " << passive;
        EXPECT_LE(probing, best + 1e-9);
        EXPECT_GE(best, passive);
      }
}

// ---- a grid with a sign -------------------------------------------------------------------------

/// A corridor that forks: one end is the goal, the other costs `pit`. A sign `detour` steps aside tells which. From the
/// fork an end is `ends` steps away. The optimal dual policy reads the sign where that is cheaper than the gamble.
TEST(ProbeValue, AGridWithASignIsWalkedAtTheOptimalCost) {
  for (const double pit : {1.0, 5.0, 20.0, 100.0})
    for (const double detour : {1.0, 3.0, 8.0, 30.0}) {
      const double ends = 4.0;
      const double gamble = ends + 0.5 * pit, reads = 2.0 * detour + ends;
      // the plans: left, right, and of both the hedged one, which is either; to read adds 2 detour
      const double cost[] = {ends, ends + pit, ends, ends + pit, ends + pit, ends};
      RegretTable table;
      table.fill(2, cost);
      const double told[] = {0.0, 1e6, 0.0, 0.0};
      const bool goes = expected_saving(table, told) > 2.0 * detour;
      EXPECT_NEAR(goes ? reads : gamble, std::min(reads, gamble), 1e-12) << pit << " " << detour;
    }
}

}  // namespace
}  // namespace tiller
