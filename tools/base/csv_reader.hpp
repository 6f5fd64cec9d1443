#pragma once

#include <istream>
#include <string>
#include <string_view>
#include <vector>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// The one reader of CSV files, in the dialects that programs write: a byte order mark, commas, semicolons or tabs,
/// quotes, comment lines that begin with '#' (a header behind one, too, as numpy writes it), line ends of Windows, and
/// decimal commas where the comma separates nothing. Memory is that of one row.
class CsvReader {
 public:
  explicit CsvReader(std::istream& file) : file_(file) {}

  /// Reads the header. False: the file has no line, or is text of 16 bits (problem() tells).
  bool read_header();
  const Words& names() const { return names_; }

  /// The next row that is not empty. False: the end.
  bool next();
  int line() const { return line_; }           ///< of the row, from 1
  bool is_whole() const { return is_whole_; }  ///< a line end follows the row
  std::size_t size() const { return cells_.size(); }
  std::string_view operator[](std::size_t cell) const { return cells_[cell]; }

  /// What a cell of measured data holds: a number, nothing (empty, "nan", "NA", "null", "none"), or something else.
  enum class Cell { number, missing, other };
  Cell number(std::size_t cell, double& value);

  /// What is unlike a plain CSV: "byte order mark, semicolons, decimal commas"; empty: nothing.
  std::string dialect() const;
  const std::string& problem() const { return problem_; }

 private:
  bool read_line();
  void split();
  void split_quoted();
  static char separator_of(std::string_view header);

  std::istream& file_;
  std::string text_, unquoted_, problem_;
  std::vector<std::string_view> cells_;
  Words names_;
  char separator_ = ',';
  int line_ = 0;
  bool is_whole_ = false, is_pending_ = false;  // pending: the row is read, and not yet told of
  bool has_mark_ = false, has_commas_ = false, has_words_ = false, has_commented_header_ = false;
};

}  // namespace tiller::tools
