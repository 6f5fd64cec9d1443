#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tiller/tiller.h"
#include "tools/base/file_errors.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {

/// Reads the keys of one table by the schema: type, range and name are checked there, and every deviation
/// becomes an error with its line. A reader of a missing table finds no keys.
class SectionReader {
 public:
  /// `schema` is the section's name in the schema, `path` how errors call it ("limits.force_N").
  SectionReader(FileErrors& errors, std::string schema, std::string path, const toml::table* table)
      : errors_(&errors), schema_(std::move(schema)), path_(std::move(path)), table_(table) {}

  bool present() const { return table_ != nullptr; }
  const toml::table* table() const { return table_; }
  bool has(const std::string& key) const { return table_ && table_->contains(key); }
  const toml::node* node(const std::string& key) const { return table_ ? table_->get(key) : nullptr; }
  std::string path_of(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }

  std::optional<double> number(const std::string& key);
  std::optional<std::int64_t> count(const std::string& key);
  std::optional<bool> flag(const std::string& key);
  std::optional<std::string> text(const std::string& key);
  std::optional<std::uint32_t> choice(const std::string& key);
  const toml::table* subtable(const std::string& key);
  /// Table of numbers whose keys are `names`; values stand at the names' indices.
  void numbers(const std::string& key, const Words& names, const char* what, double* out);

  /// An error at a key that must be there.
  void missing(const std::string& key, std::string remedy);
  void error(const std::string& key, std::string problem, std::string remedy);

  /// Whether `low` is below `high` where both are there; else an error at the lower key with both values and their
  /// order.
  bool in_order(const std::string& low_key, std::optional<double> low, const std::string& high_key,
                std::optional<double> high);

  /// Reads every key of the section that the schema ties to a field of the configuration.
  void read_bound(tiller_config_t& config, const Words& states, const Words& inputs);
  /// Errors for keys that neither the schema nor `also` knows. Returns what they were probably meant to be, so
  /// that a misspelt key is not told as missing as well.
  Words refuse_unknown(const Words& also = {});

  FileErrors& errors() { return *errors_; }

 private:
  const KeySpec& spec(const std::string& key) const;

  FileErrors* errors_;
  std::string schema_;
  std::string path_;
  const toml::table* table_;
};

/// A finite number at `node` within the spec's range, or an error.
std::optional<double> checked_number(FileErrors& errors, const toml::node& node, const std::string& path,
                                     const KeySpec& spec);

/// "there is no ...; known: a, b" with the nearest first.
std::string remedy_for_unknown(const std::string& word, const Words& known);

/// "a string", "a table": what a value of the file is.
std::string kind_text(const toml::node& node);

}  // namespace tiller::tools
