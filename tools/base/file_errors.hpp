#pragma once

#include <string>
#include <vector>

#include "tools/base/toml.hpp"

namespace tiller::tools {

/// One thing that is wrong in a robot file: where, what, and what to do.
struct FileError {
  int line = 0;         ///< 1-based; the file's last line when something is missing altogether
  std::string key;      ///< dotted path, e.g. "planner.horizon"
  std::string value;    ///< as written in the file; empty when the key is missing
  std::string problem;  ///< what is wrong
  std::string remedy;   ///< what to write instead
};

/// Collects everything that is wrong with one file, so that its owner corrects it in one go.
class FileErrors {
 public:
  FileErrors(std::string path, const std::string& source);

  /// An error at a value of the file; its text is quoted.
  void at(const toml::node& node, const std::string& key, std::string problem, std::string remedy);
  /// The same, the position given as a source region.
  void at(const toml::source_region& region, const std::string& key, std::string problem, std::string remedy);
  /// An error at a whole table, whose text would be too long to quote.
  void at_table(const toml::node& table, const std::string& key, std::string problem, std::string remedy);
  /// Something that should stand below `table` and does not. Null: the whole section is missing.
  void missing(const toml::node* table, const std::string& key, std::string remedy);
  void at_line(int line, const std::string& key, std::string problem, std::string remedy);

  /// Whether a key that begins with `prefix` is among the errors.
  bool has_below(const std::string& prefix) const;
  bool empty() const { return errors_.empty(); }
  const std::vector<FileError>& list() const { return errors_; }
  /// One error a line: "file:line: key = value: problem; remedy", ordered by line.
  std::string text() const;
  const std::string& path() const { return path_; }
  int last_line() const { return static_cast<int>(lines_.size()); }

 private:
  std::string quote(const toml::source_region& region) const;

  std::string path_;
  std::vector<std::string> lines_;
  std::vector<FileError> errors_;
};

}  // namespace tiller::tools
