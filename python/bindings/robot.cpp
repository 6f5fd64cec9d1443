#include "robot.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "errors.hpp"
#include "tools/links/trial_plant.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/stage_cost.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;
using tools::RobotFile;
using tools::Words;

/// Reading may compile a model or wait for trial steps: other threads go on meanwhile.
Robot finish(std::unique_ptr<RobotFile> file, const std::string& errors) {
  if (!file) raise_robot_file(errors);
  return {std::shared_ptr<const RobotFile>(std::move(file))};
}

Robot read_file(const std::string& path) {
  std::string errors;
  std::unique_ptr<RobotFile> file;
  {
    const nb::gil_scoped_release others;
    file = tools::read_robot_file(path, errors);
  }
  return finish(std::move(file), errors);
}

Robot read_text(const std::string& text, const std::string& path) {
  std::string errors;
  std::unique_ptr<RobotFile> file;
  {
    const nb::gil_scoped_release others;
    file = tools::parse_robot_file(text, path, errors);
  }
  return finish(std::move(file), errors);
}

nb::object helpers() { return nb::module_::import_("tiller._robots"); }

Robot from_toml(nb::handle path) { return read_file(nb::cast<std::string>(helpers().attr("find")(path))); }

Robot from_urdf(nb::handle description, nb::handle folder, nb::handle options) {
  const nb::object text = nb::module_::import_("os").attr("fspath")(description);
  return read_file(nb::cast<std::string>(helpers().attr("import_description")(text, folder, options)));
}

Robot from_model_header(nb::handle header, const std::string& type, nb::handle settings) {
  const nb::object made = helpers().attr("with_model_header")(header, type, settings);
  return read_text(nb::cast<std::string>(made[0]), nb::cast<std::string>(made[1]));
}

nb::object centre(const nb::pointer_and_handle<Robot>& self) {
  const Config& config = (*self.p)->config;
  auto* values = new double[config.param_count + 1];
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  for (std::uint32_t i = 0; i < config.param_count; ++i) values[i] = tools::centre_of(config.priors[i]);
  return view(owner, values, {config.param_count});
}

/// A prior as a dictionary, with the words of a robot file.
nb::dict prior_of(const tiller_prior_t& prior) {
  static constexpr const char* kKinds[] = {"fixed", "uniform", "normal", "log_normal"};
  nb::dict d;
  d["kind"] = kKinds[prior.kind];
  if (prior.kind == tiller_prior_fixed) {
    d["value"] = prior.a;
    return d;
  }
  if (prior.kind != tiller_prior_uniform) d["middle"] = prior.a, d["sd"] = prior.b;
  d["low"] = prior.low;
  d["high"] = prior.high;
  return d;
}

nb::dict priors(const Robot& robot) {
  nb::dict d;
  for (std::size_t i = 0; i < robot->names.params.size(); ++i)
    d[robot->names.params[i].c_str()] = prior_of(robot->config.priors[i]);
  return d;
}

double stage_cost(const Robot& robot, nb::handle x, nb::handle u, nb::handle step, nb::handle params) {
  std::vector<double> values(robot->names.params.size());
  double state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS];
  read_numbers(x, {"Robot.stage_cost", "x"}, robot->names.states, Finite::all, state);
  read_numbers(u, {"Robot.stage_cost", "u"}, robot->names.inputs, Finite::all, input);
  const std::int64_t k = read_count(step, {"Robot.stage_cost", "step"}, 0, std::int64_t{1} << 53);
  if (!params.is_none())
    read_numbers(params, {"Robot.stage_cost", "params"}, robot->names.params, Finite::all, values.data());
  return tools::stage_cost(robot->config, static_cast<std::uint64_t>(k), state, input,
                           params.is_none() ? nullptr : values.data());
}

template <double* (*Pick)(Config&)>
auto row(std::size_t (*count)(const RobotFile&)) {
  return [count](const nb::pointer_and_handle<Robot>& self) {
    auto& config = const_cast<Config&>((*self.p)->config);  // a view of what nobody changes
    return view(self.h, Pick(config), {count(**self.p)});
  };
}

