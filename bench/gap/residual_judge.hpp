#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "harness/gap_worlds/gap_worlds.hpp"

namespace tiller::bench {

inline double median(std::vector<double> v) {
  if (v.empty()) return NAN;
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

struct Judged {
  double before = NAN, after = NAN;  // rollouts of 1 s, RMS in sensor deviations
  double covered = 0, intervals = 0;
  double spread_ratio = NAN;  // of particles, where no data were over where they were
  double evidence = NAN, cpu_s = NAN;
  bool offered = false;
};

/// Fits the unnamed effect to a world's work logs and judges it on the scoring runs. False with a sentence in `error`.
bool judge(const WorldCase& wanted, Judged& out, std::string& error);

}  // namespace tiller::bench
