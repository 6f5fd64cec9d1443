#include "errors.hpp"

#include <nanobind/stl/string.h>

namespace tiller::python {
namespace {

/// Sets the exception that tiller._errors makes, and throws what carries it to the caller.
template <class... Arguments>
[[noreturn]] void raise(const char* maker, Arguments&&... arguments) {
  const nb::object error = nb::module_::import_("tiller._errors").attr(maker)(std::forward<Arguments>(arguments)...);
  PyErr_SetObject(error.type().ptr(), error.ptr());
  throw nb::python_error();
}

}  // namespace

void raise_argument(const char* function, const char* argument, const std::string& value, const std::string& expected,
                    const std::string& remedy, bool is_type) {
  raise("make_argument_error", function, argument, value, expected, remedy, is_type);
}

void raise_status(tiller_status_t status, const std::string& where, const std::string& field) {
  raise("make_status_error", tiller_status_name(status), static_cast<int>(status), tiller_status_text(status), where,
        field);
}

void raise_robot_file(const std::string& problems) { raise("make_robot_file_error", problems); }

std::string show(nb::handle value) {
  constexpr std::size_t kLongest = 80;
  std::string text = nb::cast<std::string>(nb::repr(value));
  if (text.size() > kLongest) text = text.substr(0, kLongest - 3) + "...";
  return text;
}

}  // namespace tiller::python