std::size_t states(const RobotFile& r) { return r.names.states.size(); }
std::size_t inputs(const RobotFile& r) { return r.names.inputs.size(); }
double* initial_state(Config& c) { return c.initial_state; }
double* target(Config& c) { return c.cost.target; }
double* input_low(Config& c) { return c.safety.input_low; }
double* input_high(Config& c) { return c.safety.input_high; }

}  // namespace

const Robot& read_robot(nb::handle from, const char* function) {
  const Robot* robot = nullptr;
  if (!nb::try_cast(from, robot, false) || !robot)
    raise_argument(function, "robot", show(from), "a tiller.Robot", "pass tiller.Robot.from_toml(...)", true);
  return *robot;
}

void bind_robot(nb::module_& m) {
  nb::class_<Robot>(m, "Robot", "A robot file, read, checked and complete; constant.")
      .def("__init__", made_by<Robot>("Robot", "call Robot.from_toml, from_text, from_urdf or from_model_header"))
      .def_static("from_toml", &from_toml, "path"_a,
                  "Reads a robot file, or one that comes with the package, by its name (tiller.robot_names()).")
      .def_static("from_text", &read_text, "text"_a, "path"_a = "robot.toml",
                  "Reads a robot file's text; relative files are looked for beside `path`.")
      .def_static("from_urdf", &from_urdf, "description"_a, "folder"_a = nb::none(), "options"_a = nb::make_tuple(),
                  "Imports a URDF, MJCF or CasADi function by `tiller import` with these options; model and robot file "
                  "go to `folder` (None: one below the user's cache). Needs a C++ compiler.")
      .def_static(
          "from_model_header", &from_model_header, "header"_a, "type"_a, "settings"_a,
          "A model of one's own, struct `type` in a C++ header; `settings` has the sections of a robot file but "
          "[model] file and type, as a dictionary or as a file. Needs a C++ compiler.")
      .def_prop_ro("name", [](const Robot& r) { return r->name; })
      .def_prop_ro("path", [](const Robot& r) { return r->path; })
      .def_prop_ro("model", [](const Robot& r) { return std::string(r->config.model->name); })
      .def_prop_ro(
          "states", [](const Robot& r) { return r->names.states; }, "Names of the model's states, with units.")
      .def_prop_ro(
          "inputs", [](const Robot& r) { return r->names.inputs; }, "Names of the model's inputs.")
      .def_prop_ro(
          "measurements", [](const Robot& r) { return r->names.measurements; }, "Names of what is measured.")
      .def_prop_ro(
          "outputs", [](const Robot& r) { return r->names.outputs; }, "Names of the model's outputs.")
      .def_prop_ro(
          "params", [](const Robot& r) { return r->names.params; }, "The model's parameters, then the effects'.")
      .def_prop_ro(
          "period_s", [](const Robot& r) { return r->config.period_s; }, "Of the control tick.")
      .def_prop_ro(
          "horizon", [](const Robot& r) { return r->config.planner.horizon; }, "Steps of a plan.")
      .def_prop_ro(
          "plant", [](const Robot& r) { return r->sim.plant; }, "Of [sim]; empty: none.")
      .def_prop_ro("priors", &priors, "name -> {kind, value} or {kind, low, high, ...}.")
      .def_prop_ro("prior_centre", &centre, "(np) the value in the middle of what each prior expects.")
      .def_prop_ro("initial_state", row<initial_state>(states), "(nx) expected at the first measurement.")
      .def_prop_ro("target", row<target>(states), "(nx) of the task.")
      .def_prop_ro("input_low", row<input_low>(inputs), "(nu) command limits.")
      .def_prop_ro("input_high", row<input_high>(inputs), "(nu) command limits.")
      .def("stage_cost", &stage_cost, "x"_a, "u"_a, "step"_a = 0, "params"_a = nb::none(),
           "The quadratic terms of the task's cost of one step in state x under input u; with `params` (np) those of "
           "the model's outputs too.")
      .def("__repr__", [](const Robot& r) {
        return "<tiller.Robot " + r->name + ": model " + r->config.model->name + ", " +
               std::to_string(r->names.states.size()) + " states, " + std::to_string(r->names.inputs.size()) +
               " inputs, " + std::to_string(r->names.params.size()) + " parameters>";
      });
}

}  // namespace tiller::python
