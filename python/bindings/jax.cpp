// The functions that XLA calls for the primitives of tiller.jax (python/tiller/jax), by its foreign function interface.
// Operands have leading batch dimensions, as many each, of which one of length 1 stands for whatever the others have.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <exception>
#include <vector>

#include "jax_robot.hpp"
#include "rollout_batch.hpp"
#include "slopes.hpp"
#include "xla/ffi/api/ffi.h"

namespace tiller::python {
namespace {

namespace ffi = xla::ffi;
using namespace nb::literals;
using In = ffi::AnyBuffer;
using Out = ffi::Result<ffi::AnyBuffer>;

/// The batch of a call: its dimensions are those of a result.
class Lead {
 public:
  Lead(const ffi::AnyBuffer& result, std::size_t core) {
    const auto dims = result.dimensions();
    for (std::size_t d = 0; d + core < dims.size(); ++d) shape_.push_back(static_cast<std::size_t>(dims[d]));
    for (const std::size_t length : shape_) count_ *= length;
  }
  std::size_t count() const { return count_; }

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
    index.resize(count_);
    for (std::size_t lane = 0; lane < count_; ++lane) {
      std::size_t rest = lane, at = 0, stride = 1;
      for (std::size_t d = shape_.size(); d-- > 0; rest /= shape_[d]) {
        const auto length = static_cast<std::size_t>(dims[d]);
        if (length > 1) at += rest % shape_[d] * stride;
        stride *= length;
      }
      index[lane] = at;
    }
    source.row = index.data();
    return source;
  }

 private:
  std::vector<std::size_t> shape_;
  std::size_t count_ = 1;
};

std::size_t length(const ffi::AnyBuffer& buffer, std::size_t from_end) {
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

const JaxRobot* fitting(std::int64_t number, const In& x, const In& u, const In& p) {
  const JaxRobot* robot = jax_robot(number);
  const bool fits = robot && length(x, 1) == robot->nx() && length(u, 1) == robot->nu() && length(p, 1) == robot->np();
  return fits ? robot : nullptr;
}
ffi::Error unknown() { return ffi::Error::InvalidArgument("tiller.jax: a program that another process has compiled"); }

// ---- values -----------------------------------------------------------------------------------------

/// states (.., H + 1, nx), or cost (..) where `costs`, of x0 (.., nx), u (.., H, nu), p (.., np), history (rows, nu).
ffi::Error roll(In x0, In u, In p, In history, Out out, std::int64_t number, std::int64_t threads, bool costs) {
  const JaxRobot* robot = fitting(number, x0, u, p);
  if (!robot) return unknown();
  return with_type(x0, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead(*out, costs ? 0 : 2);
    std::vector<std::size_t> of_x, of_u, of_p;
    const Source<T> before{history.typed_data<T>(), history.element_count(), true};
    Batch<T> batch(robot->robot, lead.rows<T>(x0, 1, of_x), lead.rows<T>(u, 2, of_u), lead.rows<T>(p, 1, of_p), before,
                   out->typed_data<T>(), lead.count(), static_cast<std::uint32_t>(length(u, 2)));
    if (costs) batch.count_cost(robot->cost(zero));
    batch.run(static_cast<unsigned>(threads), nullptr);
    return ffi::Error::Success();
  });
}
ffi::Error rollout(In x0, In u, In p, In history, Out states, std::int64_t robot, std::int64_t threads) {
  return roll(x0, u, p, history, states, robot, threads, false);
}
ffi::Error cost(In x0, In u, In p, In history, Out cost, std::int64_t robot, std::int64_t threads) {
  return roll(x0, u, p, history, cost, robot, threads, true);
}

// ---- derivatives ------------------------------------------------------------------------------------

/// a (.., H, nz, nz), b (.., H, nz, nu), c (.., H, nz, np or 0: not wanted) of states (.., H + 1, nx), u and p.
ffi::Error slopes(In states, In u, In p, Out a, Out b, Out c, std::int64_t number, std::int64_t threads) {
  const JaxRobot* robot = fitting(number, states, u, p);
  if (!robot) return unknown();
  return with_type(states, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead(*a, 3);
    std::vector<std::size_t> of_x, of_u, of_p;
    const Source<T> way = lead.rows<T>(states, 2, of_x), controls = lead.rows<T>(u, 2, of_u),
                    params = lead.rows<T>(p, 1, of_p);
    const std::size_t horizon = length(u, 2), square = horizon * robot->nz();
    const bool by_params = length(*c, 1) > 0;
    share_out(lead.count(), horizon, threads, [&](std::size_t first, std::size_t count) {
      std::vector<double> x_kept, u_kept, p_kept;
      Sink<T> to_a(*a, square * robot->nz(), first, count), to_b(*b, square * robot->nu(), first, count),
          to_c(*c, by_params ? square * robot->np() : 0, first, count);
      SlopesJob job;
      job.robot = robot;
      job.trajectories = static_cast<std::uint32_t>(count);
      job.horizon = static_cast<std::uint32_t>(horizon);
      job.shared_params = params.shared;
      job.states = each_doubles(way, first, count, x_kept);
      job.controls = each_doubles(controls, first, count, u_kept);
      job.params = doubles(params, first, count, p_kept);
      job.a = to_a.data();
      job.b = to_b.data();
      job.p = by_params ? to_c.data() : nullptr;
      find_slopes(job);
      to_a.put(), to_b.put(), to_c.put();
    });
    return ffi::Error::Success();
  });
}

