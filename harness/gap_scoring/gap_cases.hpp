#pragma once

// The cases that `tiller gap` is scored on, and one row of results for each.

#include <cstdint>
#include <string>
#include <vector>

#include "harness/gap_scoring/gap_score.hpp"
#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::bench {

struct GapCase {
  std::string section;  ///< "sealed", "null", "two", "outside"
  std::uint64_t seed = 1;
  CaseWanted wanted;       ///< its seed is 16 x the case's, plus the noise's place: no two cells share their draws
  std::string id() const;  ///< "sealed/pendulum/tilt/0.002/7"; no comma, no blank
};

/// Scoring seeds count from 31, tuning seeds from 100001: thresholds are frozen before the former are drawn. Seeds 1 to
/// 30 are those of earlier engines, whose errors on them have been looked at.
constexpr std::uint64_t kFirstScoringSeed = 31, kFirstTuningSeed = 100001;

struct CasePlan {
  std::uint64_t first_seed = kFirstScoringSeed;
  std::uint32_t seeds = 0;                 ///< per cell of the section; 0: the section's own number
  std::vector<std::string> plants, kinds;  ///< empty: all
  std::vector<double> noises = {3e-4, 2e-3, 1e-2};
};
/// All cases of a section, in an order in which a run that is cut short has seen every cell about equally often.
///   sealed    every plant x kind of the catalogue x noise x seeds (10)
///   null      every plant x excitation x noise x seeds (12)
///   two       plant x noise x seeds (12), pairs of kinds by the seed; related kinds are no pair
///   outside   every plant x kind that the catalogue lacks x seeds (4), noise by the seed
/// Excitation, encoder step and process noise go by cell and seed.
std::vector<GapCase> plan_cases(const std::string& section, const CasePlan& plan);

/// One line of results.csv.
struct GapRow {
  std::string id, section, plant, truth, excitation, verdict, answer, outcome, sets, note;
  double noise = 0, encoder_step = 0, process_sd = 0, r = 0;
  std::uint64_t seed = 0;
  double nominal_sigma = 0, remaining_sigma = 0;
  double gap_before = 0, gap_after = 0, gap_oracle = 0;  ///< 1 s rollouts on the scoring runs, sigma; NaN: none
  double covered = 0, intervals = 0;                     ///< true parameters inside their 95 %, and how many were asked
  double oracle_covered = 0, oracle_intervals = 0;       ///< the same of the oracle's fit
  double cpu_s = 0, memory_megabytes = 0, world_s = 0;
};
std::string row_header();
std::string row_text(const GapRow& row);
/// Rows of a results file; of rows with the same id the last. Empty if there is none.
std::vector<GapRow> read_rows(const std::string& path);

/// Effects of an answer by name.
EffectSet names_of(const std::vector<tools::gap::EffectAt>& effects, const tiller_model_t& model);

/// Makes the world, asks find_gap(), judges. `folder` holds its files and is emptied. `oracle`: also fits the truth.
/// `keep` leaves them there.
GapRow run_case(const GapCase& c, const std::string& folder, bool oracle, bool keep = false);

}  // namespace tiller::bench
