// Episodes whose prior is refitted to each one's log, as SimOpt does between real rollouts: what controls, what is
// read, how far a step goes, what it brings, and what is refused before anything moves.

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "effects/effect_info.hpp"
#include "episodes_rig.hpp"
#include "read_all.hpp"
#include "tools/base/exit_codes.hpp"
#include "tools/identify/identify_fit.hpp"
#include "tools/identify/laboratory.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/refit/refit_prior.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

using test::Plants;
using test::read_all;
using test::small_robot;

RefitOptions quick(const std::string& method, double kl = 1.0) {
  RefitOptions refit;
  refit.method = method;
  refit.how.simulations = 4000;
  refit.how.iterations = 1;
  refit.how.kl = kl;
  return refit;
}

/// SimOpt controls with the prior as it is and learns between the episodes alone.
RobotFile without_learning(RobotFile robot) {
  robot.config.posterior.enabled = 0;
  return robot;
}

class RefitEpisodes : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string why; !laboratory_is_ready(why)) GTEST_SKIP() << why;
    std::string made = (fs::temp_directory_path() / "tiller-refit-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    options_.run.seconds = 1.0;
    options_.run.quiet = true;
    options_.refit = make_refit(quick("simopt"));
  }
  void TearDown() override {
    if (!folder_.empty()) fs::remove_all(folder_);
  }

  EpisodesResult run(std::uint32_t episodes, const std::string& file, const RobotFile& robot) {
    options_.episodes = episodes;
    options_.posterior = file.empty() ? file : folder_ + "/" + file;
    plants_ = Plants{};
    return run_episodes(robot, options_, plants_.open());
  }
  EpisodesResult run(std::uint32_t episodes, const std::string& file) {
    return run(episodes, file, without_learning(small_robot()));
  }
  StoredPosterior stored(const std::string& file) const {
    StoredPosterior posterior;
    Words errors;
    EXPECT_TRUE(read_posterior(folder_ + "/" + file, posterior, errors)) << join(errors, "\n");
    return posterior;
  }

  std::string folder_;
  EpisodesOptions options_;
  Plants plants_;
};

TEST_F(RefitEpisodes, ThePriorControlsAndTheLogMovesIt) {
  const EpisodesResult r = run(1, "a.json");
  ASSERT_EQ(r.exit_code, kExitOk);
  ASSERT_EQ(r.rows.size(), 1u);
  // uniform on [.05, .15] all through the episode; the mean of its 64 particles, evenly spread, is off by a thousandth
  EXPECT_NEAR(r.last.info.param_mean[1], 0.1, 1e-3);
  EXPECT_NEAR(r.last.info.param_sd[1], 0.1 / std::sqrt(12.0), 1e-3);
  // half_length_m decides the swing: a second of it is worth more than a step of one nat in two parameters allows
  EXPECT_LT(r.rows[0].sd[1], 0.7 * r.last.info.param_sd[2]);
  EXPECT_NE(r.rows[0].note.find("discrepancy "), std::string::npos) << r.rows[0].note;
  const StoredPosterior posterior = stored("a.json");
  EXPECT_EQ(posterior.mixture.components(), 1u);
  EXPECT_EQ(posterior.episodes, 1u);
  EXPECT_EQ(posterior.params, (Words{"pole_mass_kg", "half_length_m"}));
  EXPECT_EQ(posterior.is_logarithm, (std::vector<bool>{false, true}));
  EXPECT_NEAR(static_cast<double>(posterior.transitions), 50, 2);
  EXPECT_NEAR(std::exp(posterior.mixture.mean[1]), r.rows[0].mean[1], 0.1 * r.rows[0].mean[1]);
}

