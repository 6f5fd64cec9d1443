// ./dev bench residual: one-step residuals of many particles at recorded transitions, single precision, one core.
//
// Goal: 2,000 M particle-transitions/s for the cart-pole by semi-implicit Euler with AVX-512, in both shapes that a
// posterior asks for: every particle at the newest transition, and a few proposals at the whole ring.

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "bench/table/bench_table.hpp"
#include "core/rng.hpp"
#include "effects/effect_info.hpp"
#include "rollout/residual.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;

struct Shape {
  const char* name;
  std::uint32_t lanes, count;
};
const Shape kShapes[] = {{"1024 particles x 1 transition", 1024, 1}, {"128 proposals x 64 transitions", 128, 64}};

struct Integration {
  const char* name;
  tiller_integrator_t integrator;
};
const Integration kIntegrations[] = {{"semi-implicit Euler", tiller_integrator_semi_implicit_euler},
                                     {"RK4", tiller_integrator_rk4}};
/// Of the shipped ones those that this build has.
std::vector<const char*> models() {
  std::vector<const char*> built;
  for (const char* name : {"cart_pole", "pendulum", "acrobot"})
    if (tiller_find_model(name)) built.push_back(name);
  return built;
}

struct Variant {
  const char* name;
  std::vector<tiller_effect_t> effects;
  std::uint32_t basis_count;
};
const Variant kVariants[] = {
    {"discrepancy basis of 3 on two rows", {}, 3},
    {"input delay", {{tiller_effect_input_delay, 0}}, 0},
    {"viscous friction (cart)", {{tiller_effect_viscous_friction, 0}}, 0},
    {"viscous + Coulomb (cart), delay, basis",
     {{tiller_effect_viscous_friction, 0}, {tiller_effect_coulomb_friction, 0}, {tiller_effect_input_delay, 0}},
     3},
};

constexpr std::size_t kLine = 64 / sizeof(float);

/// A job and what it points to; lanes begin on a cache line, as they do in a controller's block.
struct Batch {
  const tiller_model_t* model;
  StepSetup setup;
  std::vector<MeasuredStep> steps;
  std::vector<float> params;
  std::vector<double> history, squared, projected;
  ResidualJob job;

  Batch(const char* name, const Shape& shape, tiller_integrator_t integrator, const Variant& variant)
      : model(tiller_find_model(name)), steps(shape.count) {
    tiller::Config config{};
    config.model = model;
    config.period_s = 0.02;
    config.substeps = 1;
    config.integrator = integrator;
    config.body = {0.0, -9.81, 0.0, 0.0};
    config.param_count = model->param_count;
    for (tiller_prior_t& p : config.priors) p = {tiller_prior_uniform, 0, 0, 0, 0, 0.05};
    for (const tiller_effect_t& e : variant.effects) {
      config.effects[config.effect_count++] = e;
      config.param_count += static_cast<std::uint32_t>(effect_info(e.kind).param_count);
    }
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    Rng rng(100001, 1, 0);
    const auto draw = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
    history.resize(TILLER_MAX_DELAY_STEPS + 2, 1.0);
    for (MeasuredStep& s : steps) {
      for (std::uint32_t i = 0; i < model->state_count; ++i) {
        s.state[i] = draw(-1.5, 1.5);
        s.change[i] = draw(-0.1, 0.1);
      }
      s.input[0] = draw(-3, 3);
      s.period_s = 0.02;
      for (std::uint32_t j = 0; j < variant.basis_count; ++j) s.basis[j] = draw(-1, 1);
      s.history = history.data();
    }
    params.resize(TILLER_MAX_PARAMS * shape.lanes + kLine);
    for (std::size_t i = 0; i < params.size(); ++i)
      params[i] = static_cast<float>(i < model->param_count * shape.lanes ? draw(0.4, 1.2) : draw(0.0, 0.05));
    squared.resize(TILLER_MAX_STATES * shape.lanes + kLine);
    projected.resize(TILLER_MAX_STATES * kMaxBasis * shape.lanes + kLine);
    job.setup = &setup;
    job.lanes = shape.lanes;
    job.count = shape.count;
    job.steps = steps.data();
    job.basis_count = variant.basis_count;
    job.basis_rows = variant.basis_count ? 3u << (model->state_count / 2) : 0u;
    job.params = {on_a_line(params.data()), shape.lanes};
    job.squared = on_a_line(squared.data());
    job.projected = variant.basis_count ? on_a_line(projected.data()) : nullptr;
  }
  template <class T>
  static T* on_a_line(T* p) {
    return reinterpret_cast<T*>((reinterpret_cast<std::uintptr_t>(p) + 63) / 64 * 64);
  }
};

void add(bench::Table& table, const std::string& name, const std::shared_ptr<Batch>& batch) {
  table.add(name, [batch](benchmark::State& state) {
    const RolloutTable& kernel = select_rollout(*batch->model);
    for (auto _ : state) kernel.residual(*batch->model, batch->job);
    benchmark::DoNotOptimize(batch->squared[0]);
  });
}

}  // namespace

int main(int argc, char** argv) {
  bench::Table table;
  const Variant none = {"none", {}, 0};
  for (const char* model : models())
    for (const Integration& way : kIntegrations)
      for (const Shape& shape : kShapes)
        add(table, std::string(model) + "/" + way.name + "/" + shape.name,
            std::make_shared<Batch>(model, shape, way.integrator, none));
  for (const Variant& v : kVariants)
    for (const Shape& shape : kShapes)
      add(table, std::string(v.name) + "/" + shape.name,
          std::make_shared<Batch>("cart_pole", shape, tiller_integrator_semi_implicit_euler, v));
  table.run(argc, argv);

  std::printf("instruction set in use: %s; millions of particle-transitions per second, one core\n",
              isa_name(best_isa()));
  for (const char* model : models())
    for (const Integration& way : kIntegrations) {
      table.heading(std::string(model) + ", " + way.name);
      for (const Shape& shape : kShapes) {
        const bool asked = model == std::string("cart_pole") &&
                           way.integrator == tiller_integrator_semi_implicit_euler && best_isa() == Isa::avx512;
        const double t = table.seconds(std::string(model) + "/" + way.name + "/" + shape.name);
        table.row(shape.name, shape.lanes * shape.count / t * 1e-6, "M/s",
                  asked ? bench::at_least(2000) : bench::Goal{});
      }
    }
  for (const Variant& v : kVariants) {
    table.heading(std::string("cart_pole, semi-implicit Euler, ") + v.name);
    for (const Shape& shape : kShapes)
      table.row(shape.name, shape.lanes * shape.count / table.seconds(std::string(v.name) + "/" + shape.name) * 1e-6,
                "M/s");
  }
  return table.finish();
}
