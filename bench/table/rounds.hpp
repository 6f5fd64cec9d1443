#pragma once

// How a program takes part in a comparison: it is started once, and answers every line on its standard input with one
// line of JSON. So the driver can let the programs take turns on one core, and a disturbance of the machine meets all.
//
//   check   ->  {"name": {"figure": cost reached, "optimum": known, "iterations": n}, ...}
//   round   ->  {"name": CPU seconds of one call, ...}

#include <cstdio>
#include <cstring>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

namespace tiller::bench {

inline double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Contender {
  std::string name;
  std::function<void()> call;  ///< one solve
  std::string facts;           ///< JSON members for `check`: what it reached
  double calls_share = 1.0;    ///< a call counts as this many of the unit in question (iterations a solve)
};

/// CPU seconds a call, over as many calls as take `least_s`.
inline double time_call(const std::function<void()>& call, double least_s = 0.02) {
  long calls = 1;
  for (;;) {
    const double begin = cpu_seconds();
    for (long i = 0; i < calls; ++i) call();
    const double spent = cpu_seconds() - begin;
    if (spent >= least_s) return spent / static_cast<double>(calls);
    calls =
        spent > 0.1 * least_s ? static_cast<long>(1.2 * static_cast<double>(calls) * least_s / spent) + 1 : 8 * calls;
  }
}

inline int take_part(const std::vector<Contender>& all) {
  char line[256];
  while (std::fgets(line, sizeof line, stdin)) {
    const bool check = !std::strncmp(line, "check", 5);
    std::printf("{");
    for (std::size_t i = 0; i < all.size(); ++i) {
      std::printf("%s\"%s\": ", i ? ", " : "", all[i].name.c_str());
      if (check)
        std::printf("{%s}", all[i].facts.c_str());
      else
        std::printf("%.6e", time_call(all[i].call) / all[i].calls_share);
    }
    std::printf("}\n");
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace tiller::bench
