#include "tools/logs/log_holes.hpp"

#include <algorithm>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostPlaces = 8;  // what a sentence can hold

unsigned long long number(std::uint64_t n) { return n; }

std::vector<LogHole> only(const std::vector<LogHole>& holes, LogHole::What what) {
  std::vector<LogHole> some;
  std::copy_if(holes.begin(), holes.end(), std::back_inserter(some), [=](const LogHole& h) { return h.what == what; });
  return some;
}

std::uint64_t ticks_in(const std::vector<LogHole>& holes) {
  std::uint64_t sum = 0;
  for (const LogHole& hole : holes) sum += hole.last - hole.first + 1;
  return sum;
}

/// "7 ticks are missing: 20 to 26"
std::string sentence(const std::vector<LogHole>& holes, const char* one, const char* many) {
  const std::uint64_t ticks = ticks_in(holes);
  return format("%llu %s missing: ", number(ticks), ticks == 1 ? one : many) + ticks_text(holes, kMostPlaces);
}

}  // namespace

void find_missing_ticks(const std::vector<RecordEntry>& entries, std::vector<LogHole>& holes) {
  std::uint64_t expected = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::uint64_t tick = entries[i].record.tick;
    if (tick > expected) holes.push_back({LogHole::What::kTicks, expected, tick - 1, i});
    if (tick >= expected) expected = tick + 1;
  }
  std::stable_sort(holes.begin(), holes.end(), [](const LogHole& a, const LogHole& b) { return a.at < b.at; });
}

std::string ticks_text(const std::vector<LogHole>& holes, std::size_t most) {
  std::string text;
  for (std::size_t i = 0; i < std::min(most, holes.size()); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(holes[i].first);
    if (holes[i].last > holes[i].first) text += " to " + std::to_string(holes[i].last);
  }
  if (holes.size() > most) text += format(" and %zu more places", holes.size() - most);
  return text;
}

std::string holes_text(const std::vector<LogHole>& holes, const std::vector<RecordEntry>& entries) {
  if (holes.empty()) return "";
  Words parts;
  const auto add = [&](LogHole::What what, const char* one, const char* many) {
    const std::vector<LogHole> some = only(holes, what);
    if (!some.empty()) parts.push_back(sentence(some, one, many));
  };
  add(LogHole::What::kTicks, "tick is", "ticks are");
  add(LogHole::What::kMeasurement, "tick's measurement is", "ticks' measurements are");
  add(LogHole::What::kIterations, "tick's number of iterations is", "ticks' numbers of iterations are");
  const std::size_t sound = holes.front().at;
  const std::string promised =
      sound > 0 ? format("equal bits are promised for the %zu ticks before that", sound) : "no equal bits are promised";
  return join(parts, "; ") +
         format("; from tick %llu on a replay knows other things than the recorded controller did: ",
                number(entries[sound].record.tick)) +
         promised;
}

}  // namespace tiller::tools
