// What training a policy needs of the runtime: a planner without its controller, the model in motion, and what a policy
// reads. The package's laboratories call this; it checks sizes, not more.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/rng.hpp"
#include "errors.hpp"
#include "model_motion.hpp"
#include "planner_alone.hpp"
#include "planners/policy_inputs.hpp"
#include "robot.hpp"
#include "rollout/measurement.hpp"
#include "tools/base/unit_names.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/robot/network_file.hpp"
#include "tools/robot/robot_schema.hpp"
#include "tools/robot/stage_cost.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;
using Numbers = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

constexpr std::uint32_t kPurpose = 0x6470;  // of random numbers (core/rng.hpp)

void need(const Numbers& array, std::size_t size, const char* argument) {
  if (array.size() == size) return;
  raise_argument("training", argument, std::to_string(array.size()) + " numbers", std::to_string(size) + " numbers",
                 "pass an array of that size");
}

nb::object copied(const double* data, std::initializer_list<std::size_t> shape) {
  std::size_t size = 1;
  for (const std::size_t n : shape) size *= n;
  auto* values = new double[size + 1];
  std::copy(data, data + size, values);
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, double>(values, shape.size(), shape.begin(), owner));
}

/// With the robot file to whose networks the planner points.
struct Planner {
  explicit Planner(const Robot& of) : robot(of) {
    std::string error;
    alone = PlannerAlone::make(of->config, error);
    if (!alone) raise_robot_file(of->path + ": " + error);
  }
  Robot robot;
  std::unique_ptr<PlannerAlone> alone;
};

/// (command (nu), gain (nu, nx) or None); None: no finite plan.
nb::object plan(Planner& held, const Numbers& x, const Numbers& effect_state, const Numbers& params,
                const Numbers& mean, const Numbers& sd, const Numbers& last, std::uint64_t step) {
  PlannerAlone& planner = *held.alone;
  const tiller_config_t& c = planner.config();
  const std::size_t nx = c.model->state_count, nu = c.model->input_count, np = c.param_count;
  need(x, nx, "x");
  need(effect_state, planner.setup().effect_state_count, "effect_state");
  need(params, planner.hypotheses() * np, "params");
  need(mean, np, "mean");
  need(sd, np, "sd");
  need(last, nu, "last");
  double command[TILLER_MAX_INPUTS] = {};
  std::vector<double> gain(nu * nx);
  bool finite = false, answers = false;
  {
    const nb::gil_scoped_release others;
    finite = planner.plan({x.data(), effect_state.data(), params.data(), mean.data(), sd.data(), last.data(), step},
                          command);
    answers = finite && c.model->quaternion_mask == 0 && planner.feedback(gain.data(), nullptr);
  }
  if (!finite) return nb::none();
  return nb::make_tuple(copied(command, {nu}), answers ? copied(gain.data(), {nu, nx}) : nb::none());
}

/// The model under hidden parameters, without input delays.
struct Motion {
  Motion(const Robot& of, const Numbers& values) : robot(of), params(values.data(), values.data() + values.size()) {
    need(values, of->names.params.size(), "params");
    check_status(make_step_setup(of->config, setup), "Motion");
    leave_delays_out(setup);
    model = std::make_unique<ModelMotion>(of->config, setup, params);
    model->start(of->config.initial_state);
  }

  /// Whether every state is finite and every sensor reads within its range.
  bool readable() const {
    const tiller_config_t& c = robot->config;
    for (std::uint32_t i = 0; i < c.model->state_count; ++i)
      if (!(std::fabs(model->state()[i]) < 1e6)) return false;
    for (std::uint32_t k = 0; k < c.measurement_count; ++k) {
      const double value =
          measured_value(c, params.data(), k, sight_of(*c.model, c.measured_state[k], model->state(), 1));
      if (c.safety.measurement_low && value < c.safety.measurement_low[k]) return false;
      if (c.safety.measurement_high && value > c.safety.measurement_high[k]) return false;
    }
    return true;
  }

  Robot robot;
  std::vector<double> params;
  StepSetup setup;
  std::unique_ptr<ModelMotion> model;
};

double next_uniform(void* rng) { return static_cast<Rng*>(rng)->uniform(); }

/// (count, np) draws from the priors; a fixed parameter has its value.
nb::object draw_params(const Robot& robot, std::uint64_t seed, std::uint32_t count) {
  const std::uint32_t np = robot->config.param_count;
  std::vector<double> values;
  for (std::uint32_t i = 0; i < count; ++i)
    for (std::uint32_t p = 0; p < np; ++p) {
      Rng rng(seed, kPurpose, std::uint64_t{i} * np + p);
      values.push_back(tools::draw_from_prior(robot->config.priors[p], next_uniform, &rng));
    }
  return copied(values.data(), {count, np});
}

nb::object policy_row(const Robot& robot, std::uint32_t reads, const Numbers& x, const Numbers& mean, const Numbers& sd,
                      const Numbers& last, std::uint64_t step) {
  const tiller_config_t& c = robot->config;
  need(x, c.model->state_count, "x");
  need(mean, c.param_count, "mean");
  need(sd, c.param_count, "sd");
  need(last, c.model->input_count, "last");
  std::vector<double> in(policy_input_count(c, reads));
  fill_policy_inputs(c, reads, {x.data(), mean.data(), sd.data(), last.data(), step}, in.data());
  return copied(in.data(), {in.size()});
}

/// (nx) of [sim]'s sensors; 0 where there is none.
nb::object sensor_deviations(const Robot& robot) {
  std::vector<double> sd;
  for (const std::string& name : robot->names.states) {
    const auto found = robot->sim.sensor_sd.find(name);
    sd.push_back(found == robot->sim.sensor_sd.end() ? 0.0 : found->second);
  }
  return copied(sd.data(), {sd.size()});
}

