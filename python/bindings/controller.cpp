// Controller, Measurement and Command: what a loop calls.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <cstring>
#include <optional>

#include "arrays.hpp"
#include "command.hpp"
#include "errors.hpp"
#include "host.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

constexpr double kLargestTime_s = 9e12;  // in whole microseconds of an int64

std::int64_t micros(nb::handle from, const ArgumentName& name) {
  const double seconds = read_number(from, name, "seconds");
  if (!(std::fabs(seconds) < kLargestTime_s))
    raise_argument(name.function, name.argument, show(from), "seconds of any one monotonic clock",
                   "pass less than 9e12");
  return std::llround(1e6 * seconds);
}

Measurement measurement_of(nb::handle y, std::int64_t now_us, const tools::RobotFile& robot) {
  Measurement m;
  m.count = static_cast<std::uint32_t>(robot.names.measurements.size());
  m.now_us = now_us;
  m.raw.stamp_us = now_us;
  read_numbers(y, {"Controller.tick", "y"}, robot.names.measurements, Finite::any, m.raw.value);
  return m;
}

/// The measurement that a tick takes: the caller's, or one made from its array, stamped now.
const tiller_measurement_t* taken(nb::handle y, std::int64_t now_us, std::uint32_t& sequence,
                                  const tools::RobotFile& robot, Measurement& made) {
  const Measurement* given = nullptr;
  if (y.is_none()) return nullptr;
  if (nb::try_cast(y, given, false) && given) {
    if (given->count != robot.names.measurements.size())
      raise_argument(
          "Controller.tick", "y", "a Measurement of " + std::to_string(given->count) + " values",
          std::to_string(robot.names.measurements.size()) + " values (" + tools::join(robot.names.measurements) + ")",
          "pass a measurement of the same robot");
    sequence = given->raw.sequence;
    return given->fresh ? &given->raw : nullptr;
  }
  made = measurement_of(y, now_us, robot);
  made.raw.sequence = ++sequence;
  return &made.raw;
}

Command tick(Controller& c, nb::handle t, nb::handle y) {
  const std::int64_t now_us = micros(t, {"Controller.tick", "t"});
  Measurement made;
  std::uint32_t sequence = c.sequence;
  const tiller_measurement_t* measurement = taken(y, now_us, sequence, *c.robot(), made);
  const Host::Turn turn(c, "Controller.tick");
  c.sequence = sequence;
  Command command;
  command.count = c.config().model->input_count;
  const nb::gil_scoped_release others;
  command.status = tiller_tick(c.get(), now_us, measurement, &command.raw);
  return command;
}

void prepare(Controller& c) {
  const Host::Turn turn(c, "Controller.prepare");
  const nb::gil_scoped_release others;
  (void)tiller_prepare(c.get());
}

template <tiller_status_t (*Call)(tiller_t*)>
void call(Controller& c, const char* where) {
  const Host::Turn turn(c, where);
  check_status(Call(c.get()), where);
}

void stop(Controller& c) {
  const Host::Turn turn(c, "Controller.stop");
  check_status(tiller_stop(c.get(), tiller_status_stopped), "Controller.stop");
}

void set_target(Controller& c, nb::handle target) {
  double values[TILLER_MAX_STATES];
  read_numbers(target, {"Controller.set_target", "target"}, c.robot()->names.states, Finite::all, values);
  const Host::Turn turn(c, "Controller.set_target");
  check_status(tiller_set_target(c.get(), values), "Controller.set_target");
}

void set_output_target(Controller& c, nb::handle target) {
  double values[TILLER_MAX_OUTPUTS];
  read_numbers(target, {"Controller.set_output_target", "target"}, c.robot()->names.outputs, Finite::all, values);
  const Host::Turn turn(c, "Controller.set_output_target");
  check_status(tiller_set_output_target(c.get(), values), "Controller.set_output_target");
}

using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