/// The same bits as `tiller identify --method simopt` from a record of the episode.
TEST_F(RefitEpisodes, ReadsWhatIdentifyReadsOfARecord) {
  options_.run.files.records = {folder_ + "/run.rec"};
  ASSERT_EQ(run(1, "a.json").exit_code, kExitOk);
  const RobotFile robot = without_learning(small_robot());
  Log log;
  std::string error;
  ASSERT_TRUE(read_any_log(folder_ + "/run.rec", robot, log, error)) << error;
  FitOptions options;
  options.method = "simopt";
  options.how = quick("simopt").how;
  const std::vector<Grid> grids = make_grids(log, LogMap(), robot.config);
  const Candidate whole = make_candidates(robot).back();
  MethodProblem problem;
  problem.config = &whole.config;
  problem.params = whole.params;
  problem.grids = &grids;
  problem.options = options.how;
  MethodResult found;
  ASSERT_TRUE(run_in_laboratory("simopt", problem, found, error)) << error;
  const GaussianMixture kept = stored("a.json").mixture;
  EXPECT_EQ(kept.mean, found.mean);
  EXPECT_EQ(kept.covariance, found.covariance);
}

TEST_F(RefitEpisodes, SameSeedSameBitsAndResumedIsAsIfNeverStopped) {
  (void)run(3, "straight.json");
  options_.run.threads = 2;
  (void)run(2, "resumed.json");
  const EpisodesResult r = run(1, "resumed.json");
  EXPECT_EQ(r.rows.at(0).episode, 3u);
  EXPECT_EQ(read_all(folder_ + "/straight.json"), read_all(folder_ + "/resumed.json"));
  EXPECT_EQ(plants_.seeds.size(), 1u);
}

/// KL(N(m1, S1) || N(m0, S0)).
double divergence(const GaussianMixture& to, const GaussianMixture& from) {
  const auto d = static_cast<Eigen::Index>(to.dimension);
  const Eigen::Map<const Eigen::MatrixXd> s1(to.covariance.data(), d, d), s0(from.covariance.data(), d, d);
  const Eigen::Map<const Eigen::VectorXd> m1(to.mean.data(), d), m0(from.mean.data(), d);
  const Eigen::MatrixXd inverse = s0.inverse();
  return 0.5 * ((inverse * s1).trace() - static_cast<double>(d) + (m1 - m0).dot(inverse * (m1 - m0)) +
                std::log(s0.determinant() / s1.determinant()));
}

/// The Gaussian with the moments of weighted draws is nearer to what they were drawn from than the weights are to equal
/// ones, so that the bound of the weights bounds the step from an episode's prior to the next one's. Cut off by the
/// bounds is a share of less than a tenth of the draws: that adds log(1 / 0.9).
TEST_F(RefitEpisodes, AStepGoesAsFarAsTheBound) {
  for (const double asked : {0.25, 1.0, std::nan("")}) {
    const double kl = std::isnan(asked) ? 2.0 : asked;  // one for each learnt parameter
    options_.refit = make_refit(quick("simopt", asked));
    const std::string name = format("kl%g.json", kl);
    (void)run(1, name);
    const GaussianMixture first = stored(name).mixture;
    (void)run(1, name);
    const double step = divergence(stored(name).mixture, first);
    EXPECT_LT(step, kl + 0.11) << kl;
    EXPECT_GT(step, 0.3 * kl) << "the bound decides the step while the prior is wide";
  }
}

/// Poles of 0.15 to 1.2 m half length and a plan that is long enough to swing them up, against the same prior kept.
TEST_F(RefitEpisodes, SimOptApproachesTheTruthAndCostsLess) {
  RobotFile robot = without_learning(small_robot());
  robot.config.planner.horizon = 100;
  robot.config.planner.knots = 16;
  robot.config.planner.rollouts = 128;
  robot.config.planner.particles = 4;
  robot.config.planner.iterations = 2;
  robot.config.priors[1] = {tiller_prior_uniform, 0, 0, 0, 0.02, 0.5};
  robot.config.priors[2] = {tiller_prior_uniform, 0, 0, 0, 0.15, 1.2};
  options_.run.seconds = 3.0;
  double refitted = 0, kept = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    robot.config.seed = robot.sim.seed = seed;
    options_.refit = make_refit(quick("simopt"));
    const EpisodesResult simopt = run(4, "", robot);
    ASSERT_EQ(simopt.rows.size(), 4u);
    const double truth_m = plants_.truths[0][2];
    // a step of one nat in two parameters halves each deviation or so; four of them leave a tenth. The prior's is .3 m
    EXPECT_NEAR(simopt.rows.back().mean[1], truth_m, 0.05) << "seed " << seed;
    EXPECT_LT(simopt.rows.back().sd[1], 0.1) << "seed " << seed;
    options_.refit = {};
    const EpisodesResult frozen = run(4, "", robot);
    ASSERT_EQ(frozen.rows.size(), 4u);
    EXPECT_EQ(frozen.rows[0].cost, simopt.rows[0].cost) << "the first episode is the prior's in both";
    for (std::size_t e = 1; e < 4; ++e) refitted += simopt.rows[e].cost, kept += frozen.rows[e].cost;
  }
  EXPECT_LT(refitted, 0.9 * kept) << "mean cost " << refitted / 9 << " against " << kept / 9;
}

