#pragma once

#include <string>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// A robot file as lines: keys are changed, everything else stays as somebody wrote it. A key and its value stand on
/// one line, as in the files that come with tiller and in those of `tiller import`.
class RobotLines {
 public:
  explicit RobotLines(const std::string& text);

  std::string text() const;
  /// The value's text, without the comment behind it; empty: no such key.
  std::string value(const std::string& section, const std::string& key) const;
  /// In the place of the key's line, or behind the section's last key; a section that is missing comes at the end.
  void set(const std::string& section, const std::string& key, const std::string& value);
  /// Takes the key's line out.
  void erase(const std::string& section, const std::string& key);
  /// Takes the section out, with its header.
  void erase_section(const std::string& section);
  /// Takes the comment above the first line of code away, and puts this in its place.
  void set_head(const std::string& comment);

 private:
  struct Range {
    std::size_t begin = 0, end = 0;  // lines behind the header
  };
  Range find(const std::string& section) const;
  std::size_t line_of(const std::string& section, const std::string& key) const;

  Words lines_;
};

/// `table` is an inline table's text; its entry becomes `value`, or is added.
std::string with_entry(const std::string& table, const std::string& key, const std::string& value);

}  // namespace tiller::tools
