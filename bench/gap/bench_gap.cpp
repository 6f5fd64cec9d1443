// How often `tiller gap` names what was hidden, over worlds of gap_worlds.hpp.
//
//     bench_gap SECTION.. [--out FOLDER] [--seeds N] [--tune] [--jobs N] [--plants a,b] [--kinds a,b] [--noises x,y]
//               [--cases N] [--no-oracle] [--tables] [--keep]
//
// Sections: sealed null two outside. Every case adds a line to FOLDER/results.csv; cases that stand there are not run
// again, so a run that was cut goes on. --tables runs nothing. --tune takes the tuning seeds (100001 and up) instead of
// the scoring seeds (1 and up), and FOLDER/tuning.csv. --cases N stops after N cases. --keep leaves the files of every
// case in FOLDER, for `tiller gap`.

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <set>
#include <string>

#include "bench/gap/gap_tables.hpp"
#include "harness/gap_scoring/gap_cases.hpp"

namespace tiller::bench {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<std::string> sections;
  std::string out = "gap";
  CasePlan plan;
  std::size_t jobs = 1, cases = SIZE_MAX;
  bool tune = false, oracle = true, tables_only = false, keep = false;
  std::string results() const { return out + (tune ? "/tuning.csv" : "/results.csv"); }
};

std::vector<std::string> listed(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    if (end > at) words.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return words;
}

bool parse(int argc, char** argv, Arguments& a) {
  const std::set<std::string> known = {"sealed", "null", "two", "outside"};
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] { return std::string(i + 1 < argc ? argv[++i] : ""); };
    if (known.count(word))
      a.sections.push_back(word);
    else if (word == "--out")
      a.out = value();
    else if (word == "--seeds")
      a.plan.seeds = static_cast<std::uint32_t>(std::strtoul(value().c_str(), nullptr, 10));
    else if (word == "--jobs")
      a.jobs = std::max(1ul, std::strtoul(value().c_str(), nullptr, 10));
    else if (word == "--cases")
      a.cases = std::strtoul(value().c_str(), nullptr, 10);
    else if (word == "--plants")
      a.plan.plants = listed(value());
    else if (word == "--kinds")
      a.plan.kinds = listed(value());
    else if (word == "--tune")
      a.tune = true;
    else if (word == "--no-oracle")
      a.oracle = false;
    else if (word == "--keep")
      a.keep = true;
    else if (word == "--tables")
      a.tables_only = true;
    else if (word == "--noises") {
      a.plan.noises.clear();
      for (const std::string& n : listed(value())) a.plan.noises.push_back(std::strtod(n.c_str(), nullptr));
    } else {
      std::fprintf(stderr, "bench_gap: '%s' is neither a section (sealed, null, two, outside) nor an option\n",
                   word.c_str());
      return false;
    }
  }
  if (a.sections.empty()) a.sections = {"sealed", "null", "two", "outside"};
  a.plan.first_seed = a.tune ? kFirstTuningSeed : kFirstScoringSeed;
  return true;
}

/// One write, so that lines of several processes do not mix.
void append(const std::string& path, const std::string& line) {
  const int file = open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT, 0644);
  if (file < 0 || write(file, line.data(), line.size()) != static_cast<ssize_t>(line.size()))
    std::fprintf(stderr, "bench_gap: %s: %s\n", path.c_str(), std::strerror(errno));
  if (file >= 0) close(file);
}

/// Every jobs-th of the cases.
void run_share(const std::vector<GapCase>& cases, std::size_t share, const Arguments& a) {
  const std::string folder = a.out + "/case_" + std::to_string(share);
  for (std::size_t i = share; i < cases.size(); i += a.jobs) {
    std::string own = cases[i].id();
    std::replace(own.begin(), own.end(), '/', '-');
    const GapRow row = run_case(cases[i], a.keep ? a.out + "/" + own : folder, a.oracle, a.keep);
    append(a.results(), row_text(row));
    std::fprintf(stderr, "%zu/%zu %s r %.3g: %s %s -> %s%s%s\n", i + 1, cases.size(), row.id.c_str(), row.r,
                 row.verdict.c_str(), row.sets.c_str(), row.outcome.c_str(), row.note.empty() ? "" : ": ",
                 row.note.c_str());
  }
}

void run_cases(const Arguments& a) {
  std::error_code why;
  fs::create_directories(a.out, why);
  if (read_rows(a.results()).empty()) {
    fs::remove(a.results(), why);
    append(a.results(), row_header());
  }
  std::set<std::string> done;
  for (const GapRow& row : read_rows(a.results())) done.insert(row.id);
  std::vector<GapCase> cases;
  for (const std::string& section : a.sections)
    for (const GapCase& c : plan_cases(section, a.plan))
      if (!done.count(c.id()) && cases.size() < a.cases) cases.push_back(c);
  if (cases.empty()) return;
  std::vector<pid_t> children;
  for (std::size_t share = 1; share < a.jobs; ++share) {
    const pid_t child = fork();
    if (child == 0) {
      run_share(cases, share, a);
      _exit(0);
    }
    children.push_back(child);
  }
  run_share(cases, 0, a);
  for (const pid_t child : children) waitpid(child, nullptr, 0);
}

}  // namespace
}  // namespace tiller::bench

int main(int argc, char** argv) {
  tiller::bench::Arguments a;
  if (!tiller::bench::parse(argc, argv, a)) return 2;
  if (!a.tables_only) tiller::bench::run_cases(a);
  return tiller::bench::print_tables(tiller::bench::read_rows(a.results()), a.sections);
}
