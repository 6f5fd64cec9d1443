// The derivative of trajectories as XLA calls it: the linear map z+ = a z + b du + c dp along them, and its transpose.
// The Jacobians are found where they are used, a share of trajectories at a time, so that they never leave the cache:
// those of all trajectories would take some ten times the states' memory.
#include "jax_rows.hpp"
#include "slopes.hpp"

namespace tiller::python {
namespace {

/// Jacobians of every period of one trajectory.
struct Jacobians {
  const double *a, *b, *c;  // (H x nz x nz), (H x nz x nu), (H x nz x np), np = 0 where they are not wanted
};

/// The trajectories that a call linearises around, and the lanes of each: vmap over what is multiplied leaves the
/// trajectories as they are.
template <class T>
class Around {
 public:
  const JaxRobot& robot;
  const std::size_t horizon, nx, nz, nu, np;

  Around(const JaxRobot& r, const In& x, const In& u, const In& p, const Lead& lead, bool by_params)
      : robot(r),
        horizon(length(u, 2)),
        nx(r.nx()),
        nz(r.nz()),
        nu(r.nu()),
        np(by_params ? r.np() : 0),
        own_({{x, 2}, {u, 2}, {p, 1}}),
        x_(own_.rows<T>(x, 2, of_x_)),
        u_(own_.rows<T>(u, 2, of_u_)),
        p_(own_.rows<T>(p, 1, of_p_)),
        begin_(own_.count() + 1),
        lanes_(lead.count()) {
    const std::vector<std::size_t> trajectory = lead.lanes_of(own_);
    for (const std::size_t n : trajectory) ++begin_[n + 1];
    for (std::size_t n = 0; n < own_.count(); ++n) begin_[n + 1] += begin_[n];
    std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
    for (std::size_t lane = 0; lane < lanes_.size(); ++lane) lanes_[next[trajectory[lane]]++] = lane;
  }

  /// f(lane, Jacobians) for every lane.
  template <class F>
  void for_lanes(std::int64_t threads, const F& f) const {
    share_out(own_.count(), horizon, threads, [&](std::size_t first, std::size_t count) {
      thread_local std::vector<double> x, u, p, a, b, c;
      a.resize(count * horizon * nz * nz);
      b.resize(count * horizon * nz * nu);
      c.resize(count * horizon * nz * np);
      SlopesJob job;
      job.robot = &robot;
      job.trajectories = static_cast<std::uint32_t>(count);
      job.horizon = static_cast<std::uint32_t>(horizon);
      job.shared_params = p_.shared;
      job.states = each_doubles(x_, first, count, x);
      job.controls = each_doubles(u_, first, count, u);
      job.params = doubles(p_, first, count, p);
      job.a = a.data();
      job.b = b.data();
      job.p = np > 0 ? c.data() : nullptr;
      find_slopes(job);
      for (std::size_t n = 0; n < count; ++n) {
        const std::size_t rows = n * horizon * nz;
        for (std::size_t at = begin_[first + n]; at < begin_[first + n + 1]; ++at)
          f(lanes_[at], Jacobians{a.data() + rows * nz, b.data() + rows * nu, c.data() + rows * np});
      }
    });
  }

 private:
  Lead own_;
  std::vector<std::size_t> of_x_, of_u_, of_p_;
  Source<T> x_, u_, p_;
  std::vector<std::size_t> begin_, lanes_;  // lanes_[begin_[n] ..]: those of trajectory n
};

constexpr std::size_t kMostZ = TILLER_MAX_STATES + TILLER_MAX_EFFECT_STATES;

/// to[i] += sum_j m[i][j] x[j], or with the matrix transposed.
void add_product(const double* m, std::size_t rows, std::size_t columns, const double* x, double* to) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) to[i] += m[i * columns + j] * x[j];
}
void add_transposed(const double* m, std::size_t rows, std::size_t columns, const double* x, double* to) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) to[j] += m[i * columns + j] * x[i];
}

