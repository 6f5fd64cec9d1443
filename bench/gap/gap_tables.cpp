#include "bench/gap/gap_tables.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "bench/table/bench_table.hpp"

namespace tiller::bench {
namespace {

using Rows = std::vector<const GapRow*>;

template <class F>
Rows where(const Rows& rows, const F& keep) {
  Rows kept;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(kept), [&](const GapRow* r) { return keep(*r); });
  return kept;
}

template <class F>
double percent(const Rows& rows, const F& yes) {
  if (rows.empty()) return NAN;
  return 100.0 * static_cast<double>(where(rows, yes).size()) / static_cast<double>(rows.size());
}

auto is(const char* outcome) {
  return [outcome](const GapRow& r) { return r.outcome == outcome; };
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1)))];
}

template <class F>
std::size_t distinct(const Rows& rows, const F& of) {
  std::set<std::string> seen;
  for (const GapRow* r : rows) seen.insert(of(*r));
  return seen.size();
}

/// Least k with P(X <= k) >= q for X ~ binomial(n, p).
double binomial_quantile(double n, double p, double q) {
  double sum = 0, k = -1;
  while (++k <= n) {
    sum += std::exp(std::lgamma(n + 1) - std::lgamma(k + 1) - std::lgamma(n - k + 1) + k * std::log(p) +
                    (n - k) * std::log1p(-p));
    if (sum >= q) break;
  }
  return k;
}

std::string counted(const char* text, const Rows& rows) {
  return std::string(text) + " (n = " + std::to_string(rows.size()) + ")";
}

std::string kinds_of(const std::string& set) {
  std::string text;
  for (const EffectName& e : split_set(set)) text += (text.empty() ? "" : "+") + kind_of(e);
  return text.empty() ? "none" : text;
}

/// By true kinds: how many were answered how, and what was said where it was not the truth.
void print_confusion(const Rows& rows) {
  if (rows.empty()) return;
  std::map<std::string, Rows> by_kind;
  for (const GapRow* r : rows) by_kind[kinds_of(r->truth)].push_back(r);
  std::printf("\n  %-44s %5s %6s %6s %5s %5s %7s %5s  %s\n", "truth", "n", "exact", "in set", "part", "none", "unnamed",
              "wrong", "said instead");
  for (const auto& entry : by_kind) {
    const std::string& kind = entry.first;
    const Rows& of = entry.second;
    std::map<std::string, int> said;
    for (const GapRow* r : where(of, [](const GapRow& x) { return x.outcome == "wrong" || x.outcome == "part"; }))
      ++said[kinds_of(r->answer)];
    std::string text;
    for (const auto& [answer, count] : said) text += " " + answer + (count > 1 ? " x" + std::to_string(count) : "");
    const auto count = [&](const char* o) { return static_cast<int>(where(of, is(o)).size()); };
    std::printf("  %-44s %5zu %6d %6d %5d %5d %7d %5d %s\n", kind.c_str(), of.size(), count("exact"), count("in_set"),
                count("part"), count("none"), count("unnamed"), count("wrong"), text.c_str());
  }
}

