#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <string>

#include "tools/base/text.hpp"

namespace tiller::python {

namespace nb = nanobind;

/// What an argument is called in messages.
struct ArgumentName {
  const char* function;
  const char* argument;
};

enum class Finite { all, or_nan, any };

/// Reads `names.size()` numbers from an array, a list or whatever numpy.asarray takes, into `out`. An array of doubles
/// is read in place through its buffer, without numpy: some 0.1 us. Raises ArgumentError or ArgumentTypeError, which
/// name the argument, its value and the remedy.
void read_numbers(nb::handle from, const ArgumentName& name, const tools::Words& names, Finite finite, double* out);

/// One finite number.
double read_number(nb::handle from, const ArgumentName& name, const std::string& unit);

}  // namespace tiller::python
