#include "tools/base/file_errors.hpp"

#include <algorithm>
#include <sstream>

namespace tiller::tools {
namespace {

constexpr std::size_t kQuoteLength = 60;

std::string trimmed(std::string text) {
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r')) text.pop_back();
  return text;
}

}  // namespace

FileErrors::FileErrors(std::string path, const std::string& source) : path_(std::move(path)) {
  std::istringstream stream(source);
  for (std::string line; std::getline(stream, line);) lines_.push_back(std::move(line));
  if (lines_.empty()) lines_.emplace_back();
}

void FileErrors::at(const toml::node& node, const std::string& key, std::string problem, std::string remedy) {
  at(node.source(), key, std::move(problem), std::move(remedy));
}

void FileErrors::at(const toml::source_region& region, const std::string& key, std::string problem,
                    std::string remedy) {
  errors_.push_back({static_cast<int>(region.begin.line), key, quote(region), std::move(problem), std::move(remedy)});
}

void FileErrors::at_table(const toml::node& table, const std::string& key, std::string problem, std::string remedy) {
  at_line(static_cast<int>(table.source().begin.line), key, std::move(problem), std::move(remedy));
}

void FileErrors::missing(const toml::node* table, const std::string& key, std::string remedy) {
  const int line = table ? static_cast<int>(table->source().begin.line) : last_line();
  at_line(line, key, "missing", std::move(remedy));
}

void FileErrors::at_line(int line, const std::string& key, std::string problem, std::string remedy) {
  errors_.push_back({line, key, "", std::move(problem), std::move(remedy)});
}

bool FileErrors::has_below(const std::string& prefix) const {
  return std::any_of(errors_.begin(), errors_.end(),
                     [&](const FileError& error) { return error.key.rfind(prefix, 0) == 0; });
}

// Columns of toml++ count code points; names and numbers are ASCII, and a comment after them is not quoted.
std::string FileErrors::quote(const toml::source_region& region) const {
  if (region.begin.line == 0 || region.begin.line > lines_.size()) return "";
  const std::string& line = lines_[region.begin.line - 1];
  const std::size_t from = std::min<std::size_t>(region.begin.column - 1, line.size());
  const bool one_line = region.end.line == region.begin.line && region.end.column > region.begin.column;
  const std::size_t to = one_line ? std::min<std::size_t>(region.end.column - 1, line.size()) : line.size();
  std::string text = trimmed(line.substr(from, to - from));
  if (text.size() > kQuoteLength) text = text.substr(0, kQuoteLength) + "...";
  return one_line ? text : text + " ...";
}

std::string FileErrors::text() const {
  std::vector<FileError> sorted = errors_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const FileError& a, const FileError& b) { return a.line < b.line; });
  std::string all;
  for (const FileError& error : sorted) {
    all += path_ + ":" + std::to_string(error.line) + ": " + error.key;
    if (!error.value.empty()) all += " = " + error.value;
    all += ": " + error.problem + "; " + error.remedy + "\n";
  }
  return all;
}

}  // namespace tiller::tools