/// By r, the nominal model's rollout error over 1 s in sensor deviations. Two readings of "nominal": the robot file's
/// model after its own parameters were fitted to the data (what is left is what an effect must explain; noise is part
/// of it, so it never falls below 1), and the plant without the effect, its parameters true.
void sealed_by(Table& table, const Rows& rows, const char* reading, double GapRow::*ratio) {
  const Rows strong = where(rows, [&](const GapRow& r) { return r.*ratio >= 3; });
  const Rows middle = where(rows, [&](const GapRow& r) { return r.*ratio >= 1.5 && r.*ratio < 3; });
  const Rows weak = where(rows, [&](const GapRow& r) { return r.*ratio < 1.5; });
  table.heading(std::string("sealed single effects by r of the ") + reading + ": " +
                std::to_string(distinct(rows, [](auto& r) { return kinds_of(r.truth); })) + " kinds, " +
                std::to_string(distinct(rows, [](auto& r) { return r.plant; })) + " plants, " +
                std::to_string(rows.size()) + " cases");
  table.row(counted("r >= 3: exact", strong), percent(strong, is("exact")), "%", at_least(97));
  table.row("  of these, without an alias beside it",
            percent(where(strong, is("exact")), [](auto& r) { return r.sets.find('|') == std::string::npos; }), "%");
  table.row("r >= 3: in the reported set, exact or not",
            percent(strong, [](auto& r) { return r.outcome == "exact" || r.outcome == "in_set"; }), "%");
  table.row("r >= 3: wrong outside the reported set", percent(strong, is("wrong")), "%", at_most(1));
  table.row(counted("1.5 <= r < 3: exact", middle), percent(middle, is("exact")), "%");
  table.row("1.5 <= r < 3: wrong", percent(middle, is("wrong")), "%");
  table.row(counted("r < 1.5: exact", weak), percent(weak, is("exact")), "%");
  table.row("r < 1.5: wrong", percent(weak, is("wrong")), "%", at_most(1));
  for (const double noise : {3e-4, 2e-3, 1e-2}) {
    const Rows of = where(strong, [&](const GapRow& r) { return r.noise == noise; });
    char text[48];
    std::snprintf(text, sizeof text, "  noise %g: exact", noise);
    if (!of.empty()) table.row(counted(text, of), percent(of, is("exact")), "%");
  }
  for (const char* plant : {"pendulum", "cart_pole", "two_link_arm", "linear_axis"}) {
    const Rows of = where(strong, [&](const GapRow& r) { return r.plant == plant; });
    if (!of.empty())
      table.row(counted(("  " + std::string(plant) + ": exact").c_str(), of), percent(of, is("exact")), "%");
  }
  std::printf("\n  r >= 3, by what was hidden:");
  print_confusion(strong);
}

void sealed(Table& table, const Rows& rows) {
  sealed_by(table, rows, "nominal model as fitted", &GapRow::nominal_sigma);
  sealed_by(table, rows, "plant without the effect", &GapRow::r);
}

void oracle(Table& table, const Rows& rows) {
  const Rows strong = where(rows, [](const GapRow& r) { return r.r >= 3 && r.gap_oracle > 0 && r.gap_after > 0; });
  if (strong.empty()) return;
  std::vector<double> ratio, before;
  double sum = 0, inside = 0, asked = 0, known_inside = 0, known_asked = 0;
  for (const GapRow* r : strong) {
    ratio.push_back(r->gap_after / r->gap_oracle);
    before.push_back(r->gap_before / r->gap_oracle);
    sum += ratio.back();
    known_inside += r->oracle_covered, known_asked += r->oracle_intervals;
  }
  for (const GapRow* r : rows) inside += r->covered, asked += r->intervals;
  table.heading("beside an oracle that knows the effect, r >= 3, hold-out runs, 1 s (" + std::to_string(strong.size()) +
                " cases)");
  table.row("gap after over the oracle's: mean", sum / static_cast<double>(ratio.size()), "", at_most(1.05));
  table.row("  median", quantile(ratio, 0.5), "");
  table.row("  90 % of cases below", quantile(ratio, 0.9), "");
  table.row("gap before over the oracle's: median", quantile(before, 0.5), "");
  const auto coverage = [&](const char* text, double in, double of) {
    if (of == 0) return;
    char line[96];
    std::snprintf(line, sizeof line, "%s (n = %.0f)", text, of);
    table.row(line, 100 * in / of, "%", at_least(100 * binomial_quantile(of, 0.95, 0.005) / of));
    table.row("  and no wider than they need be", 100 * in / of, "%",
              at_most(100 * binomial_quantile(of, 0.95, 0.995) / of));
  };
  coverage("true parameters inside the 95 % intervals", inside, asked);
  coverage("the same of the oracle's fits", known_inside, known_asked);
}

void null(Table& table, const Rows& rows) {
  table.heading("null runs: nothing hidden");
  const auto alarm = [](const GapRow& r) { return r.outcome != "none"; };
  table.row(counted("false alarms: any verdict but no gap", rows), percent(rows, alarm), "%", at_most(1));
  table.row("  of them with a name", percent(rows, is("wrong")), "%");
  for (const char* way : {"open_loop", "pd_tracking", "planner"}) {
    const Rows of = where(rows, [&](const GapRow& r) { return r.excitation == way; });
    if (!of.empty()) table.row(counted(("  " + std::string(way)).c_str(), of), percent(of, alarm), "%");
  }
  for (const GapRow* r : where(rows, alarm))
    std::printf("    %s: %s %s, nominal %.3g sigma\n", r->id.c_str(), r->verdict.c_str(), r->sets.c_str(),
                r->nominal_sigma);
}

