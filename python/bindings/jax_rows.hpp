#pragma once

// Operands and results of the calls from XLA. They have leading batch dimensions, as many each, of which one of length
// 1 stands for whatever the others have.

#include <algorithm>
#include <cstddef>
#include <exception>
#include <initializer_list>
#include <vector>

#include "jax_robot.hpp"
#include "rollout_batch.hpp"
#include "xla/ffi/api/ffi.h"

namespace tiller::python {

namespace ffi = xla::ffi;
using In = ffi::AnyBuffer;
using Out = ffi::Result<ffi::AnyBuffer>;

/// An operand and how many of its dimensions, the last ones, are a row.
struct Rows {
  const ffi::AnyBuffer& buffer;
  std::size_t core;
};

/// What the leading dimensions of some operands come to, which have as many each: a row for each lane.
class Lead {
 public:
  Lead(std::initializer_list<Rows> operands) {
    for (const Rows& rows : operands) {
      const auto dims = rows.buffer.dimensions();
      shape_.resize(dims.size() - rows.core, 1);
      for (std::size_t d = 0; d < shape_.size(); ++d)
        if (dims[d] != 1) shape_[d] = static_cast<std::size_t>(dims[d]);
    }
    for (const std::size_t length : shape_) count_ *= length;
  }
  std::size_t count() const { return count_; }

  /// For each of these lanes, the lane of one whose dimensions are this one's or 1.
  std::vector<std::size_t> lanes_of(const Lead& other) const {
    std::vector<std::size_t> index(count_);
    for (std::size_t lane = 0; lane < count_; ++lane) {
      std::size_t rest = lane, stride = 1;
      for (std::size_t d = shape_.size(); d-- > 0; rest /= shape_[d], stride *= other.shape_[d])
        if (other.shape_[d] > 1) index[lane] += rest % shape_[d] * stride;
    }
    return index;
  }

  /// Rows of an operand whose last `core` dimensions are a row. `index` keeps what the rows refer to.
  template <class T>
  Source<T> rows(const In& operand, std::size_t core, std::vector<std::size_t>& index) const {
    const auto dims = operand.dimensions();
    Source<T> source{operand.typed_data<T>(), 1, false};
    std::size_t held = 1;
    for (std::size_t d = 0; d < dims.size(); ++d)
      (d + core < dims.size() ? held : source.width) *= static_cast<std::size_t>(dims[d]);
    source.shared = held == 1;
    if (held == 1 || held == count_) return source;
    index = lanes_of(Lead{{operand, core}});
    source.row = index.data();
    return source;
  }

 private:
  std::vector<std::size_t> shape_;
  std::size_t count_ = 1;
};

inline std::size_t length(const ffi::AnyBuffer& buffer, std::size_t from_end) {
  const auto dims = buffer.dimensions();
  return static_cast<std::size_t>(dims[dims.size() - from_end]);
}

/// f(T()) for the type of the numbers; what is thrown becomes an error of XLA's.
template <class F>
ffi::Error with_type(const In& of, F&& f) {
  try {
    if (of.element_type() == ffi::DataType::F64) return f(double());
    if (of.element_type() == ffi::DataType::F32) return f(float());
    return ffi::Error::InvalidArgument("tiller.jax: numbers are float64 or float32");
  } catch (const std::exception& problem) {
    return ffi::Error::Internal(problem.what());
  }
}

/// f(first, count) over shares of n trajectories of `horizon` periods, on several threads.
template <class F>
void share_out(std::size_t n, std::size_t horizon, std::int64_t threads, const F& f) {
  struct Work {
    const F& f;
    std::size_t n, share;
  };
  constexpr std::size_t kPeriods = 256;  // of a share: its Jacobians stay in the second cache
  const std::size_t share = std::max<std::size_t>(1, kPeriods / std::max<std::size_t>(1, horizon));
  Work work{f, n, share};
  const auto pieces = static_cast<std::uint32_t>((n + share - 1) / share);
  const auto piece = [](void* self, std::uint32_t i) {
    const Work& w = *static_cast<Work*>(self);
    w.f(i * w.share, std::min(w.share, w.n - i * w.share));
  };
  if (threads == 1 || pieces == 1)
    for (std::uint32_t i = 0; i < pieces; ++i) piece(&work, i);
  else
    crew().run(static_cast<unsigned>(threads), pieces, piece, &work);
}

/// Rows `first` to `first + count` as contiguous doubles; in place where that is what they are.
template <class T>
const double* doubles(const Source<T>& source, std::size_t first, std::size_t count, std::vector<double>& kept) {
  if (source.shared) count = 1;
  if constexpr (sizeof(T) == sizeof(double))
    if (source.shared || !source.row) return source.of(first);
  kept.resize(source.width * count);
  for (std::size_t n = 0; n < count; ++n)
    std::copy(source.of(first + n), source.of(first + n) + source.width, kept.data() + n * source.width);
  return kept.data();
}
/// The same, with a row for each trajectory where all share one.
template <class T>
const double* each_doubles(Source<T> source, std::size_t first, std::size_t count, std::vector<double>& kept) {
  const std::vector<std::size_t> same(source.shared ? first + count : 0, 0);
  if (source.shared) source = {source.data, source.width, false, same.data()};
  return doubles(source, first, count, kept);
}

/// Where a share's results go: in place where they are doubles, else to be taken over by put().
template <class T>
class Sink {
 public:
  Sink(const ffi::AnyBuffer& out, std::size_t width, std::size_t first, std::size_t count)
      : to_(out.template typed_data<T>() + first * width), size_(count * width) {
    if constexpr (sizeof(T) != sizeof(double)) kept_.resize(size_);
  }
  double* data() {
    if constexpr (sizeof(T) == sizeof(double))
      return to_;
    else
      return kept_.data();
  }
  void put() {
    if constexpr (sizeof(T) != sizeof(double))
      for (std::size_t i = 0; i < size_; ++i) to_[i] = static_cast<T>(kept_[i]);
  }

 private:
  T* to_;
  std::size_t size_;
  std::vector<double> kept_;
};

inline const JaxRobot* fitting(std::int64_t number, const In& x, const In& u, const In& p) {
  const JaxRobot* robot = jax_robot(number);
  const bool fits = robot && length(x, 1) == robot->nx() && length(u, 1) == robot->nu() && length(p, 1) == robot->np();
  return fits ? robot : nullptr;
}
inline ffi::Error unknown() {
  return ffi::Error::InvalidArgument("tiller.jax: a program that another process has compiled");
}

extern XLA_FFI_Handler* const kJaxPush;
extern XLA_FFI_Handler* const kJaxPull;

}  // namespace tiller::python
