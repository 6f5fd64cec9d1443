#include "tools/logs/repeated_logs.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

constexpr std::size_t kFewestRows = 10;      // fewer may agree without being copies
constexpr std::size_t kFewestDifferent = 5;  // values of a column that moves: encoders at rest all read the same
constexpr double kTenDigits = 2e-9;          // what rounding to %.10g leaves, with room
constexpr double kStampRounding_s = 5e-6;    // what rounding to microseconds leaves of two differences, with room

bool same(double a, double b) {
  if (std::isnan(a) || std::isnan(b)) return std::isnan(a) && std::isnan(b);
  return std::fabs(a - b) <= kTenDigits * std::fabs(b) + 1e-12;
}

bool moves(const std::vector<double>& column) {
  std::vector<double> seen;
  for (const double v : column) {
    if (std::isnan(v) || std::find(seen.begin(), seen.end(), v) != seen.end()) continue;
    seen.push_back(v);
    if (seen.size() == kFewestDifferent) return true;
  }
  return false;
}

// The row of `whole` may be measured in more columns than that of `part`, never in fewer.
bool same_rows(const Log& part, const Log& whole, std::size_t at) {
  for (std::size_t i = 0; i < part.rows(); ++i) {
    const double since = part.time_s[i] - part.time_s[0], there = whole.time_s[at + i] - whole.time_s[at];
    if (std::fabs(since - there) > kStampRounding_s) return false;
    for (std::size_t k = 0; k < part.state.size(); ++k)
      if (!part.state[k].empty() && (whole.state[k].empty() || !same(part.state[k][i], whole.state[k][at + i])))
        return false;
  }
  return true;
}

}  // namespace

bool is_part_of(const Log& part, const Log& whole) {
  if (part.rows() < kFewestRows || part.rows() > whole.rows() || part.state.size() != whole.state.size()) return false;
  const auto column = std::find_if(part.state.begin(), part.state.end(), moves);
  if (column == part.state.end()) return false;
  const std::vector<double>& among = whole.state[static_cast<std::size_t>(column - part.state.begin())];
  if (among.empty()) return false;
  for (std::size_t at = 0; at + part.rows() <= whole.rows(); ++at)
    if (same((*column)[0], among[at]) && same_rows(part, whole, at)) return true;
  return false;
}

std::vector<std::string> drop_repeated(std::vector<Log>& logs) {
  std::vector<std::string> said;
  for (std::size_t i = 0; i < logs.size();) {
    const auto whole = std::find_if(logs.begin(), logs.end(),
                                    [&](const Log& other) { return &other != &logs[i] && is_part_of(logs[i], other); });
    if (whole == logs.end()) {
      ++i;
      continue;
    }
    said.push_back(logs[i].path + ": all of its rows stand in " + whole->path + " too; it is left out.");
    logs.erase(logs.begin() + static_cast<std::ptrdiff_t>(i));
  }
  return said;
}

std::vector<std::string> shared_logs(const std::vector<Log>& learnt, const std::vector<Log>& held_out) {
  std::vector<std::string> said;
  for (const Log& held : held_out)
    for (const Log& log : learnt)
      if (is_part_of(held, log) || is_part_of(log, held))
        said.push_back(held.path + ": is held out, and its rows are learnt from in " + log.path +
                       "; name each run on one side alone");
  return said;
}

}  // namespace tiller::tools