/// dx (.., H + 1, nx) of dx0 (.., nx), du (.., H, nu) and dp (.., np, or 0: constants), around x, u, p.
ffi::Error push(In x, In u, In p, In dx0, In du, In dp, Out dx, std::int64_t number, std::int64_t threads) {
  const JaxRobot* robot = fitting(number, x, u, p);
  if (!robot) return unknown();
  return with_type(x, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead{{*dx, 2}};
    std::vector<std::size_t> of_x, of_u, of_p;
    const Source<T> xs = lead.rows<T>(dx0, 1, of_x), us = lead.rows<T>(du, 2, of_u), ps = lead.rows<T>(dp, 1, of_p);
    const Around<T> around(*robot, x, u, p, lead, ps.width > 0);
    T* const out = dx->typed_data<T>();
    around.for_lanes(threads, [&](std::size_t lane, Jacobians j) {
      const std::size_t nx = around.nx, nz = around.nz, nu = around.nu, np = around.np;
      double z[kMostZ] = {}, next[kMostZ], push_u[TILLER_MAX_INPUTS], push_p[TILLER_MAX_PARAMS];
      const T* from_u = us.of(lane);
      T* to = out + lane * (around.horizon + 1) * nx;
      std::copy(xs.of(lane), xs.of(lane) + nx, z);
      std::copy(ps.of(lane), ps.of(lane) + np, push_p);
      for (std::size_t k = 0;; ++k) {
        for (std::size_t i = 0; i < nx; ++i) *to++ = static_cast<T>(z[i]);
        if (k == around.horizon) break;
        for (std::size_t i = 0; i < nu; ++i) push_u[i] = static_cast<double>(*from_u++);
        std::fill(next, next + nz, 0.0);
        add_product(j.a, nz, nz, z, next);
        add_product(j.b, nz, nu, push_u, next);
        add_product(j.c, nz, np, push_p, next);
        std::copy(next, next + nz, z);
        j.a += nz * nz, j.b += nz * nu, j.c += nz * np;
      }
    });
    return ffi::Error::Success();
  });
}

/// The transpose: to_x0 (.., nx), to_u (.., H, nu) and to_p (.., np, or 0: not wanted) of weights (.., H + 1, nx) of
/// the states.
ffi::Error pull(In x, In u, In p, In weights, Out to_x0, Out to_u, Out to_p, std::int64_t number,
                std::int64_t threads) {
  const JaxRobot* robot = fitting(number, x, u, p);
  if (!robot) return unknown();
  return with_type(x, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead{{*to_x0, 1}};
    std::vector<std::size_t> of_w;
    const Source<T> ws = lead.rows<T>(weights, 2, of_w);
    const Around<T> around(*robot, x, u, p, lead, length(*to_p, 1) > 0);
    T *const x_out = to_x0->typed_data<T>(), *const u_out = to_u->typed_data<T>(), *const p_out = to_p->typed_data<T>();
    around.for_lanes(threads, [&](std::size_t lane, const Jacobians& j) {
      const std::size_t horizon = around.horizon, nx = around.nx, nz = around.nz, nu = around.nu, np = around.np;
      double z[kMostZ] = {}, before[kMostZ], pull_u[TILLER_MAX_INPUTS], pull_p[TILLER_MAX_PARAMS] = {};
      const T* weight = ws.of(lane) + horizon * nx;
      std::copy(weight, weight + nx, z);
      for (std::size_t k = horizon; k-- > 0;) {
        weight -= nx;
        for (std::size_t i = 0; i < nx; ++i) before[i] = static_cast<double>(weight[i]);
        std::fill(before + nx, before + nz, 0.0);
        std::fill(pull_u, pull_u + nu, 0.0);
        add_transposed(j.a + k * nz * nz, nz, nz, z, before);
        add_transposed(j.b + k * nz * nu, nz, nu, z, pull_u);
        add_transposed(j.c + k * nz * np, nz, np, z, pull_p);
        for (std::size_t i = 0; i < nu; ++i) u_out[(lane * horizon + k) * nu + i] = static_cast<T>(pull_u[i]);
        std::copy(before, before + nz, z);
      }
      for (std::size_t i = 0; i < nx; ++i) x_out[lane * nx + i] = static_cast<T>(z[i]);
      for (std::size_t i = 0; i < np; ++i) p_out[lane * np + i] = static_cast<T>(pull_p[i]);
    });
    return ffi::Error::Success();
  });
}

XLA_FFI_DEFINE_HANDLER(kPush, push,
                       ffi::Ffi::Bind()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Arg<In>()
                           .Ret<ffi::AnyBuffer>()
                           .Attr<std::int64_t>("robot")
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
                           .Attr<std::int64_t>("robot")
                           .Attr<std::int64_t>("threads"));

}  // namespace

XLA_FFI_Handler* const kJaxPush = kPush;
XLA_FFI_Handler* const kJaxPull = kPull;

}  // namespace tiller::python
