// rollout(): many trajectories of a robot's model at once, in the lanes that planners use.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <vector>

#include "errors.hpp"
#include "robot.hpp"
#include "rollout_batch.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

template <class T>
using Input = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

void ask_keyboard() {
  const nb::gil_scoped_acquire lock;
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

/// The place of a number as numpy counts it, "[3, 0]": `shape` has as many lengths as the array that was passed.
std::string place(std::size_t index, const std::vector<std::size_t>& shape) {
  std::string text;
  for (std::size_t d = shape.size(); d-- > 0; index /= shape[d])
    text = std::to_string(index % shape[d]) + (text.empty() ? "" : ", ") + text;
  return "[" + text + "]";
}

template <class T>
void refuse(std::size_t index, const char* argument, const Input<T>& array, const tools::Words& names) {
  if (index == Batch<T>::kNone) return;
  std::vector<std::size_t> shape;
  for (std::size_t d = 0; d < array.ndim(); ++d) shape.push_back(array.shape(d));
  const std::string name = names[index % names.size()];
  raise_argument("rollout", argument, "NaN or infinity at " + (argument + place(index, shape)) + " (" + name + ")",
                 "finite numbers", "give every value of " + name + " a finite number");
}

template <class T>
Source<T> source(const Input<T>& array, std::size_t ndim_shared) {
  const std::size_t rows = array.ndim() > ndim_shared ? array.shape(0) : 1;
  return {array.data(), rows > 0 ? array.size() / rows : 0, array.ndim() == ndim_shared};
}

template <class T>
void check_shared(const Source<T>& source, const char* argument, const Input<T>& array, const tools::Words& names) {
  for (std::size_t i = 0; i < source.width && source.shared; ++i)
    if (!std::isfinite(source.data[i])) refuse(i, argument, array, names);
}

/// Shapes are checked by the package: x0 (nx) or (B, nx), controls (H, nu) or (B, H, nu), params (np) or (B, np),
/// history (rows x nu), out (B, H + 1, nx).
template <class T>
void rollout(const Robot& robot, const Input<T>& x0, const Input<T>& controls, const Input<T>& params,
             const Input<T>& history, nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu> out, int threads) {
  const Source<T> state = source<T>(x0, 1), inputs = source<T>(controls, 2), values = source<T>(params, 1);
  check_shared(state, "x0", x0, robot->names.states);
  check_shared(inputs, "U", controls, robot->names.inputs);
  check_shared(values, "params", params, robot->names.params);
  const Source<T> before = source<T>(history, 2);
  check_shared(before, "history", history, robot->names.inputs);
  Batch<T> batch(robot, state, inputs, values, before, out.data(), out.shape(0),
                 static_cast<std::uint32_t>(out.shape(1) - 1));
  {
    const nb::gil_scoped_release others;
    batch.run(static_cast<unsigned>(threads), ask_keyboard);
  }
  refuse(batch.bad_state(), "x0", x0, robot->names.states);
  refuse(batch.bad_control(), "U", controls, robot->names.inputs);
  refuse(batch.bad_param(), "params", params, robot->names.params);
}

std::uint32_t history_rows(const Robot& robot) {
  StepSetup setup;
  check_status(make_step_setup(robot->config, setup), "rollout");
  return setup.delay_steps;
}

}  // namespace

void bind_rollout(nb::module_& m) {
  m.def("rollout", &rollout<double>, "robot"_a, "x0"_a.noconvert(), "controls"_a.noconvert(), "params"_a.noconvert(),
        "history"_a.noconvert(), "out"_a.noconvert(), "threads"_a);
  m.def("rollout", &rollout<float>, "robot"_a, "x0"_a.noconvert(), "controls"_a.noconvert(), "params"_a.noconvert(),
        "history"_a.noconvert(), "out"_a.noconvert(), "threads"_a);
  m.def("history_rows", &history_rows, "robot"_a, "Commands before the first that a rollout reads.");
}

}  // namespace tiller::python
