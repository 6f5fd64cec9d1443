#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <cstdint>
#include <initializer_list>

namespace tiller::python {

namespace nb = nanobind;

/// A read-only numpy array over memory of `owner`, which lives at least as long as the array.
using View = nb::ndarray<nb::numpy, const double, nb::ro>;

inline nb::object view(nb::handle owner, const double* data, std::initializer_list<std::size_t> shape,
                       std::initializer_list<std::int64_t> strides = {}) {
  const View array(data, shape.size(), shape.begin(), owner, strides.size() ? strides.begin() : nullptr);
  return nb::cast(array);
}

}  // namespace tiller::python