void two(Table& table, const Rows& rows) {
  table.heading("two effects, each r >= 5 by itself");
  table.row(counted("both exact", rows), percent(rows, is("exact")), "%", at_least(95));
  table.row("both in the reported set",
            percent(rows, [](auto& r) { return r.outcome == "exact" || r.outcome == "in_set"; }), "%");
  table.row("wrong outside the reported set", percent(rows, is("wrong")), "%");
  print_confusion(where(rows, [](const GapRow& r) { return r.outcome != "exact"; }));
}

void outside(Table& table, const Rows& rows) {
  const auto named = [](const GapRow& r) { return r.verdict == "named" || r.verdict == "ambiguous"; };
  table.heading("effects that the catalogue lacks, r >= 5: " +
                std::to_string(distinct(rows, [](auto& r) { return kinds_of(r.truth); })) + " kinds");
  table.row(counted("named while more than 1.1 sigma remains", rows),
            percent(rows, [&](const GapRow& r) { return named(r) && r.remaining_sigma > 1.1; }), "%", at_most(0));
  table.row("unnamed or partly explained",
            percent(rows, [](auto& r) { return r.verdict == "unnamed" || r.verdict == "partly_explained"; }), "%",
            at_least(90));
  std::map<std::string, std::map<std::string, int>> by_kind;
  for (const GapRow* r : rows)
    ++by_kind[kinds_of(r->truth)][r->verdict + (r->answer == "none" ? "" : " " + kinds_of(r->answer))];
  for (const auto& [kind, said] : by_kind) {
    std::printf("    %-24s", kind.c_str());
    for (const auto& [answer, count] : said) std::printf("  %d %s", count, answer.c_str());
    std::printf("\n");
  }
}

void cost(Table& table, const Rows& rows) {
  const auto at = [&](const char* section, double q, double GapRow::*what) {
    std::vector<double> values;
    for (const GapRow* r : where(rows, [&](const GapRow& x) { return x.section == section; }))
      values.push_back(r->*what);
    return quantile(values, q);
  };
  if (std::isnan(at("sealed", 0.5, &GapRow::cpu_s))) return;
  table.heading("time and memory on one core, 6 x 8 s of 100 Hz data");
  table.row("one effect: slowest case", at("sealed", 1, &GapRow::cpu_s), "s", at_most(15));
  table.row("  median", at("sealed", 0.5, &GapRow::cpu_s), "s");
  if (const double slowest = at("two", 1, &GapRow::cpu_s); slowest > 0) {
    table.row("two effects: slowest case", slowest, "s", at_most(60));
    table.row("  median", at("two", 0.5, &GapRow::cpu_s), "s");
  }
  table.row("memory after the logs are read: largest", at("sealed", 1, &GapRow::memory_megabytes), "MB");
}

}  // namespace

int print_tables(const std::vector<GapRow>& all, const std::vector<std::string>& sections) {
  Table table;
  Rows made;
  std::size_t none = 0;
  for (const GapRow& r : all) {
    if (r.outcome == "no_world")
      ++none;
    else
      made.push_back(&r);
  }
  const auto wanted = [&](const char* name) {
    return std::find(sections.begin(), sections.end(), name) != sections.end();
  };
  const auto of = [&](const char* name) { return where(made, [&](const GapRow& r) { return r.section == name; }); };
  if (wanted("sealed") && !of("sealed").empty()) {
    sealed(table, of("sealed"));
    oracle(table, of("sealed"));
  }
  if (wanted("null") && !of("null").empty()) null(table, of("null"));
  if (wanted("two") && !of("two").empty()) two(table, of("two"));
  if (wanted("outside") && !of("outside").empty()) outside(table, of("outside"));
  cost(table, made);
  if (none) std::printf("\n  %zu cases could not be made (no strength reaches the wanted r); see results.csv\n", none);
  return table.finish();
}

}  // namespace tiller::bench
