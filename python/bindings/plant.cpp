// Plant: the robot of [sim], in lockstep with whoever steers it.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <csignal>
#include <optional>

#include "arrays.hpp"
#include "command.hpp"
#include "errors.hpp"
#include "tools/links/model_plant.hpp"
#include "tools/links/plant_setup.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

class Plant {
 public:
  /// `params`: see tools::set_true_params; null: as [sim] has it.
  Plant(const Robot& robot, std::optional<std::uint64_t> seed, const double* params) : robot_(*robot) {
    if (seed) robot_.sim.seed = *seed;
    if (params) tools::set_true_params(robot_, params);
    std::string error;
    if (robot_.sim.plant == "model") {
      model_ = tools::ModelPlant::make(robot_, error);
      if (model_) link_ = tools::make_model_link(robot_, *model_), true_params_ = model_->true_params();
    } else {
      plant_ = tools::make_sim_plant(robot_, error);
      if (plant_) link_ = tools::make_sim_link(robot_, *plant_, false), true_params_ = plant_->true_params;
    }
    if (!link_) raise_robot_file(error);
    sensed_ = link_->wait(stop_);
  }
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  /// What the sensors say at the present tick.
  Measurement measurement() const {
    Measurement m;
    m.raw = sensed_.measurement;
    m.now_us = sensed_.now_us;
    m.fresh = sensed_.fresh;
    m.count = static_cast<std::uint32_t>(robot_.names.measurements.size());
    return m;
  }

  void step(const tiller_command_t& command) {
    (void)link_->send(command);
    sensed_ = link_->wait(stop_);
    ++ticks_;
  }

  const tools::RobotFile& robot() const { return robot_; }
  const std::vector<double>& true_params() const { return true_params_; }
  void true_state(double* state) const { (void)link_->truth(state); }
  double time_s() const { return static_cast<double>(ticks_) * robot_.config.period_s; }

 private:
  tools::RobotFile robot_;  // before what points to it
  std::unique_ptr<tools::SimPlant> plant_;
  std::unique_ptr<tools::ModelPlant> model_;
  std::unique_ptr<tools::Link> link_;
  tools::Sensed sensed_;
  std::vector<double> true_params_;
  std::uint64_t ticks_ = 0;
  volatile std::sig_atomic_t stop_ = 0;
};

void make(Plant* at, nb::handle robot, nb::handle seed, nb::handle params, const nb::args& more,
          const nb::kwargs& others) {
  refuse_more("Plant", "robot, seed=None, params=None", more, others);
  const Robot& of = read_robot(robot, "Plant");
  std::vector<double> values(of->names.params.size());
  if (!params.is_none()) read_numbers(params, {"Plant", "params"}, of->names.params, Finite::or_nan, values.data());
  new (at) Plant(of, read_seed(seed, {"Plant", "seed"}), params.is_none() ? nullptr : values.data());
}

void step(Plant& plant, nb::handle command) {
  const Command* given = nullptr;
  const std::size_t nu = plant.robot().names.inputs.size();
  tiller_command_t raw{};
  if (nb::try_cast(command, given, false) && given) {
    if (given->count != nu)
      raise_argument("Plant.step", "command", "a Command of " + std::to_string(given->count) + " values",
                     std::to_string(nu) + " values (" + tools::join(plant.robot().names.inputs) + ")",
                     "pass a command of the same robot");
    raw = given->raw;
  } else {
    read_numbers(command, {"Plant.step", "command"}, plant.robot().names.inputs, Finite::all, raw.value);
  }
  const nb::gil_scoped_release others;
  plant.step(raw);
}

nb::object true_state(const Plant& plant) {
  const std::size_t nx = plant.robot().names.states.size();
  auto* data = new double[nx];
  const nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  plant.true_state(data);
  return nb::cast(nb::ndarray<nb::numpy, double>(data, {nx}, owner));
}

}  // namespace

void bind_plant(nb::module_& m) {
  nb::class_<Plant>(m, "Plant", "The simulated robot of [sim] (ODE), which stands still until it is stepped.")
      .def("__init__", &make, "robot"_a.none() = nb::none(), "seed"_a.none() = nb::none(),
           "params"_a.none() = nb::none(), "more"_a, "others"_a,
           "`seed` in the place of [sim] seed: of the noise, and of true parameters that are drawn. `params` (np): the "
           "true parameters and effects in the place of what [sim] says of them; NaN: as [sim] has it. Without a [sim] "
           "the plant is then the model.")
      .def_prop_ro("measurement", &Plant::measurement, "What the sensors say now, stamped, for Controller.tick.")
      .def("step", &step, "command"_a, "One control period under a Command or an array (nu), held.")
      .def_prop_ro("time_s", &Plant::time_s, "Since the start.")
      .def_prop_ro("true_state", &true_state, "(nx) without any error; NaN: the plant has no such state.")
      .def_prop_ro(
          "true_params",
          [](const nb::pointer_and_handle<Plant>& s) {
            return view(s.h, s.p->true_params().data(), {s.p->true_params().size()});
          },
          "(np) in the order of Robot.params; NaN: the plant has nothing that answers to it.");
}

}  // namespace tiller::python
