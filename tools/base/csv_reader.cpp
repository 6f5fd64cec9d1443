// CSV files as programs and countries write them.
#include "tools/base/csv_reader.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>

namespace tiller::tools {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t'; }

std::string_view trimmed_view(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

bool parse(std::string_view text, double& value) {
  if (text.size() > 1 && text.front() == '+' && text[1] != '-') text.remove_prefix(1);
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  // what is too large or too small for a double: as strtod has it
  if (result.ec == std::errc::result_out_of_range) value = std::strtod(std::string(text).c_str(), nullptr);
  return result.ec != std::errc::invalid_argument && result.ptr == text.data() + text.size();
}

bool is_missing(std::string_view cell) {
  if (cell.empty()) return true;
  if (cell.size() > 4) return false;
  char lower[4];
  const auto lowered = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  std::transform(cell.begin(), cell.end(), lower, lowered);
  const std::string_view word(lower, cell.size());
  return word == "nan" || word == "na" || word == "n/a" || word == "null" || word == "none";
}

}  // namespace

bool CsvReader::read_line() {
  if (!std::getline(file_, text_)) return false;
  is_whole_ = !file_.eof();
  ++line_;
  if (!text_.empty() && text_.back() == '\r') text_.pop_back();
  return true;
}

/// The one that the header has most of outside of quotes; a comma where it has none.
char CsvReader::separator_of(std::string_view header) {
  std::size_t count[3] = {};
  bool quoted = false;
  for (const char c : header) {
    if (c == '"') quoted = !quoted;
    for (int k = 0; k < 3; ++k) count[k] += !quoted && c == ",;\t"[k] ? 1 : 0;
  }
  return ",;\t"[std::max_element(count, count + 3) - count];
}

bool CsvReader::read_header() {
  std::string comment;
  while (read_line()) {
    if (line_ == 1) {
      if (text_.rfind("\xFF\xFE", 0) == 0 || text_.rfind("\xFE\xFF", 0) == 0) {
        problem_ = "is text of 16 bits (UTF-16); save it as UTF-8";
        return false;
      }
      has_mark_ = text_.rfind("\xEF\xBB\xBF", 0) == 0;
      if (has_mark_) text_.erase(0, 3);
    }
    const std::string_view row = trimmed_view(text_);
    if (row.empty()) continue;
    if (row.front() == '#') {
      comment = row.substr(std::min(row.find_first_not_of("# \t"), row.size()));
      continue;
    }
    // numpy writes its header as a comment: then the first row is numbers, as many as the comment has names
    separator_ = separator_of(comment);
    split();
    double ignored;
    const auto is_number = [&](std::string_view cell) { return is_missing(cell) || parse(cell, ignored); };
    const std::size_t cells = cells_.size();
    has_commented_header_ = cells > 1 && std::all_of(cells_.begin(), cells_.end(), is_number);
    if (has_commented_header_) {
      text_.swap(comment);
      split();
      has_commented_header_ = cells_.size() == cells;
      if (has_commented_header_) names_.assign(cells_.begin(), cells_.end());
      text_.swap(comment);
    }
    is_pending_ = has_commented_header_;
    if (!has_commented_header_) separator_ = separator_of(text_);
    split();
    if (!has_commented_header_) names_.assign(cells_.begin(), cells_.end());
    return true;
  }
  return false;
}

bool CsvReader::next() {
  if (is_pending_) {
    is_pending_ = false;
    return true;
  }
  while (read_line()) {
    const std::size_t first = text_.find_first_not_of(" \t");
    if (first == std::string::npos ? text_.find('\t') == std::string::npos || separator_ != '\t' : text_[first] == '#')
      continue;
    split();
    return true;
  }
  return false;
}

void CsvReader::split() {
  cells_.clear();
  if (text_.find('"') != std::string::npos) return split_quoted();
  const std::string_view row = text_;
  for (std::size_t from = 0;;) {
    const std::size_t end = std::min(row.find(separator_, from), row.size());
    cells_.push_back(trimmed_view(row.substr(from, end - from)));
    if (end == row.size()) return;
    from = end + 1;
  }
}

/// Within quotes a separator is text, and two quotes are one.
void CsvReader::split_quoted() {
  unquoted_.clear();
  unquoted_.reserve(text_.size());  // views into it must stay
  std::size_t from = 0;
  bool quoted = false;
  const auto end_cell = [&] {
    cells_.push_back(trimmed_view(std::string_view(unquoted_).substr(from)));
    from = unquoted_.size();
  };
  for (std::size_t i = 0; i < text_.size(); ++i) {
    const char c = text_[i];
    if (c == '"' && quoted && i + 1 < text_.size() && text_[i + 1] == '"')
      unquoted_ += text_[++i];
    else if (c == '"')
      quoted = !quoted;
    else if (c == separator_ && !quoted)
      end_cell();
    else
      unquoted_ += c;
  }
  end_cell();
}

CsvReader::Cell CsvReader::number(std::size_t cell, double& value) {
  const std::string_view text = cells_[cell];
  if (is_missing(text)) {
    has_words_ = has_words_ || !text.empty();
    return Cell::missing;
  }
  if (parse(text, value)) return Cell::number;
  const std::size_t comma = text.find(',');
  if (comma == std::string_view::npos || text.size() > 64) return Cell::other;
  char point[64];
  std::copy(text.begin(), text.end(), point);
  point[comma] = '.';
  if (!parse({point, text.size()}, value)) return Cell::other;
  has_commas_ = true;
  return Cell::number;
}

std::string CsvReader::dialect() const {
  Words words;
  if (has_mark_) words.emplace_back("a byte order mark");
  if (has_commented_header_) words.emplace_back("a header behind '#'");
  if (separator_ != ',') words.emplace_back(separator_ == ';' ? "semicolons" : "tabs");
  if (has_commas_) words.emplace_back("decimal commas");
  if (has_words_) words.emplace_back("words as 'nan' for missing values");
  return words.empty() ? "" : join(words);
}

}  // namespace tiller::tools
