#include "tools/base/text.hpp"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <utility>

namespace tiller::tools {

std::size_t edit_distance(const std::string& a, const std::string& b) {
  // rows of the optimal string alignment table: before[j] two rows up, above[j] one row up
  std::vector<std::size_t> rows(3 * (b.size() + 1));
  std::size_t *before = rows.data(), *above = before + b.size() + 1, *row = above + b.size() + 1;
  for (std::size_t j = 0; j <= b.size(); ++j) above[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = above[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min(std::min(above[j], row[j - 1]) + 1, change);
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    std::swap(before, above);
    std::swap(above, row);
  }
  return above[b.size()];
}

std::string nearest(const std::string& word, const Words& known) {
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& candidate : known) {
    const std::size_t shorter = std::min(word.size(), candidate.size());
    const std::size_t longer = std::max(word.size(), candidate.size());
    // no distance is below the difference of lengths: a file's cell of a megabyte is not worth a table
    std::size_t distance = longer - shorter;
    if (distance < best_distance) distance = edit_distance(word, candidate);
    // a unit that was left out or a shortened name is near, however long the rest is
    if (shorter >= 3 && word.compare(0, shorter, candidate, 0, shorter) == 0) {
      distance = std::min<std::size_t>(distance, 2);
    }
    if (distance < best_distance) {
      best = candidate;
      best_distance = distance;
    }
  }
  return best;
}

std::string join(const Words& words, const char* separator) {
  if (words.empty()) return "none";
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : separator) + word;
  return text;
}

std::string number_text(double value) {
  std::string shortest;
  for (int digits = 1; digits <= 17; ++digits) {  // more digits may be shorter: 2e+01, but 20
    std::string text = format("%.*g", digits, value);
    const bool same = std::strtod(text.c_str(), nullptr) == value || value != value;
    if (same && (shortest.empty() || text.size() < shortest.size())) shortest = text;
  }
  return shortest;
}

std::string format(const char* pattern, ...) {
  va_list arguments;
  va_start(arguments, pattern);
  va_list again;
  va_copy(again, arguments);
  const int length = std::vsnprintf(nullptr, 0, pattern, arguments);
  std::string text(static_cast<std::size_t>(std::max(length, 0)), '\0');
  std::vsnprintf(text.data(), text.size() + 1, pattern, again);
  va_end(again);
  va_end(arguments);
  return text;
}

std::string trimmed(const std::string& text) {
  const std::size_t from = text.find_first_not_of(" \t\r");
  return from == std::string::npos ? "" : text.substr(from, text.find_last_not_of(" \t\r") - from + 1);
}

Words csv_cells(const std::string& line) {
  Words cells;
  std::stringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(trimmed(cell));
  if (!line.empty() && line.back() == ',') cells.emplace_back();
  return cells;
}

}  // namespace tiller::tools