std::vector<double> copy_rows(const std::optional<Rows>& rows, const char* argument, const tools::Words& names,
                              std::uint32_t& steps) {
  if (!rows) return {};
  const bool fits = rows->shape(1) == names.size() && rows->shape(0) > 0 && (steps == 0 || steps == rows->shape(0));
  if (!fits)
    raise_argument("Controller.set_reference", argument,
                   "shape (" + std::to_string(rows->shape(0)) + ", " + std::to_string(rows->shape(1)) + ")",
                   "(steps, " + std::to_string(names.size()) + ") with as many steps as the other array",
                   "pass a row a period, a column for each of " + tools::join(names));
  steps = static_cast<std::uint32_t>(rows->shape(0));
  return {rows->data(), rows->data() + rows->size()};
}

void set_reference(Controller& c, const std::optional<Rows>& states, const std::optional<Rows>& outputs) {
  std::uint32_t steps = 0;
  std::vector<double> state_rows = copy_rows(states, "states", c.robot()->names.states, steps);
  std::vector<double> output_rows = copy_rows(outputs, "outputs", c.robot()->names.outputs, steps);
  if (steps == 0)
    raise_argument("Controller.set_reference", "states", "None", "states or outputs",
                   "pass rows to follow; to end a reference, call set_target");
  const Host::Turn turn(c, "Controller.set_reference");
  check_status(tiller_set_reference(c.get(), state_rows.empty() ? nullptr : state_rows.data(),
                                    output_rows.empty() ? nullptr : output_rows.data(), steps),
               "Controller.set_reference");
  c.state_rows().swap(state_rows);
  c.output_rows().swap(output_rows);
}

void make(Controller* at, nb::handle robot, nb::handle threads, nb::handle by_clock, nb::handle seed,
          const nb::args& more, const nb::kwargs& others) {
  refuse_more("Controller", "robot, threads=1, by_clock=False, seed=None", more, others);
  const Robot& of = read_robot(robot, "Controller");
  const auto count = static_cast<unsigned>(read_count(threads, {"Controller", "threads"}, 1, 256));
  const bool clock = read_flag(by_clock, {"Controller", "by_clock"});
  new (at) Controller(of, count, clock, read_seed(seed, {"Controller", "seed"}));
}

void make_measurement(Measurement* at, nb::handle robot, nb::handle stamp, nb::handle y, nb::handle sequence,
                      nb::handle latency_s, const nb::args& more, const nb::kwargs& others) {
  constexpr double kLongest_s = 4000.0;  // microseconds in 32 bits
  refuse_more("Measurement", "robot, stamp, y, sequence=0, latency_s=0.0", more, others);
  const Robot& of = read_robot(robot, "Measurement");
  Measurement made = measurement_of(y, micros(stamp, {"Measurement", "stamp"}), *of);
  made.raw.sequence = static_cast<std::uint32_t>(read_count(sequence, {"Measurement", "sequence"}, 0, 0xffffffff));
  const double latency = read_number(latency_s, {"Measurement", "latency_s"}, "seconds");
  if (!(latency >= 0.0 && latency <= kLongest_s))
    raise_argument("Measurement", "latency_s", show(latency_s), "0 to 4000 s", "pass the time until the command acts");
  made.raw.command_latency_us = static_cast<std::uint32_t>(std::lround(1e6 * latency));
  new (at) Measurement(made);
}

