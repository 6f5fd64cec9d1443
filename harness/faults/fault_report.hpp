#pragma once

#include <functional>
#include <string>
#include <vector>

#include "harness/faults/fault.hpp"

namespace tiller::faults {

/// All runs of one kind.
struct KindResult {
  int runs = 0, wrong = 0;
  int stopped = 0;
  double worst_stop_s = 0.0;
  std::string first_wrong;
};

/// Seeds 1..`seeds` on each of `robots`.
KindResult run_kind(const Fault& fault, std::uint64_t seeds,
                    const std::vector<Robot>& robots = {Robot::kPendulum, Robot::kCartPole});

/// The same with a run of one's own.
KindResult run_kind(std::uint64_t seeds, const std::vector<Robot>& robots,
                    const std::function<Outcome(Robot, std::uint64_t)>& one);

/// A line for whoever watches, flushed.
void print_line(const Fault& fault, const KindResult& result);

/// A row of the table of docs/evidence/faults.md: group, fault, route, answer, when it stopped, allowed.
std::string page_row(const Fault& fault, const KindResult& result);

}  // namespace tiller::faults