/// by_state (.., H + 1, nx), by_control (.., H, nu) and by_param (.., np) of the cost of states, u and p.
ffi::Error cost_slopes(In states, In u, In p, Out x_out, Out u_out, Out p_out, std::int64_t number,
                       std::int64_t threads) {
  const JaxRobot* robot = fitting(number, states, u, p);
  if (!robot) return unknown();
  return with_type(states, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead(*x_out, 2);
    std::vector<std::size_t> of_x, of_u, of_p;
    const Source<T> way = lead.rows<T>(states, 2, of_x), controls = lead.rows<T>(u, 2, of_u),
                    params = lead.rows<T>(p, 1, of_p);
    const std::size_t horizon = length(u, 2);
    share_out(lead.count(), horizon, threads, [&](std::size_t first, std::size_t count) {
      std::vector<double> x_kept, u_kept, p_kept;
      for (std::size_t n = first; n < first + count; ++n) {
        Sink<T> to_x(*x_out, (horizon + 1) * robot->nx(), n, 1), to_u(*u_out, horizon * robot->nu(), n, 1),
            to_p(*p_out, robot->np(), n, 1);
        find_cost_slopes({robot, static_cast<std::uint32_t>(horizon), doubles(way, n, 1, x_kept),
                          doubles(controls, n, 1, u_kept), doubles(params, n, 1, p_kept), to_x.data(), to_u.data(),
                          to_p.data()});
        to_x.put(), to_u.put(), to_p.put();
      }
    });
    return ffi::Error::Success();
  });
}

/// to[i] += sum_j m[i][j] x[j], or with the matrix transposed.
template <class T>
void add_product(const T* m, std::size_t rows, std::size_t columns, const double* x, double* to) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) to[i] += static_cast<double>(m[i * columns + j]) * x[j];
}
template <class T>
void add_transposed(const T* m, std::size_t rows, std::size_t columns, const double* x, double* to) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) to[j] += static_cast<double>(m[i * columns + j]) * x[i];
}

/// dx (.., H + 1, nx) of dx0 (.., nx), du (.., H, nu), dp (.., np): z+ = a z + b du + c dp.
ffi::Error push(In a, In b, In c, In dx0, In du, In dp, Out dx, std::int64_t threads) {
  return with_type(a, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead(*dx, 2);
    std::vector<std::size_t> of_a, of_b, of_c, of_x, of_u, of_p;
    const Source<T> as = lead.rows<T>(a, 3, of_a), bs = lead.rows<T>(b, 3, of_b), cs = lead.rows<T>(c, 3, of_c),
                    xs = lead.rows<T>(dx0, 1, of_x), us = lead.rows<T>(du, 2, of_u), ps = lead.rows<T>(dp, 1, of_p);
    const std::size_t horizon = length(a, 3), nz = length(a, 1), nx = xs.width, nu = length(b, 1), np = length(c, 1);
    T* const out = dx->typed_data<T>();
    share_out(lead.count(), horizon, threads, [&](std::size_t first, std::size_t count) {
      std::vector<double> z(nz), next(nz), u(nu), p(np);
      for (std::size_t n = first; n < first + count; ++n) {
        T* to = out + n * (horizon + 1) * nx;
        std::fill(std::copy(xs.of(n), xs.of(n) + nx, z.begin()), z.end(), 0.0);
        if (np > 0) std::copy(ps.of(n), ps.of(n) + np, p.begin());
        for (std::size_t k = 0;; ++k, to += nx) {
          for (std::size_t i = 0; i < nx; ++i) to[i] = static_cast<T>(z[i]);
          if (k == horizon) break;
          std::copy(us.of(n) + k * nu, us.of(n) + (k + 1) * nu, u.begin());
          std::fill(next.begin(), next.end(), 0.0);
          add_product(as.of(n) + k * nz * nz, nz, nz, z.data(), next.data());
          add_product(bs.of(n) + k * nz * nu, nz, nu, u.data(), next.data());
          add_product(cs.of(n) + k * nz * np, nz, np, p.data(), next.data());
          z.swap(next);
        }
      }
    });
    return ffi::Error::Success();
  });
}

