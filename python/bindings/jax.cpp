// The functions that XLA calls for the primitives of tiller.jax (python/tiller/jax), by its foreign function interface:
// values here, the derivatives' linear map in jax_linear.cpp.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include "jax_rows.hpp"
#include "slopes.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

/// states (.., H + 1, nx), or cost (..) where `costs`, of x0 (.., nx), u (.., H, nu), p (.., np), history (rows, nu).
ffi::Error roll(In x0, In u, In p, In history, Out out, std::int64_t number, std::int64_t threads, bool costs) {
  const JaxRobot* robot = fitting(number, x0, u, p);
  if (!robot) return unknown();
  return with_type(x0, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead{{*out, costs ? 0u : 2u}};
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

/// by_state (.., H + 1, nx), by_control (.., H, nu) and by_param (.., np) of the cost of states, u and p.
ffi::Error cost_slopes(In states, In u, In p, Out x_out, Out u_out, Out p_out, std::int64_t number,
                       std::int64_t threads) {
  const JaxRobot* robot = fitting(number, states, u, p);
  if (!robot) return unknown();
  return with_type(states, [&](auto zero) {
    using T = decltype(zero);
    const Lead lead{{*x_out, 2}};
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

nb::dict targets() {
  nb::dict all;
  const auto add = [&](const char* name, XLA_FFI_Handler* handler) {
    all[name] = nb::capsule(reinterpret_cast<void*>(handler), "xla._CUSTOM_CALL_TARGET");
  };
  add("rollout", kRollout);
  add("cost", kCost);
  add("cost_slopes", kCostSlopes);
  add("push", kJaxPush);
  add("pull", kJaxPull);
  return all;
}

}  // namespace

void bind_jax(nb::module_& m) {
  m.def("jax_targets", &targets, "What XLA calls, by the names of tiller.jax's primitives.");
  m.def("jax_number", &jax_number, "robot"_a, "Of a robot in calls of these.");
  m.def(
      "jax_memory",
      [](std::int64_t number) {
        const StepSetup& setup = jax_robot(number)->setup;
        return nb::make_tuple(setup.effect_state_count, setup.delay_steps);
      },
      "number"_a, "States of the effects, and commands before the first that a rollout reads.");
}

}  // namespace tiller::python
