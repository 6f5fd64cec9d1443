// Info and Posterior: what a controller tells, in views of its own memory.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <bitset>

#include "abi/controller.hpp"
#include "arrays.hpp"
#include "command.hpp"
#include "errors.hpp"
#include "posterior/cloud.hpp"
#include "posterior/posterior.hpp"
#include "tools/logs/frame_forces.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

/// The controller's own info, alive as long as this is.
struct Info {
  nb::object owner;
  const Controller* controller;
  const tiller_info_t& get() const { return controller->get()->executive->info(); }
};

/// The controller's own particles.
struct Particles {
  nb::object owner;
  const Controller* controller;
  const tiller::Posterior& get() const { return controller->get()->executive->posterior(); }
  std::size_t params() const { return controller->config().param_count; }
};

nb::object filled(std::initializer_list<std::size_t> shape, double*& data) {
  std::size_t size = 1;
  for (const std::size_t n : shape) size *= n;
  data = new double[size > 0 ? size : 1]();
  const nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, double>(data, shape.size(), shape.begin(), owner));
}

nb::object copied_particles(const Particles& p, bool weights) {
  const tiller::Posterior& posterior = p.get();
  const std::size_t n = posterior.size(), np = p.params();
  double* data = nullptr;
  nb::object array = weights ? filled({n}, data) : filled({n, np}, data);
  for (std::uint32_t i = 0; i < n; ++i)
    posterior.particle(i, weights ? nullptr : data + i * np, nullptr, weights ? data + i : nullptr);
  return array;
}

nb::object particles(const Particles& p) {
  const tiller::Cloud* cloud = p.get().cloud();
  const std::size_t n = p.get().size();
  if (!cloud) return copied_particles(p, false);
  return view(p.owner, cloud->params, {n, p.params()}, {1, static_cast<std::int64_t>(n)});
}

nb::object weights(const Particles& p) {
  const tiller::Cloud* cloud = p.get().cloud();
  return cloud ? view(p.owner, cloud->weight, {p.get().size()}) : copied_particles(p, true);
}

nb::object quantiles(const Particles& p, const std::vector<double>& q) {
  double* data = nullptr;
  nb::object array = filled({q.size(), p.params()}, data);
  for (std::size_t k = 0; k < q.size(); ++k) {
    if (!(q[k] >= 0.0 && q[k] <= 1.0))
      raise_argument("Posterior.quantiles", "q", std::to_string(q[k]), "numbers from 0 to 1", "pass e.g. [0.05, 0.95]");
    for (std::uint32_t i = 0; i < p.params(); ++i) data[k * p.params() + i] = p.get().quantile(i, q[k]);
  }
  return array;
}

nb::object covariance(const Particles& p) {
  double* data = nullptr;
  nb::object array = filled({p.params(), p.params()}, data);
  p.get().covariance(data);
  return array;
}

/// What is left of the plan in force, first the step in force: (steps x nu).
nb::object plan(const nb::pointer_and_handle<Controller>& self) {
  const tiller::Executive& executive = *self.p->get()->executive;
  const tiller::PlanMemory& plan = executive.plan();
  const std::size_t nu = executive.config().model->input_count;
  const std::uint32_t first = plan.step_at(executive.last_now_us());
  return view(self.h, plan.step(first), {plan.horizon() - first, nu});
}

nb::object prediction(const Controller& c) {
  const std::size_t steps = c.config().planner.horizon + 1, nx = c.config().model->state_count;
  double *mean = nullptr, *sd = nullptr;
  const nb::object means = filled({steps, nx}, mean), sds = filled({steps, nx}, sd);
  for (std::uint32_t k = 0; k < steps; ++k)
    check_status(tiller_get_prediction(c.get(), k, mean + k * nx, sd + k * nx), "Controller.prediction");
  return nb::make_tuple(means, sds);
}

nb::object outputs(const Controller& c) {
  double* data = nullptr;
  const nb::object array = filled({c.robot()->names.outputs.size()}, data);
  check_status(tiller_get_outputs(c.get(), data), "Controller.outputs");
  return array;
}

nb::object frame_forces(const Controller& c) {
  const tools::FrameForces frames(c.config());
  double mean[TILLER_MAX_OUTPUTS], sd[TILLER_MAX_OUTPUTS];
  frames.compute(c.get()->executive->info(), mean, sd);
  nb::dict forces;
  for (std::size_t i = 0; i < frames.names().size(); ++i)
    forces[frames.names()[i].c_str()] = nb::make_tuple(mean[i], sd[i]);
  return forces;
}

template <class T, T tiller_info_t::*Field>
T scalar(const Info& info) {
  return info.get().*Field;
}

std::size_t state_count(const Controller& c) { return c.config().model->state_count; }
std::size_t param_count(const Controller& c) { return c.config().param_count; }
std::size_t delay_count(const Controller& c) { return c.config().posterior.delay_hypotheses; }
std::size_t force_count(const Controller& c) { return Posterior::force_joints(c.config()); }
std::size_t drift_count(const Controller& c) { return std::bitset<64>(c.config().posterior.drift).count(); }
std::size_t rate_count(const Controller& c) { return c.config().posterior.forgetting_count; }

