#pragma once

// Tables with figure, goal and "met" or "short" on top of Google Benchmark. Benchmarks run interleaved and repeated
// (on a shared machine two medians taken in turn compare where two absolute times do not); the table reads medians.
//
//     tiller::bench::Table table;
//     table.add("lanes", [](benchmark::State& s) { for (auto _ : s) work(); });
//     table.run(argc, argv);
//     table.row("f32 lanes", table.seconds("lanes") / steps * 1e9, "ns", tiller::bench::at_most(0.65));
//     return table.finish();   // prints how many rows are short; a short row is never an error

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace tiller::bench {

struct Goal {
  enum Kind { kNone, kLow, kHigh } kind = kNone;
  double bound = 0.0;
};
inline Goal at_most(double bound) { return {Goal::kLow, bound}; }
inline Goal at_least(double bound) { return {Goal::kHigh, bound}; }

class Table : private benchmark::BenchmarkReporter {
 public:
  void add(const std::string& name, const std::function<void(benchmark::State&)>& body) {
    // NOLINTNEXTLINE(clang-analyzer-cplusplus.NewDeleteLeaks): the library keeps what is registered
    benchmark::RegisterBenchmark(name.c_str(), [body](benchmark::State& s) { body(s); })
        ->Repetitions(kRepetitions)
        ->MinTime(kMinTime)
        ->Unit(benchmark::kNanosecond);
  }
  void run(int argc, char** argv) {
    std::vector<char*> args(argv, argv + argc);
    std::string interleave = "--benchmark_enable_random_interleaving=true";
    args.insert(args.begin() + 1, interleave.data());
    int count = static_cast<int>(args.size());
    benchmark::Initialize(&count, args.data());
    if (benchmark::ReportUnrecognizedArguments(count, args.data())) std::exit(2);
    std::printf("measuring, %d interleaved repetitions each ...\n", kRepetitions);
    std::fflush(stdout);
    benchmark::RunSpecifiedBenchmarks(this);
  }
  /// Median seconds of one iteration; NaN if it did not run.
  double seconds(const std::string& name) const { return at(name, 0.5); }
  /// Largest over smallest repetition: how quiet the machine was.
  double spread(const std::string& name) const { return at(name, 1.0) / at(name, 0.0); }

  /// Also writes every row as one JSON object a line.
  void json_to(std::FILE* file) { json_ = file; }
  void heading(const std::string& text) {
    std::printf("\n%s\n", text.c_str());
    heading_ = text;
  }
  void row(const std::string& what, double figure, const std::string& unit, Goal goal = {}) {
    char bound[64] = "";
    const char* verdict = "";
    if (goal.kind != Goal::kNone) {
      std::snprintf(bound, sizeof bound, "goal %s %.4g", goal.kind == Goal::kLow ? "<=" : ">=", goal.bound);
      const bool met = goal.kind == Goal::kLow ? figure <= goal.bound : figure >= goal.bound;
      verdict = met ? "met" : "short";
      ++(met ? met_ : short_);
    }
    std::printf("  %-58s %10.4g %-8s %-16s %s\n", what.c_str(), figure, unit.c_str(), bound, verdict);
    if (!json_) return;
    char number[32] = "null";  // JSON has no NaN
    if (std::isfinite(figure)) std::snprintf(number, sizeof number, "%.9g", figure);
    std::fprintf(json_,
                 "{\"heading\": \"%s\", \"row\": \"%s\", \"figure\": %s, \"unit\": \"%s\", \"goal\": \"%s\", "
                 "\"verdict\": \"%s\"}\n",
                 heading_.c_str(), what.c_str(), number, unit.c_str(), bound, verdict);
    std::fflush(json_);
  }
  int finish() const {
    std::printf("\n%d rows met, %d short\n", met_, short_);
    return 0;
  }

 private:
  static constexpr int kRepetitions = 15;
  static constexpr double kMinTime = 0.02;
  bool ReportContext(const Context&) override { return true; }
  void ReportRuns(const std::vector<Run>& runs) override {
    for (const Run& run : runs)
      if (run.run_type == Run::RT_Iteration && run.iterations > 0)  // none: the run failed
        times_[run.run_name.function_name].push_back(run.real_accumulated_time / static_cast<double>(run.iterations));
  }
  double at(const std::string& name, double quantile) const {
    const auto found = times_.find(name);
    if (found == times_.end()) return NAN;
    std::vector<double> v = found->second;
    std::sort(v.begin(), v.end());
    return v[static_cast<std::size_t>(std::lround(quantile * static_cast<double>(v.size() - 1)))];
  }
  std::map<std::string, std::vector<double>> times_;
  int met_ = 0, short_ = 0;
  std::FILE* json_ = nullptr;
  std::string heading_;
};

}  // namespace tiller::bench
