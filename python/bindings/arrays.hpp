#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "errors.hpp"
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

/// A whole number from `low` to `high`.
std::int64_t read_count(nb::handle from, const ArgumentName& name, std::int64_t low, std::int64_t high);

/// A seed, or none.
std::optional<std::uint64_t> read_seed(nb::handle from, const ArgumentName& name);

bool read_flag(nb::handle from, const ArgumentName& name);

/// Of a constructor, whose own complaints no wrapper in Python could change: what it was called with beyond its
/// parameters, which is nothing.
void refuse_more(const char* function, const char* parameters, const nb::args& more, const nb::kwargs& others);

/// The constructor of a class that only the package makes.
template <class T>
auto made_by(const char* name, const char* maker) {
  return [name, maker](T*, const nb::args&, const nb::kwargs&) {
    raise_argument(name, "the class", "called", "no call", maker, true);
  };
}

}  // namespace tiller::python