template <auto Field, std::size_t (*Count)(const Controller&)>
nb::object field_view(const Info& info) {
  return view(info.owner, info.get().*Field, {Count(*info.controller)});
}

// clang-format off
#define TILLER_SCALAR(name, type, help) .def_prop_ro(#name, &scalar<type, &tiller_info_t::name>, help)

void bind_info(nb::module_& m) {
  nb::class_<Info>(m, "Info", "The controller after its last tick: views of its memory, which change with every tick.")
      .def("__init__", made_by<Info>("Info", "take Controller.info"))
      TILLER_SCALAR(ticks, std::uint64_t, "")
      TILLER_SCALAR(planner_iterations, std::uint32_t, "Completed in the last tick.")
      TILLER_SCALAR(plan_cost, double, "Of the chosen plan; inf: this tick made none.")
      TILLER_SCALAR(effective_samples, double, "Of the posterior, 1..N.")
      TILLER_SCALAR(likelihood_exponent, double, "1 once all data count in full.")
      TILLER_SCALAR(noise_scale, double, "Estimated over configured noise.")
      TILLER_SCALAR(acceptance, double, "Share of accepted moves.")
      TILLER_SCALAR(resamplings, std::uint64_t, "")
      TILLER_SCALAR(tick_ns, std::int64_t, "Of the last tick.")
      TILLER_SCALAR(posterior_ns, std::int64_t, "Of the last tick.")
      TILLER_SCALAR(plan_ns, std::int64_t, "Of the last tick.")
      TILLER_SCALAR(rejected_measurements, std::uint64_t, "Whole measurements that the guard refused.")
      TILLER_SCALAR(missing_values, std::uint64_t, "NaN in measurements that were taken in.")
      TILLER_SCALAR(late_plans, std::uint64_t, "Ticks whose deadline left no time for an iteration.")
      TILLER_SCALAR(gate_clipped, std::uint64_t, "Commands cut to a limit.")
      TILLER_SCALAR(gate_rejections, std::uint64_t, "Commands with NaN or infinity.")
      TILLER_SCALAR(plan_failures, std::uint64_t, "Ticks without a finite plan.")
      TILLER_SCALAR(posterior_failures, std::uint64_t, "Updates that no particle took in.")
      TILLER_SCALAR(inadequate_channel, std::uint32_t, "Index of the measurement that gave the alarm.")
      TILLER_SCALAR(adequacy_statistic, double, "Above 1 is an alarm.")
      TILLER_SCALAR(discrepancy_share, double, "Of the residuals' squares.")
      TILLER_SCALAR(plans, std::uint64_t, "Finite plans made.")
      TILLER_SCALAR(relearned, std::uint64_t, "")
      TILLER_SCALAR(probing, std::uint32_t, "0: the planner's own plan, 1: one that finds out, 2: a calibration.")
      TILLER_SCALAR(calibration_left, std::uint32_t, "Periods of a calibration that are still to come.")
      TILLER_SCALAR(probed_ticks, std::uint64_t, "Ticks whose command was of a probing plan.")
      TILLER_SCALAR(probe_value, double, "What the last probing plan is expected to save.")
      TILLER_SCALAR(probe_cost, double, "And to add to the cost.")
      TILLER_SCALAR(probe_spent, double, "Of all probing since motion began, as expected.")
      TILLER_SCALAR(probe_allowed, double, "What the budget has come to.")
      TILLER_SCALAR(probe_information, double, "Nats that the last probing plan is expected to tell.")
      TILLER_SCALAR(touched, std::uint32_t, "Bit j: the force at joint j is a contact.")
      .def_prop_ro("state", [](const Info& i) { return static_cast<tiller_state_t>(i.get().state); })
      .def_prop_ro("status", [](const Info& i) { return static_cast<tiller_status_t>(i.get().status); })
      .def_prop_ro("first_fault", [](const Info& i) { return static_cast<tiller_status_t>(i.get().first_fault); })
      .def_prop_ro("adequacy", [](const Info& i) { return static_cast<tiller_adequacy_t>(i.get().adequacy); })
      .def_prop_ro("inadequate_feature",
                   [](const Info& i) {
                     return std::string(tiller_feature_name(static_cast<tiller_feature_t>(i.get().inadequate_feature)));
                   })
      .def_prop_ro("state_mean", &field_view<&tiller_info_t::state_mean, state_count>, "(nx)")
      .def_prop_ro("state_sd", &field_view<&tiller_info_t::state_sd, state_count>, "(nx)")
      .def_prop_ro("param_mean", &field_view<&tiller_info_t::param_mean, param_count>, "(np)")
      .def_prop_ro("param_sd", &field_view<&tiller_info_t::param_sd, param_count>, "(np)")
      .def_prop_ro("force_mean", &field_view<&tiller_info_t::force_mean, force_count>, "(joints) N or N m.")
      .def_prop_ro("force_sd", &field_view<&tiller_info_t::force_sd, force_count>, "(joints)")
      TILLER_SCALAR(slip_states, std::uint64_t, "Bit i: a slip of state i is estimated.")
      .def_prop_ro("slip_mean", &field_view<&tiller_info_t::slip_mean, state_count>,
                   "(nx) a second: what changes each state beyond the model; 0 where none is estimated.")
      .def_prop_ro("slip_sd", &field_view<&tiller_info_t::slip_sd, state_count>, "(nx)")
      .def_prop_ro("viscous_mean", &field_view<&tiller_info_t::viscous_mean, force_count>,
                   "(joints) N s/m or N m s, beyond the model's; 0 where none is looked for.")
      .def_prop_ro("viscous_sd", &field_view<&tiller_info_t::viscous_sd, force_count>, "(joints)")
      .def_prop_ro("dry_mean", &field_view<&tiller_info_t::dry_mean, force_count>,
                   "(joints) N or N m, beyond the model's; 0 where none is looked for.")
      .def_prop_ro("dry_sd", &field_view<&tiller_info_t::dry_sd, force_count>, "(joints)")
      .def_prop_ro("noise_sd", &field_view<&tiller_info_t::noise_sd, state_count>, "(nx)")
      .def_prop_ro("delay_weight", &field_view<&tiller_info_t::delay_weight, delay_count>, "(delay hypotheses)")
      .def_prop_ro("drift_evidence", &field_view<&tiller_info_t::drift_evidence, drift_count>,
                   "(parameters of [posterior] drift) log odds of a walk over none, by the data.")
      .def_prop_ro("jump_evidence", &field_view<&tiller_info_t::jump_evidence, drift_count>,
                   "(parameters of [posterior] drift) log odds of a jump over none, by the data.")
      .def_prop_ro("jump_age_s", &field_view<&tiller_info_t::jump_age_s, drift_count>,
                   "(parameters of [posterior] drift) how long ago the likeliest jump was.")
      .def_prop_ro("jump_by", &field_view<&tiller_info_t::jump_by, drift_count>,
                   "(parameters of [posterior] drift) and how large, in the parameter's unit.")
      .def_prop_ro("forgetting_weight", &field_view<&tiller_info_t::forgetting_weight, rate_count>, "(rates)");
}
#undef TILLER_SCALAR
// clang-format on

