#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tools/run/run_loop.hpp"

namespace tiller::tools {

/// A prior that was refitted to an episode's log, in the place of the online posterior.
struct RefittedPrior {
  StoredPosterior posterior;     ///< robot, episodes and transitions are the series' to fill in
  std::vector<double> mean, sd;  ///< (d) of the inferred parameters
  std::string note;              ///< what the refit came to, for the episode's line
};

/// `robot` has the episode's prior and seeds. False with a sentence in `error`.
using RefitPrior = std::function<bool(const RobotFile& robot, const Log& log, RefittedPrior& out, std::string& error)>;

/// Episodes one after the other: Online BayesSim's alternation (Possas et al., "Online BayesSim for combined simulator
/// parameter inference and policy improvement", IROS 2020, algorithm 1) with the particle posterior in the place of a
/// conditional density. The posterior of an episode is the prior of the next one's control. With `refit`, the prior is
/// refitted to each episode's log instead (SimOpt: Chebotar et al., ICRA 2019, algorithm 1).
struct EpisodesOptions {
  std::uint32_t episodes = 1;
  RefitPrior refit;       ///< empty: the online posterior is carried over
  std::string posterior;  ///< loaded if it is there, written after every complete episode; empty: kept in memory
  bool load = true;       ///< false: only written
  RunOptions run;         ///< of each; log and record get the episode's number before their ending
  bool simulated = true;  ///< false: somebody puts the robot back between episodes, and each waits for it
};

/// The result of one episode.
struct EpisodeRow {
  std::uint64_t episode = 0;  ///< 1 is the first that the posterior went through, in this call or before
  double cost = 0, time_s = 0;
  std::vector<double> mean, sd;  ///< (d) of the inferred parameters, after it
  std::string note;              ///< of the refit; empty: none
};

/// The link of one episode. `robot` has that episode's seeds; true_params (param_count) where they are known. Null with
/// a message in `error`. It lives until the next call.
using OpenEpisode = std::function<Link*(const RobotFile& robot, std::vector<double>& true_params, std::string& error)>;

struct EpisodesResult {
  int exit_code = 0;
  std::vector<EpisodeRow> rows;
  RunResult last;  ///< of the last episode that ran, complete or not
};

/// Stops at the first episode that ends in SAFE, is interrupted or cannot be refitted to: the last complete one's
/// posterior stands. Tells its progress on stdout, what goes wrong on stderr.
EpisodesResult run_episodes(RobotFile robot, const EpisodesOptions& options, const OpenEpisode& open);

/// Costs, and means and deviations of each inferred parameter, by episode.
std::string episodes_table(const RobotFile& robot, const std::vector<EpisodeRow>& rows);

/// Seed of episode `index` (0 is the first): the first has the robot file's own.
std::uint64_t episode_seed(std::uint64_t seed, std::uint64_t index);

/// Makes `robot` that of an episode: seeds of controller and noise; the plant's truth keeps its seed.
void seed_episode(RobotFile& robot, std::uint64_t index);

}  // namespace tiller::tools
