// The transition engine on a small fixed part of bench_accuracy: beside the exact posterior, and its ranks.

#include <gtest/gtest.h>

#include <cstdio>

#include "harness/accuracy/accuracy_run.hpp"
#include "harness/accuracy/accuracy_statistics.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr std::uint64_t kFirstSeed = 300001;  // apart from those that scores are taken on and settings chosen on

tiller::Config with_engine(const AccuracyTask& task, std::uint64_t seed) {
  tiller::Config c = task.config;
  c.seed = seed;
  c.posterior.kind = tiller_posterior_transition;
  c.posterior.particles = 512;
  c.posterior.window = 64;
  c.posterior.moves_per_tick = 64;
  return c;
}

std::vector<AccuracyTask> two_unknowns() {
  std::vector<AccuracyTask> all;
  for (const AccuracyTask& t : accuracy_tasks())
    if (t.inferred.size() == 2) all.push_back(t);
  return all;
}

/// Ten runs a task at half the benchmark's particles. Its goals hold for 1024: median loss .05, worst 3; here the
/// median of forty losses may scatter by their deviation / sqrt(40), about .05 more.
TEST(Accuracy, AsSharpAsTheExactPosterior) {
  std::vector<double> loss;
  for (const AccuracyTask& task : two_unknowns())
    for (std::uint64_t seed = kFirstSeed; seed < kFirstSeed + 10; ++seed) {
      const Accuracy a = compare(task, with_engine(task, seed), make_episode(task, 0.03, kEpisodeTicks, seed), seed);
      loss.push_back(-a.gap());
      EXPECT_EQ(a.faults, 0u);
    }
  std::printf("loss in nats: median %.3f, worst %.2f\n", quantile_of(loss, 0.5), quantile_of(loss, 1.0));
  EXPECT_LT(quantile_of(loss, 0.5), 0.10);
  EXPECT_LT(quantile_of(loss, 1.0), 3.0);
}

/// Truths drawn from the prior, 200 runs of 60 ticks: sixteen statements, judged together at 99 %.
TEST(Accuracy, RanksAreUniform) {
  Family family;
  for (const AccuracyTask& task : two_unknowns()) {
    std::vector<Ranks> ranks(task.inferred.size());
    for (std::uint64_t seed = kFirstSeed; seed < kFirstSeed + 200; ++seed) {
      const EngineResult r = run_engine(task, with_engine(task, seed), make_episode(task, 0.1, 60, seed));
      for (std::size_t j = 0; j < ranks.size(); ++j) ranks[j].add(r.rank[j]);
    }
    for (const Ranks& r : ranks) {
      std::printf("%s: 90 %% intervals cover %d of %d, p of the histogram %.3f\n", task.name.c_str(), r.inside90,
                  r.runs, r.p_value());
      family.add(r);
    }
  }
  EXPECT_EQ(family.coverage_out(), 0);
  EXPECT_EQ(family.uneven(), 0);
}

}  // namespace
