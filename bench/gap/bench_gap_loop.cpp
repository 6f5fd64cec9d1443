// ./dev bench gap loop: does the robot file that `tiller gap` writes control better? A cart-pole (ODE) with dry
// friction or a delay that its model lacks tracks a reference with a hanging pole; `tiller gap` reads three runs of 10
// s of that very controller and adds what it finds; the same controller, plant and noise track again with the new file.
//
// Cost: the task's own, mean per tick, of the true states. Every seed draws plant, strength of the effect and noise;
// none is left out, and a run that failed counts as lost. Settings were chosen on seeds 100001 .. 100004 (--tune).
//
// Goal: the new file is better on 15 of 20 seeds. Were either file as likely to win a seed as the other, that many wins
// would come with probability 0.021 (one-sided sign test).

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "harness/gap_loop/gap_loop.hpp"

namespace {

using namespace tiller;

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v.empty() ? NAN : v[static_cast<std::size_t>(std::lround(q * static_cast<double>(v.size() - 1)))];
}

/// Chance of `wins` or more of n fair coins.
double sign_test(int wins, int n) {
  double sum = 0;
  for (int k = wins; k <= n; ++k)
    sum += std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) - n * std::log(2.0));
  return sum;
}

void loop_of(bench::Table& table, bench::HiddenEffect hidden, std::uint64_t first, int seeds) {
  std::vector<double> before, after, ratio;
  int wins = 0, right = 0, failed = 0;
  for (int s = 0; s < seeds; ++s) {
    bench::LoopCase which;
    which.hidden = hidden;
    which.seed = first + static_cast<std::uint64_t>(s);
    const bench::LoopOutcome o = bench::close_loop(which);
    std::printf("  seed %llu: %s %.3g, gap says %s%s%s, rollouts %.2f -> %.2f sigma, cost %.4g -> %.4g%s\n",
                static_cast<unsigned long long>(which.seed), bench::hidden_name(hidden), o.truth,
                tools::gap::verdict_name(o.verdict), o.named.empty() ? "" : ": ", o.named.c_str(), o.gap_before,
                o.gap_after, o.before, o.after, o.failed ? " FAILED" : "");
    std::fflush(stdout);
    failed += o.failed ? 1 : 0;
    right += o.right ? 1 : 0;
    if (o.failed) continue;
    before.push_back(o.before), after.push_back(o.after), ratio.push_back(o.after / o.before);
    wins += o.after < o.before ? 1 : 0;
  }
  char text[96];
  std::snprintf(text, sizeof text, "hidden %s, %d seeds from %llu", bench::hidden_name(hidden), seeds,
                static_cast<unsigned long long>(first));
  table.heading(text);
  table.row("seeds on which the new file is better", wins, "", bench::at_least(std::ceil(0.75 * seeds)));
  table.row("sign test: chance of as many wins if nothing changed", sign_test(wins, seeds), "");
  table.row("tracking cost, old file: median", quantile(before, 0.5), "");
  table.row("tracking cost, new file: median", quantile(after, 0.5), "");
  table.row("new over old, paired: lower quartile", quantile(ratio, 0.25), "");
  table.row("new over old, paired: median", quantile(ratio, 0.5), "", bench::at_most(0.95));
  table.row("new over old, paired: upper quartile", quantile(ratio, 0.75), "");
  table.row("seeds on which the hidden effect alone was named", right, "");
  table.row("failed runs", failed, "", bench::at_most(0));
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t first = 1;
  int seeds = 20;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--tune")) {
      first = 100001;
    } else if (!std::strcmp(argv[i], "--seeds") && i + 1 < argc && bench::whole_number(argv[i + 1]) > 0) {
      seeds = bench::whole_number(argv[++i]);
    } else {
      std::fprintf(stderr, "usage: bench_gap_loop [--seeds N] [--tune]\n");
      return 2;
    }
  }
  bench::Table table;
  loop_of(table, bench::HiddenEffect::dry_friction, first, seeds);
  loop_of(table, bench::HiddenEffect::delay, first, seeds);
  return table.finish();
}
