#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

using Words = std::vector<std::string>;

/// Edit distance with transpositions: what separates a typing error from another word.
std::size_t edit_distance(const std::string& a, const std::string& b);

/// The known word that `word` was most likely meant to be; empty when none is close.
std::string nearest(const std::string& word, const Words& known);

/// "a, b, c"; "none" for an empty list.
std::string join(const Words& words, const char* separator = ", ");

/// Without blanks at its ends.
std::string trimmed(const std::string& text);

/// The cells of a CSV line, trimmed; a comma at the end opens an empty one.
Words csv_cells(const std::string& line);

/// Shortest decimal text that reads back as the same double.
std::string number_text(double value);

/// printf into a string; for numbers with a fixed number of digits.
std::string format(const char* pattern, ...) __attribute__((format(printf, 1, 2)));

}  // namespace tiller::tools
