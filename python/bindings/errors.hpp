#pragma once

#include <nanobind/nanobind.h>

#include <string>

#include "tiller/tiller.h"

namespace tiller::python {

namespace nb = nanobind;

/// Exceptions are classes of tiller/_errors.py, so that Python code may raise the same ones; each of these throws.

/// tiller.ArgumentError, or tiller.ArgumentTypeError where `is_type`: which argument of which function, its value, what
/// was expected there and what to do.
[[noreturn]] void raise_argument(const char* function, const char* argument, const std::string& value,
                                 const std::string& expected, const std::string& remedy, bool is_type = false);

/// tiller.StatusError with the status's name, text and remedy; `where` names the call, `field` the setting if one is
/// known.
[[noreturn]] void raise_status(tiller_status_t status, const std::string& where, const std::string& field = "");

/// tiller.RobotFileError: what the reader of robot files says, one line for each problem.
[[noreturn]] void raise_robot_file(const std::string& problems);

/// repr() cut to a readable length, for messages.
std::string show(nb::handle value);

inline void check_status(tiller_status_t status, const char* where) {
  if (status != tiller_status_ok) raise_status(status, where);
}

}  // namespace tiller::python
