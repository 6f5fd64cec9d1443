#pragma once

// Numbers among a benchmark's arguments: what is none ends the program, rather than be taken for zero.

#include <cstdio>
#include <cstdlib>
#include <string>

namespace tiller::bench {

[[noreturn]] inline void refuse_number(const char* text) {
  std::fprintf(stderr, "'%s' is not a number\n", text);
  std::exit(2);
}

inline int whole_number(const char* text) {
  char* end = nullptr;
  const long value = std::strtol(text, &end, 10);
  if (end == text || *end != '\0' || value != static_cast<int>(value)) refuse_number(text);
  return static_cast<int>(value);
}
inline int whole_number(const std::string& text) { return whole_number(text.c_str()); }

inline double real_number(const char* text) {
  char* end = nullptr;
  const double value = std::strtod(text, &end);
  if (end == text || *end != '\0') refuse_number(text);
  return value;
}
inline double real_number(const std::string& text) { return real_number(text.c_str()); }

}  // namespace tiller::bench
