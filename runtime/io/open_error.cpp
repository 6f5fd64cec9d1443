#include "io/open_error.hpp"

#include <cstdarg>
#include <cstdio>

namespace tiller {

void set_open_error(OpenError* error, const char* format, ...) {
  if (error == nullptr) return;
  va_list arguments;
  va_start(arguments, format);
  // the analyzer of clang 14 does not know va_start where C++ includes it
  // NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized)
  std::vsnprintf(error->text, sizeof error->text, format, arguments);
  va_end(arguments);
}

}  // namespace tiller
