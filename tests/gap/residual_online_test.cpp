// The unnamed effect in the online posterior: exact in the engine in closed form, learnt by particles in the others,
// in fixed memory, and as wide as its prior where the robot has not been.

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "core/rng.hpp"
#include "effects/catalogue.hpp"
#include "hidden_pendulum.hpp"
#include "posterior/posterior.hpp"
#include "tiller/config.hpp"
#include "tools/gap/residual/fallback.hpp"

// The linker sends every call of these to us (see CMakeLists.txt), from whichever library it comes.
extern "C" {
void* __real_malloc(std::size_t);
}
namespace {
std::atomic<long> heap_calls{0};
}
extern "C" {
void* __wrap_malloc(std::size_t n) {
  ++heap_calls;
  return __real_malloc(n);
}
}
// operator new stands in the C++ library, which was linked without us: it gets a body that is seen.
void* operator new(std::size_t n) {
  void* p = std::malloc(n ? n : 1);
  if (!p) std::abort();
  return p;
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace tiller::tools::gap {
namespace {

constexpr double kPriorSd = 0.5;
const ResidualScales kScales{0.0, 0.8, 6.283185307179586, 0.5, 12.0};

/// A pendulum known but for the residual; both states measured unless `encoder`.
tiller::Config config(bool encoder) {
  hidden::Setup s;
  s.period_s = 0.02;
  tiller::Config c = hidden::nominal(s);
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.priors[0] = {tiller_prior_fixed, 0, s.mass_kg, 0.0, 0.0, 0.0};
  c.measurement_count = encoder ? 1 : 2;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = encoder ? 1e-3 : 1e-6;
  c.measurement_sd[1] = 1e-6;
  c.process_sd[0] = 0.001;
  c.process_sd[1] = 0.05;
  c.posterior.delay_hypotheses = c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 1.0;
  c.posterior.noise_scale_shape = 2.0;
  c.posterior.adequacy = 0;
  c.posterior.window = 64;
  tiller::Config with;
  std::string error;
  if (!with_residual(c, 0, kScales, kPriorSd, with, error)) std::abort();
  return with;
}

/// At the present signature of the effect's hook.
double residual_force(double angle, double rate, const double* p) {
  return Residual<double>::force({angle, rate, angle, rate, 0.0, 0.0, 0.01}, p);
}

class Engine {
 public:
  explicit Engine(const tiller_config_t& given) : config_(given) {
    if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
    const RolloutTable& table = select_rollout(*config_.model);
    const char* field = nullptr;
    status_ = Posterior::check(config_, setup_, table, &field);
    Arena measure;
    Posterior::lay_out(measure, config_, setup_, table, nullptr);
    size_ = measure.used();
    memory_ = std::aligned_alloc(64, size_);
    Arena arena(memory_, size_);
    posterior_ = Posterior::lay_out(arena, config_, setup_, table, nullptr);
    fits_ = arena.fits() && arena.used() == size_;
    posterior_->reset();
  }
  ~Engine() { std::free(memory_); }
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;
  Posterior* operator->() { return posterior_; }
  Posterior& get() { return *posterior_; }
  bool good() const { return fits_ && status_ == tiller_status_ok; }

 private:
  tiller::Config config_;
  StepSetup setup_;
  tiller_status_t status_ = tiller_status_ok;
  std::size_t size_ = 0;
  void* memory_ = nullptr;
  Posterior* posterior_ = nullptr;
  bool fits_ = false;
};

/// The model's own step with the forces `w`, process noise of the configured size and a torque that changes every
/// tenth of a second.
std::vector<Transition> simulate(const tiller_config_t& c, const std::vector<double>& params, int steps,
                                 std::uint64_t seed) {
  StepSetup setup;
  if (make_step_setup(c, setup) != tiller_status_ok) std::abort();
  Rng rng(seed, 3, 1);
  std::vector<Transition> all;
  std::vector<double> x(2 * kLanePadding, 0.0), next(2 * kLanePadding);
  double u = 0.0;
  for (int k = 0; k < steps; ++k) {
    if (k % 5 == 0) u = 0.4 * rng.normal();
    RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kLanePadding;
    job.horizon = 1;
    job.period_s = c.period_s;
    job.state = {x.data(), kLanePadding};
    job.params = {params.data(), 0};
    job.controls = {&u, 0};
    job.final_state = next.data();
    select_rollout(*c.model).rollout_f64(*c.model, job);
    for (std::uint32_t i = 0; i < 2; ++i) {
      const double kick = c.process_sd[i] * std::sqrt(c.period_s) * rng.normal();
      for (std::uint32_t l = 0; l < kLanePadding; ++l) x[i * kLanePadding + l] = next[i * kLanePadding + l] + kick;
    }
    Transition t;
    t.period_s = c.period_s;
    t.input[0] = u;
    t.measured[0] = x[0] + (c.measurement_count == 1 ? c.measurement_sd[0] * rng.normal() : 0.0);
    t.measured[1] = x[kLanePadding];
    all.push_back(t);
  }
  return all;
}

std::vector<double> truth(const tiller_config_t& c, std::uint64_t seed) {
  std::vector<double> p;
  Rng rng(seed, 4, 1);
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    p.push_back(c.priors[i].kind == tiller_prior_fixed ? c.priors[i].a : c.priors[i].a + c.priors[i].b * rng.normal());
  return p;
}

void feed(Posterior& p, const std::vector<Transition>& data) {
  const double start[] = {0.0, 0.0};
  ASSERT_EQ(p.start(start), tiller_status_ok);
  for (const Transition& t : data) {
    const tiller_status_t status = p.update(t);
    ASSERT_TRUE(status == tiller_status_ok || status == tiller_status_tempered);
  }
}

/// Mean and deviation over the particles of the residual force at a state.
void force_at(Posterior& p, std::uint32_t first, double angle, double rate, double* mean, double* sd) {
  double sum = 0.0, squares = 0.0, total = 0.0;
  for (std::uint32_t k = 0; k < p.size(); ++k) {
    double params[TILLER_MAX_PARAMS], state[TILLER_MAX_STATES], weight;
    p.particle(k, params, state, &weight);
    const double f = residual_force(angle, rate, params + first);
    sum += weight * f;
    squares += weight * f * f;
    total += weight;
  }
  *mean = sum / total;
  *sd = std::sqrt(std::max(0.0, squares / total - *mean * *mean));
}

// Forces drawn from their prior, 40 runs of 5 s: central 90 % intervals of the force at states that were visited, and
// at one that never is. 40 draws of 90 %: 31 to 40 in all but 1 of 200.
TEST(ResidualOnline, ClosedFormIsCalibrated) {
  tiller::Config c = config(false);
  c.posterior.kind = tiller_posterior_conjugate;
  c.posterior.particles = 256;
  Engine p(c);
  ASSERT_TRUE(p.good());
  int near = 0, far = 0;
  double narrow = 0.0, wide = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const std::vector<double> true_params = truth(c, seed);
    p->reset();
    feed(p.get(), simulate(c, true_params, 250, seed));
    double mean, sd;
    force_at(p.get(), 3, 0.0, 1.0, &mean, &sd);
    near += std::fabs(residual_force(0.0, 1.0, &true_params[3]) - mean) < 1.645 * sd;
    narrow += sd / 40;
    force_at(p.get(), 3, 3.1, 0.0, &mean, &sd);
    far += std::fabs(residual_force(3.1, 0.0, &true_params[3]) - mean) < 1.645 * sd;
    wide += sd / 40;
  }
  EXPECT_GE(near, 31);
  EXPECT_GE(far, 31);
  EXPECT_LT(narrow, 0.25 * kPriorSd);
  EXPECT_GT(wide, 0.9 * kPriorSd);
}

TEST(ResidualOnline, NoEngineAllocates) {
  for (const tiller_posterior_kind_t kind :
       {tiller_posterior_conjugate, tiller_posterior_transition, tiller_posterior_filter}) {
    tiller::Config c = config(kind == tiller_posterior_filter);
    c.posterior.kind = kind;
    c.posterior.particles = 256;
    c.posterior.moves_per_tick = 32;
    const std::vector<Transition> data = simulate(c, truth(c, 5), 100, 5);
    Engine p(c);
    ASSERT_TRUE(p.good());
    const long before = heap_calls;
    feed(p.get(), data);
    double mean, sd;
    force_at(p.get(), 3, 0.0, 1.0, &mean, &sd);
    EXPECT_EQ(heap_calls, before) << kind;
  }
}

// Ten unknowns by particles: means at a visited state within three deviations of the closed form's and of the truth,
// the state that is never visited still at the prior's width (to a quarter: particles that were resampled often).
TEST(ResidualOnline, ParticlesLearnItToo) {
  tiller::Config c = config(false);
  const std::vector<double> true_params = truth(c, 21);
  const std::vector<Transition> data = simulate(c, true_params, 500, 21);
  for (const tiller_posterior_kind_t kind : {tiller_posterior_conjugate, tiller_posterior_transition}) {
    c.posterior.kind = kind;
    c.posterior.particles = 1024;
    c.posterior.moves_per_tick = 512;
    Engine p(c);
    ASSERT_TRUE(p.good());
    feed(p.get(), data);
    for (const double rate : {-1.0, 1.0}) {
      double mean, sd;
      force_at(p.get(), 3, 0.0, rate, &mean, &sd);
      EXPECT_NEAR(mean, residual_force(0.0, rate, &true_params[3]), 4.0 * sd) << kind;
      EXPECT_LT(sd, 0.25 * kPriorSd) << kind;
      force_at(p.get(), 3, 3.1, 0.0, &mean, &sd);
      EXPECT_GT(sd, 0.75 * kPriorSd) << kind;
    }
  }
}

// The same from an encoder alone.
TEST(ResidualOnline, FilterLearnsItFromAnEncoder) {
  tiller::Config c = config(true);
  const std::vector<double> true_params = truth(c, 22);
  c.posterior.kind = tiller_posterior_filter;
  c.posterior.particles = 1024;
  c.posterior.moves_per_tick = 128;
  Engine p(c);
  ASSERT_TRUE(p.good());
  feed(p.get(), simulate(c, true_params, 500, 22));
  for (const double rate : {-1.0, 1.0}) {
    double mean, sd;
    force_at(p.get(), 3, 0.0, rate, &mean, &sd);
    EXPECT_NEAR(mean, residual_force(0.0, rate, &true_params[3]), 4.0 * sd);
    EXPECT_LT(sd, 0.5 * kPriorSd);
  }
}

}  // namespace
}  // namespace tiller::tools::gap