TEST_F(RefitEpisodes, RepsKeepsAMixtureOfItsWeightedDraws) {
  RefitOptions reps = quick("reps");
  reps.how.eta = 1.0;
  options_.refit = make_refit(reps);
  const EpisodesResult r = run(2, "reps.json");
  ASSERT_EQ(r.rows.size(), 2u);
  EXPECT_NE(r.rows[0].note.find("mean log likelihood"), std::string::npos) << r.rows[0].note;
  EXPECT_LT(r.rows[1].sd[1], r.rows[0].sd[1]);
  EXPECT_EQ(stored("reps.json").particles, 512u);
}

TEST_F(RefitEpisodes, TooShortAnEpisodeStopsTheSeries) {
  options_.run.seconds = 0.3;
  testing::internal::CaptureStderr();
  const EpisodesResult r = run(2, "short.json");
  const std::string told = testing::internal::GetCapturedStderr();
  EXPECT_EQ(r.exit_code, kExitBadInput);
  EXPECT_TRUE(r.rows.empty());
  EXPECT_NE(told.find("episode 1:1: 15 ticks with a measurement are too few to learn from"), std::string::npos) << told;
  EXPECT_NE(told.find("make the episodes longer (--seconds); the prior stays as it was"), std::string::npos) << told;
  EXPECT_FALSE(fs::exists(folder_ + "/short.json"));
}

TEST_F(RefitEpisodes, NothingToRefitIsRefusedBeforeAPlantOpens) {
  RobotFile robot = without_learning(small_robot());
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i)
    robot.config.priors[i] = {tiller_prior_fixed, 0, 0.5, 0, -INFINITY, INFINITY};
  testing::internal::CaptureStderr();
  EXPECT_EQ(run(2, "", robot).exit_code, kExitBadInput);
  const std::string told = testing::internal::GetCapturedStderr();
  EXPECT_NE(told.find("small.toml: [parameters]: no parameter has a prior"), std::string::npos) << told;
  EXPECT_TRUE(plants_.truths.empty());
}

// Whatever has a state that no log shows, by the catalogue: a limiter and a play as well as a lag.
TEST_F(RefitEpisodes, AnEffectWithMemoryIsRefusedBySingleStepsAlone) {
  int refused = 0;
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    RobotFile robot = small_robot();
    if (info.learnt || info.port == PortKind::sensor || !port_fits(info, 0, *robot.config.model)) continue;
    robot.config.effect_count = 1;
    robot.config.effects[0] = {kind, 0};
    for (int i = 0; i < info.param_count; ++i) {
      robot.config.priors[robot.config.param_count++] = {tiller_prior_uniform, 0, 0, 0, 0.01, 0.1};
      robot.names.params.emplace_back(std::string("effect.") + info.params[i].name);
    }
    std::string error;
    EXPECT_EQ(check_refit(quick("simopt"), robot, error), info.state_count == 0) << info.name << ": " << error;
    if (info.state_count > 0) {
      const std::string wanted = std::string("small.toml: --method simopt: the effect ") + info.name + " has a state";
      EXPECT_NE(error.find(wanted), std::string::npos) << error;
      EXPECT_NE(error.find("trajectory_simopt"), std::string::npos) << error;
      ++refused;
    }
    error.clear();
    EXPECT_TRUE(check_refit(quick("trajectory_simopt"), robot, error)) << info.name << ": " << error;
  }
  EXPECT_GE(refused, 3);  // a lag, a rate limit and a supply at least
}

}  // namespace
}  // namespace tiller::tools
