#include "arrays.hpp"

#include <nanobind/stl/string.h>

#include <cmath>
#include <cstring>

#include "errors.hpp"

namespace tiller::python {
namespace {

std::string expectation(const tools::Words& names) {
  return std::to_string(names.size()) + (names.size() == 1 ? " number (" : " numbers (") + tools::join(names) + ")";
}

[[noreturn]] void refuse_shape(nb::handle from, const std::string& shape, const ArgumentName& name,
                               const tools::Words& names) {
  raise_argument(name.function, name.argument, show(from) + " of shape " + shape, expectation(names),
                 "pass an array of shape (" + std::to_string(names.size()) + ",)");
}

/// A released buffer, whatever happens.
class Buffer {
 public:
  explicit Buffer(PyObject* from) : good_(PyObject_GetBuffer(from, &view_, PyBUF_FORMAT | PyBUF_STRIDES) == 0) {
    if (!good_) PyErr_Clear();
  }
  ~Buffer() {
    if (good_) PyBuffer_Release(&view_);
  }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  bool holds_doubles() const { return good_ && view_.format && std::strcmp(view_.format, "d") == 0; }
  const Py_buffer& view() const { return view_; }

 private:
  Py_buffer view_{};
  bool good_;
};

std::string shape_text(const Py_buffer& view) {
  std::string text = "(";
  for (int i = 0; i < view.ndim; ++i) text += (i ? ", " : "") + std::to_string(view.shape[i]);
  return text + (view.ndim == 1 ? ",)" : ")");
}

bool read_buffer(nb::handle from, const ArgumentName& name, const tools::Words& names, double* out) {
  const Buffer buffer(from.ptr());
  if (!buffer.holds_doubles()) return false;
  const Py_buffer& view = buffer.view();
  if (view.ndim != 1 || view.shape[0] != static_cast<Py_ssize_t>(names.size()))
    refuse_shape(from, shape_text(view), name, names);
  const char* at = static_cast<const char*>(view.buf);
  for (std::size_t i = 0; i < names.size(); ++i, at += view.strides[0]) std::memcpy(out + i, at, sizeof(double));
  return true;
}

/// Anything else, by numpy's own rules, but for text and objects.
void read_by_numpy(nb::handle from, const ArgumentName& name, const tools::Words& names, double* out) {
  nb::object array;
  try {
    array = nb::module_::import_("numpy").attr("asarray")(from);
  } catch (nb::python_error&) {
    raise_argument(name.function, name.argument, show(from), expectation(names), "pass an array or a list of numbers",
                   true);
  }
  const std::string kind = nb::cast<std::string>(array.attr("dtype").attr("kind"));
  if (kind.find_first_of("fiu") == std::string::npos)
    raise_argument(name.function, name.argument, show(from) + " of type " + show(from.type()), expectation(names),
                   "pass an array or a list of real numbers", true);
  const nb::object doubles = array.attr("astype")("float64");
  if (!read_buffer(doubles, name, names, out))
    raise_argument(name.function, name.argument, show(from), expectation(names), "pass an array or a list of numbers",
                   true);
}

void check_finite(const ArgumentName& name, const tools::Words& names, Finite finite, const double* values) {
  for (std::size_t i = 0; i < names.size() && finite != Finite::any; ++i) {
    if (std::isfinite(values[i]) || (finite == Finite::or_nan && std::isnan(values[i]))) continue;
    raise_argument(name.function, name.argument, std::to_string(values[i]) + " for " + names[i], "finite numbers",
                   "give " + names[i] + " a finite value");
  }
}

}  // namespace

void read_numbers(nb::handle from, const ArgumentName& name, const tools::Words& names, Finite finite, double* out) {
  if (!read_buffer(from, name, names, out)) read_by_numpy(from, name, names, out);
  check_finite(name, names, finite, out);
}

double read_number(nb::handle from, const ArgumentName& name, const std::string& unit) {
  const double value = PyFloat_AsDouble(from.ptr());
  if (value == -1.0 && PyErr_Occurred()) {
    PyErr_Clear();
    raise_argument(name.function, name.argument, show(from), "a number in " + unit, "pass a float", true);
  }
  if (!std::isfinite(value))
    raise_argument(name.function, name.argument, show(from), "a finite number in " + unit, "pass a finite float");
  return value;
}

std::int64_t read_count(nb::handle from, const ArgumentName& name, std::int64_t low, std::int64_t high) {
  const std::string expected = "a whole number from " + std::to_string(low) + " to " + std::to_string(high);
  const nb::object index = nb::steal(PyNumber_Index(from.ptr()));
  if (!index.is_valid()) {
    PyErr_Clear();
    raise_argument(name.function, name.argument, show(from), expected, "pass an int", true);
  }
  const long long value = PyLong_AsLongLong(index.ptr());
  const bool too_long = value == -1 && PyErr_Occurred();
  if (too_long) PyErr_Clear();
  if (too_long || value < low || value > high)
    raise_argument(name.function, name.argument, show(from), expected, "pass such an int");
  return value;
}

std::optional<std::uint64_t> read_seed(nb::handle from, const ArgumentName& name) {
  if (from.is_none()) return std::nullopt;
  return static_cast<std::uint64_t>(read_count(from, name, 0, std::int64_t{1} << 53));
}

bool read_flag(nb::handle from, const ArgumentName& name) {
  if (!PyBool_Check(from.ptr()))
    raise_argument(name.function, name.argument, show(from), "True or False", "pass one of them", true);
  return from.ptr() == Py_True;
}

void refuse_more(const char* function, const char* parameters, const nb::args& more, const nb::kwargs& others) {
  const std::string remedy = std::string("call ") + function + "(" + parameters + ")";
  for (const nb::handle value : more)
    raise_argument(function, "one argument more", show(value), "nothing", remedy, true);
  for (const auto& [name, value] : others)
    raise_argument(function, nb::cast<std::string>(name).c_str(), show(value), "no argument of that name", remedy,
                   true);
}

}  // namespace tiller::python