void bind_messages(nb::module_& m) {
  nb::class_<Measurement>(m, "Measurement", "What the sensors said, and when. NaN marks a missing value.")
      .def("__init__", &make_measurement, "robot"_a.none() = nb::none(), "stamp"_a.none() = nb::none(),
           "y"_a.none() = nb::none(), "sequence"_a.none() = 0, "latency_s"_a.none() = 0.0, "more"_a, "others"_a,
           "`stamp` is the second at which y (ny) was read; `latency_s` from then until the answering command acts.")
      .def_prop_ro(
          "t", [](const Measurement& s) { return 1e-6 * static_cast<double>(s.now_us); },
          "Second of the tick that this measurement is for.")
      .def_prop_ro("stamp", [](const Measurement& s) { return 1e-6 * static_cast<double>(s.raw.stamp_us); })
      .def_prop_ro("stamp_us", [](const Measurement& s) { return s.raw.stamp_us; })
      .def_prop_ro("sequence", [](const Measurement& s) { return s.raw.sequence; })
      .def_prop_ro(
          "fresh", [](const Measurement& s) { return s.fresh; }, "False: nothing new; a tick goes without.")
      .def_prop_ro("latency_s", [](const Measurement& s) { return 1e-6 * s.raw.command_latency_us; })
      .def_prop_ro(
          "y", [](const nb::pointer_and_handle<Measurement>& s) { return view(s.h, s.p->raw.value, {s.p->count}); },
          "(ny) values, in the order of Robot.measurements.");
  nb::class_<Command>(m, "Command", "One tick's answer: always finite and within the limits, whatever the status.")
      .def("__init__", made_by<Command>("Command", "call Controller.tick, which returns one"))
      .def_prop_ro(
          "value", [](const nb::pointer_and_handle<Command>& s) { return view(s.h, s.p->raw.value, {s.p->count}); },
          "(nu) inputs, in the order of Robot.inputs.")
      .def_prop_ro(
          "status", [](const Command& c) { return c.status; }, "Why the command is what it is.")
      .def_prop_ro(
          "ok", [](const Command& c) { return c.status == tiller_status_ok; }, "An unlimited fresh plan.")
      .def_prop_ro("text", [](const Command& c) { return std::string(tiller_status_text(c.status)); })
      .def_prop_ro("state", [](const Command& c) { return static_cast<tiller_state_t>(c.raw.state); })
      .def_prop_ro("stamp_us", [](const Command& c) { return c.raw.stamp_us; })
      .def_prop_ro(
          "sequence", [](const Command& c) { return c.raw.sequence; }, "Of the measurement that it answers.")
      .def_prop_ro("plan_sequence", [](const Command& c) { return c.raw.plan_sequence; })
      .def("__repr__", [](const Command& c) {
        std::string text = "<tiller.Command [";
        for (std::uint32_t i = 0; i < c.count; ++i) text += (i ? ", " : "") + std::to_string(c.raw.value[i]);
        return text + "] " + tiller_status_name(c.status) + ", " +
               tiller_state_name(static_cast<tiller_state_t>(c.raw.state)) + ">";
      });
}

}  // namespace

void bind_controller(nb::module_& m) {
  bind_messages(m);
  nb::class_<Controller> controller(m, "Controller",
                                    "A controller in a block of memory of its own. One thread at a time.");
  controller
      .def("__init__", &make, "robot"_a.none() = nb::none(), "threads"_a.none() = 1, "by_clock"_a.none() = false,
           "seed"_a.none() = nb::none(), "more"_a, "others"_a,
           "by_clock: the planner keeps the robot file's deadline_us by the wall clock. Without it the iterations "
           "alone decide, and the same measurements give the same commands to the last bit. `seed` in the place of the "
           "robot file's.")
      .def("tick", &tick, "t"_a, "y"_a.none() = nb::none(),
           "One control period at second `t`: sense, learn, plan, gate. y (ny) is what was measured now, NaN for a "
           "missing value; a Measurement where it was read before; None where there is nothing new. Always returns a "
           "command that is safe to send; its status says why it is what it is.")
      .def("prepare", &prepare, "Does now what the next plan needs and can be done without its measurement.")
      .def(
          "arm", [](Controller& c) { call<tiller_arm>(c, "Controller.arm"); }, "Permits motion.")
      .def(
          "disarm", [](Controller& c) { call<tiller_disarm>(c, "Controller.disarm"); }, "Stops motion: STANDBY.")
      .def("stop", &stop, "Latches SAFE at once; reset() leaves it.")
      .def(
          "reset", [](Controller& c) { call<tiller_reset>(c, "Controller.reset"); },
          "Leaves SAFE: INIT, disarmed. What was learned is kept.")
      .def("set_target", &set_target, "target"_a, "Where to go, in states (nx).")
      .def("set_output_target", &set_output_target, "target"_a, "Where to bring the model's outputs (ny).")
      .def("set_reference", &set_reference, "states"_a = nb::none(), "outputs"_a = nb::none(),
           "Rows to follow, one a period; the last one holds. The arrays are copied.")
      .def(
          "force_iterations",
          [](Controller& c, std::uint32_t n) {
            check_status(tiller_force_iterations(c.get(), n), "Controller.force_iterations");
          },
          "iterations"_a, "The next plan takes exactly this many iterations.");
  bind_reads(m, controller);
}

}  // namespace tiller::python
