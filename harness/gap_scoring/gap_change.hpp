#pragma once

// Pairs of the same robot before and after one change, for `tiller gap --before --after`: logs of an ODE plant that has
// dry friction which its robot file lacks, and what changed under seal.

#include <cstdint>
#include <string>
#include <vector>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::bench {

struct ChangeWanted {
  std::string plant = "pendulum";
  std::string what = "none";  ///< one of changes()
  double noise_sd = 2e-3;
  Excitation excitation = Excitation::open_loop;
  std::size_t logs = 6;  ///< before, and as many after; 8 s each
  std::uint64_t seed = 1;
  std::string id() const;  ///< "pendulum/mass/0.002/open_loop/7"
};

/// "none"; "mass", 15 to 40 % more of the first link's or body's; "gain", 10 to 25 % less of the first motor's;
/// "friction", half as much again to twice and a half at the first joint; "delay", 10 to 30 ms of the first command.
const std::vector<std::string>& changes();

struct ChangePair {
  std::string robot_toml;
  World before, after;  ///< names and `work` alone
  std::string port;     ///< where it changed
  double was = 0, is = 0;
};
bool make_change(const ChangeWanted& wanted, ChangePair& pair, std::string& error);

/// The model of before, then what changed: what the command does.
tools::gap::Result find_change(const std::string& robot_toml, const std::vector<tools::Log>& before,
                               const std::vector<tools::Log>& after, std::string& error);

struct ChangeRow {
  std::string id, what, verdict, answer, outcome, note;
  double was = 0, is = 0, found = 0, low = 0, high = 0;  ///< of the change: NaN where it was not found
  double frozen_sigma = 0, cpu_s = 0;
};
/// outcome: "named" (of "none": unchanged), "in_set" (the truth is among equals), "missed" (no change was reported, or
/// one without a name), "wrong" (a name without the truth), "no_pair".
ChangeRow run_change(const ChangeWanted& wanted);

}  // namespace tiller::bench
