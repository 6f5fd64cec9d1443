// The whole loop on the ODE cart-pole, in lockstep: what `./dev bench loop` measures, held to its goals.
//
// Seeds 1..20 draw truth and noise. The bounds are goals of the project, not what happened to come out: 19 of 20
// upright; 90 % intervals that cover in 15 of 20 (of a binomial .9, fewer than 15 has probability 1.1 %); and a
// standard deviation that shrinks at least fivefold.

#include <gtest/gtest.h>

#include <cstdlib>
#include <map>

#include "harness/episode/episode.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller {
namespace {

using bench::EpisodeOptions;
using bench::EpisodeResult;

const tools::RobotFile& cart_pole() {
  static const auto robot = [] {
    std::string errors;
    auto r = tools::read_robot_file(TILLER_ROBOTS "/cart_pole.toml", errors);
    if (!r) {
      ADD_FAILURE() << errors;
      std::abort();
    }
    return r;
  }();
  return *robot;
}

EpisodeResult run(const EpisodeOptions& options) {
  EpisodeResult r = bench::run_episode(cart_pole(), options);
  EXPECT_EQ(r.error, "");
  return r;
}

// Instrumented builds are twenty times slower: they check memory and threads, not statistics.
#ifdef TILLER_FEW_SEEDS
constexpr std::uint64_t kSeeds = 1;
#else
constexpr std::uint64_t kSeeds = 20;
#endif

class SwingUp : public ::testing::TestWithParam<tiller_planner_kind_t> {};
INSTANTIATE_TEST_SUITE_P(Planners, SwingUp, ::testing::Values(tiller_planner_mppi, tiller_planner_cem),
                         [](const auto& test) { return test.param == tiller_planner_mppi ? "mppi" : "cem"; });

TEST_P(SwingUp, TwentySeeds) {
  std::uint64_t upright = 0;
  std::map<std::string, std::uint64_t> covered;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    EpisodeOptions options;
    options.seed = seed;
    options.planner = GetParam();
    const EpisodeResult r = run(options);
    upright += r.upright();
    std::printf("seed %2llu: %s from %.2f s", static_cast<unsigned long long>(seed), r.upright() ? "upright" : "NOT",
                r.upright_from_s);
    for (const auto& p : r.parameters) {
      covered[p.name] += p.covered();
      EXPECT_GE(p.shrink(), 5.0) << p.name << ", seed " << seed;
      std::printf("  %s %.4g in [%.4g, %.4g]", p.name.c_str(), p.truth, p.q05, p.q95);
    }
    std::printf("\n");
    EXPECT_EQ(r.state, tiller_state_active);
    EXPECT_EQ(r.rejected, 0u);
  }
  EXPECT_GE(upright, kSeeds - 1);
  EXPECT_EQ(covered.size(), 3u);
  if (kSeeds == 20) {
    for (const auto& [name, n] : covered) EXPECT_GE(n, 15u) << name;
  }
}

TEST(Lockstep, SameSeedSameBitsForAnyNumberOfThreads) {
  for (auto planner : {tiller_planner_mppi, tiller_planner_cem, tiller_planner_random_shooting}) {
    EpisodeOptions options;
    options.planner = planner;
    options.seconds = 2.0;  // a hundred ticks, most of the swing-up: one other bit would grow from there on
    const EpisodeResult first = run(options), again = run(options);
    options.threads = 2;
    const EpisodeResult two = run(options);
    options.threads = 1;
    options.seed = 2;
    const EpisodeResult other = run(options);
    EXPECT_EQ(first.command_hash, again.command_hash);
    EXPECT_EQ(first.command_hash, two.command_hash);
    EXPECT_NE(first.command_hash, other.command_hash);
    for (std::size_t i = 0; i < first.parameters.size(); ++i) {
      EXPECT_EQ(first.parameters[i].mean, two.parameters[i].mean);
      EXPECT_EQ(first.parameters[i].sd, two.parameters[i].sd);
    }
  }
}

}  // namespace
}  // namespace tiller