/// [(state of the position, state of the velocity)].
nb::list joints(const tiller_model_t& model) {
  nb::list all;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position != TILLER_NO_POSITION)
      all.append(nb::make_tuple(unsigned{model.joints[j].position}, unsigned{model.joints[j].velocity}));
  return all;
}

/// What a laboratory asks of a robot file beside what Robot tells.
nb::dict training_facts(const Robot& robot) {
  const tiller_config_t& c = robot->config;
  const std::size_t nx = c.model->state_count;
  nb::dict d;
  d["planner"] = find_planner(c.planner.kind)->name;
  d["particles"] = c.planner.particles;
  d["rollouts"] = c.planner.rollouts;
  d["iterations"] = c.planner.iterations;
  d["feedback_if_closed"] = find_planner(c.planner.kind)->feedback_if_closed;
  d["has_reference"] = c.cost.reference != nullptr;
  d["has_sim"] = robot->sim.line != 0;
  d["start_sd"] = copied(c.initial_state_sd, {nx});
  d["process_sd"] = copied(c.process_sd, {nx});
  d["safe_command"] = copied(c.safety.safe_command, {c.model->input_count});
  d["state_weight"] = copied(c.cost.state_weight, {nx});
  d["terminal_weight"] = copied(c.cost.terminal_weight, {nx});
  d["input_weight"] = copied(c.cost.input_weight, {c.model->input_count});
  d["costs_outputs"] = c.cost.outputs && std::any_of(c.cost.outputs, c.cost.outputs + c.cost.output_count,
                                                     [](const tiller_output_cost_t& o) { return o.weight > 0; });
  d["sensor_sd"] = sensor_deviations(robot);
  d["joints"] = joints(*c.model);
  nb::dict units;
  for (const tools::Words* names : {&robot->names.states, &robot->names.inputs})
    for (const std::string& name : *names) units[name.c_str()] = tools::unit_of_field(name);
  d["units"] = units;
  return d;
}

/// The keys of a robot file whose values are numbers: {"section.key": {whole, low, high, low_open, multiple, named}}.
nb::dict number_settings(const std::optional<std::string>& planner) {
  nb::dict all;
  for (const tools::KeySpec& key : tools::robot_keys()) {
    const bool named = key.kind == tools::KeyKind::state_numbers || key.kind == tools::KeyKind::input_numbers;
    nb::dict d;
    d["number"] = named || key.kind == tools::KeyKind::count || key.kind == tools::KeyKind::number;
    d["named"] = named;
    d["whole"] = key.kind == tools::KeyKind::count;
    d["low"] = key.low;
    d["high"] = key.high;
    d["low_open"] = key.low_open;
    d["multiple"] = std::max(1u, key.multiple);
    d["read"] = !planner || std::string(key.section) != "planner" || tools::planner_reads(key, *planner);
    all[(std::string(key.section) + "." + key.key).c_str()] = d;
  }
  return all;
}

}  // namespace

void bind_training(nb::module_& m) {
  nb::class_<Planner>(m, "PlannerAlone", "A planner of the runtime under beliefs that the caller makes up.")
      .def(nb::init<const Robot&>(), "robot"_a)
      .def(
          "reset", [](Planner& p) { p.alone->reset(); }, "The next plan is a task's first.")
      .def_prop_ro("hypotheses", [](const Planner& p) { return p.alone->hypotheses(); })
      .def("plan", &plan, "x"_a, "effect_state"_a, "params"_a, "mean"_a, "sd"_a, "last"_a, "step"_a,
           "(command (nu), feedback gain (nu, nx) or None) for a state, params (hypotheses, np), their mean and sd; "
           "None: no finite plan.");
  nb::class_<Motion>(m, "Motion", "The robot's model under hidden parameters, from the start state on.")
      .def(nb::init<const Robot&, const Numbers&>(), "robot"_a, "params"_a)
      .def(
          "step",
          [](Motion& s, const Numbers& u) {
            need(u, s.robot->names.inputs.size(), "u");
            s.model->step(u.data());
          },
          "u"_a, "One period under u (nu).")
      .def(
          "move",
          [](Motion& s, const Numbers& off) {
            need(off, s.robot->names.states.size(), "off");
            s.model->move(off.data());
          },
          "off"_a, "Adds a difference (nx) to the state.")
      .def(
          "cost",
          [](const Motion& s, const Numbers& u, std::uint64_t step) {
            need(u, s.robot->names.inputs.size(), "u");
            return tools::stage_cost(s.robot->config, step, s.model->state(), u.data(), s.params.data());
          },
          "u"_a, "step"_a)
      .def_prop_ro("readable", &Motion::readable)
      .def_prop_ro("state", [](const Motion& s) { return copied(s.model->state(), {s.robot->names.states.size()}); })
      .def_prop_ro("effect_state",
                   [](const Motion& s) { return copied(s.model->effect_state(), {s.setup.effect_state_count}); });
  m.def("draw_params", &draw_params, "robot"_a, "seed"_a, "count"_a);
  m.def(
      "policy_inputs", [](const Robot& robot, std::uint32_t reads) { return tools::policy_inputs(*robot, reads); },
      "robot"_a, "reads"_a, "Names of what a policy reads.");
  m.def("policy_row", &policy_row, "robot"_a, "reads"_a, "x"_a, "mean"_a, "sd"_a, "last"_a, "step"_a);
  m.def("training_facts", &training_facts, "robot"_a);
  m.def("number_settings", &number_settings, "planner"_a = nb::none());
}

}  // namespace tiller::python
