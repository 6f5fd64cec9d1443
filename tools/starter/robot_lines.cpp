#include "tools/starter/robot_lines.hpp"

#include <algorithm>
#include <regex>
#include <sstream>

namespace tiller::tools {
namespace {

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

bool is_header(const std::string& line) { return !line.empty() && line[0] == '['; }
bool is_comment_or_empty(const std::string& line) { return trimmed(line).empty() || trimmed(line)[0] == '#'; }

/// Key and value of "key = value   # why".
bool split(const std::string& line, std::string& key, std::string& value) {
  const std::size_t equals = line.find('=');
  if (is_comment_or_empty(line) || is_header(line) || equals == std::string::npos) return false;
  key = trimmed(line.substr(0, equals));
  bool quoted = false;
  std::size_t end = equals + 1;
  for (; end < line.size() && (quoted || line[end] != '#'); ++end) quoted ^= line[end] == '"';
  value = trimmed(line.substr(equals + 1, end - equals - 1));
  return true;
}

}  // namespace

RobotLines::RobotLines(const std::string& text) {
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines_.push_back(line);
}

std::string RobotLines::text() const { return join(lines_, "\n") + "\n"; }

RobotLines::Range RobotLines::find(const std::string& section) const {
  const auto header = std::find_if(lines_.begin(), lines_.end(), [&](const std::string& line) {
    return is_header(line) && trimmed(line.substr(0, line.find('#'))) == "[" + section + "]";
  });
  if (header == lines_.end()) return {};
  auto end = std::find_if(header + 1, lines_.end(), is_header);
  while (end != header + 1 && is_comment_or_empty(*(end - 1))) --end;  // they belong to what follows
  return {static_cast<std::size_t>(header + 1 - lines_.begin()), static_cast<std::size_t>(end - lines_.begin())};
}

std::size_t RobotLines::line_of(const std::string& section, const std::string& key) const {
  const Range range = find(section);
  std::string found, ignored;
  for (std::size_t i = range.begin; i < range.end; ++i)
    if (split(lines_[i], found, ignored) && found == key) return i;
  return kNone;
}

std::string RobotLines::value(const std::string& section, const std::string& key) const {
  const std::size_t line = line_of(section, key);
  std::string found, value;
  if (line != kNone) (void)split(lines_[line], found, value);
  return value;
}

void RobotLines::set(const std::string& section, const std::string& key, const std::string& value) {
  const std::string line = key + " = " + value;
  if (const std::size_t at = line_of(section, key); at != kNone) {
    lines_[at] = line;
    return;
  }
  const Range range = find(section);
  if (range.begin == 0)
    lines_.insert(lines_.end(), {"", "[" + section + "]", line});
  else
    lines_.insert(lines_.begin() + static_cast<std::ptrdiff_t>(range.end), line);
}

void RobotLines::erase(const std::string& section, const std::string& key) {
  if (const std::size_t at = line_of(section, key); at != kNone)
    lines_.erase(lines_.begin() + static_cast<std::ptrdiff_t>(at));
}

void RobotLines::erase_section(const std::string& section) {
  const Range range = find(section);
  if (range.begin > 0)
    lines_.erase(lines_.begin() + static_cast<std::ptrdiff_t>(range.begin) - 1,
                 lines_.begin() + static_cast<std::ptrdiff_t>(range.end));
}

void RobotLines::set_head(const std::string& comment) {
  const auto code = std::find_if_not(lines_.begin(), lines_.end(), is_comment_or_empty);
  lines_.erase(lines_.begin(), code);
  lines_.insert(lines_.begin(), {comment, ""});
}

std::string with_entry(const std::string& table, const std::string& key, const std::string& value) {
  const std::regex entry("([{,]\\s*)" + key + "\\s*=\\s*[^,}]*?(\\s*[,}])");
  if (std::regex_search(table, entry)) return std::regex_replace(table, entry, "$1" + key + " = " + value + "$2");
  return table.empty() ? "{ " + key + " = " + value + " }" : "{ " + key + " = " + value + "," + table.substr(1);
}

}  // namespace tiller::tools