template <auto Field>
nb::object param_view(const Particles& p) {
  return view(p.owner, p.controller->get()->executive->info().*Field, {p.params()});
}

}  // namespace

void bind_reads(nb::module_& m, nb::class_<Controller>& controller) {
  bind_info(m);
  nb::class_<Particles>(m, "Posterior", "What is known of the parameters: views that change with every tick.")
      .def("__init__", made_by<Particles>("Posterior", "take Controller.posterior"))
      .def_prop_ro("particles", &particles,
                   "(N, np) a view; a copy where several delays or rates of forgetting are weighed (shared: False).")
      .def_prop_ro("weights", &weights, "(N), sum one; as particles.")
      .def_prop_ro(
          "shared", [](const Particles& p) { return p.get().cloud() != nullptr; },
          "Whether particles and weights are views.")
      .def_prop_ro("mean", &param_view<&tiller_info_t::param_mean>, "(np) as of the last tick.")
      .def_prop_ro("sd", &param_view<&tiller_info_t::param_sd>, "(np) as of the last tick.")
      .def_prop_ro(
          "size", [](const Particles& p) { return p.get().size(); }, "N")
      .def_prop_ro("names", [](const Particles& p) { return p.controller->robot()->names.params; })
      .def("quantiles", &quantiles, "q"_a, "(len(q), np) weighted quantiles.")
      .def("covariance", &covariance, "(np, np), zero rows for fixed parameters.");
  controller.def_prop_ro("info",
                         [](const nb::pointer_and_handle<Controller>& s) {
                           return Info{nb::borrow(s.h), s.p};
                         })
      .def_prop_ro("posterior",
                   [](const nb::pointer_and_handle<Controller>& s) {
                     return Particles{nb::borrow(s.h), s.p};
                   })
      .def_prop_ro("plan", &plan, "(steps, nu) a view of what is left of the plan in force; (0, nu): none.")
      .def_prop_ro("robot", [](const Controller& c) { return c.robot(); })
      .def_prop_ro("block_bytes", &Controller::block_bytes, "Of the one block of memory.")
      .def("prediction", &prediction,
           "(means, deviations) (horizon + 1, nx) of the states ahead; needs predict_spread.")
      .def("outputs", &outputs, "The model's outputs at the present estimate.")
      .def(
          "frame_forces", &frame_forces,
          "Forces beyond the model as forces at frames, {\"tip_x_N\": (mean, deviation)}; NaN: joints do not tell it.");
}

}  // namespace tiller::python