/// The transpose: x0 (.., nx), u (.., H, nu) and p (.., np) of the weights w (.., H + 1, nx) of the states.
ffi::Error pull(In a, In b, In c, In w, Out x_out, Out u_out, Out p_out, std::int64_t threads) {
  return with_type(a, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead(*x_out, 1);
    std::vector<std::size_t> of_a, of_b, of_c, of_w;
    const Source<T> as = lead.rows<T>(a, 3, of_a), bs = lead.rows<T>(b, 3, of_b), cs = lead.rows<T>(c, 3, of_c),
                    ws = lead.rows<T>(w, 2, of_w);
    const std::size_t horizon = length(a, 3), nz = length(a, 1), nx = length(w, 1), nu = length(b, 1),
                      np = length(c, 1);
    share_out(lead.count(), horizon, threads, [&](std::size_t first, std::size_t count) {
      std::vector<double> z(nz), before(nz), u(nu), p(np);
      for (std::size_t n = first; n < first + count; ++n) {
        const T* weight = ws.of(n) + horizon * nx;
        std::fill(std::copy(weight, weight + nx, z.begin()), z.end(), 0.0);
        std::fill(p.begin(), p.end(), 0.0);
        for (std::size_t k = horizon; k-- > 0;) {
          std::fill(before.begin(), before.end(), 0.0);
          std::fill(u.begin(), u.end(), 0.0);
          add_transposed(as.of(n) + k * nz * nz, nz, nz, z.data(), before.data());
          add_transposed(bs.of(n) + k * nz * nu, nz, nu, z.data(), u.data());
          add_transposed(cs.of(n) + k * nz * np, nz, np, z.data(), p.data());
          weight -= nx;
          for (std::size_t i = 0; i < nx; ++i) before[i] += static_cast<double>(weight[i]);
          for (std::size_t i = 0; i < nu; ++i)
            u_out->typed_data<T>()[(n * horizon + k) * nu + i] = static_cast<T>(u[i]);
          z.swap(before);
        }
        for (std::size_t i = 0; i < nx; ++i) x_out->typed_data<T>()[n * nx + i] = static_cast<T>(z[i]);
        for (std::size_t i = 0; i < np; ++i) p_out->typed_data<T>()[n * np + i] = static_cast<T>(p[i]);
      }
    });
    return ffi::Error::Success();
  });
}

// ---- what Python asks for -----------------------------------------------------------------------------

XLA_FFI_DEFINE_HANDLER(kRollout, rollout,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("robot")
                           .Attr<std::int64_t>("threads"));
XLA_FFI_DEFINE_HANDLER(kCost, cost,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("robot")
                           .Attr<std::int64_t>("threads"));
XLA_FFI_DEFINE_HANDLER(kSlopes, slopes,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("robot")
                           .Attr<std::int64_t>("threads"));
XLA_FFI_DEFINE_HANDLER(kCostSlopes, cost_slopes,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("robot")
                           .Attr<std::int64_t>("threads"));
XLA_FFI_DEFINE_HANDLER(kPush, push,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("threads"));
XLA_FFI_DEFINE_HANDLER(kPull, pull,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("threads"));

nb::dict targets() {
  nb::dict all;
  const auto add = [&](const char* name, XLA_FFI_Handler* handler) {
    all[name] = nb::capsule(reinterpret_cast<void*>(handler), "xla._CUSTOM_CALL_TARGET");
  };
  add("rollout", kRollout);
  add("cost", kCost);
  add("slopes", kSlopes);
  add("cost_slopes", kCostSlopes);
  add("push", kPush);
  add("pull", kPull);
  return all;
}

}  // namespace

void bind_jax(nb::module_& m) {
  m.def("jax_targets", &targets, "What XLA calls, by the names of tiller.jax's primitives.");
  m.def("jax_number", &jax_number, "robot"_a, "Of a robot in calls of these.");
  m.def(
      "effect_state_count", [](std::int64_t number) { return jax_robot(number)->setup.effect_state_count; }, "number"_a);
}

}  // namespace tiller::python
