// What ./dev bench roofline measures of one instruction set, that of TILLER_ISA: lines of JSON for drivers/roofline.py.
// --sets prints those that are built and that the processor has.
//
// Time is the least of many calls. Work is counted, not reckoned: the same call runs once more in single steps, and how
// often each instruction of the program was executed goes into the line; the driver weighs them by their text. On
// x86-64 Linux alone.

#include <cstdio>

#if defined(__x86_64__) && defined(__linux__)

#include <immintrin.h>
#include <signal.h>
#include <sys/mman.h>
#include <ucontext.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/planning/hover_programs.hpp"
#include "bench/problems/planning_problem.hpp"
#include "bench/problems/posterior_problem.hpp"
#include "planners/qp/riccati_qp.hpp"

extern char __executable_start, etext;

namespace {

using namespace tiller;
using Clock = std::chrono::steady_clock;

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// CPU time, in which other programs have no part, or the wall's for calls so short that reading it counts.
double seconds(const std::function<void()>& call) {
  const double cpu = cpu_seconds();
  const auto begin = Clock::now();
  call();
  const double wall = std::chrono::duration<double>(Clock::now() - begin).count();
  return std::min(wall, cpu_seconds() - cpu);
}

/// The least time of a call, within half a second.
double least_seconds(const std::function<void()>& call) {
  double least = seconds(call);
  const auto begin = Clock::now();
  for (int i = 0; i < 5000 && Clock::now() - begin < std::chrono::milliseconds(500); ++i)
    least = std::min(least, seconds(call));
  return least;
}

// ---- what the machine can -------------------------------------------------------------------------

constexpr int kChains = 12;  // fused multiply-adds that wait for nobody: latency of four, two a cycle, and some
constexpr long kRounds = 200000;
constexpr std::size_t kNear = 16 * 1024, kFar = 64u << 20;  // bytes: half of a first-level cache; beyond the last one

/// Operations in flight, and copies near by, in the registers of one instruction set.
#define TILLER_PEAKS(isa, flags, Register, set, fused, load, store)                        \
  __attribute__((target(flags), noinline)) float fuse_##isa() {                            \
    Register x[kChains];                                                                   \
    const Register m = set(0.999f), a = set(0.001f);                                       \
    for (int c = 0; c < kChains; ++c) x[c] = set(static_cast<float>(c));                   \
    for (long i = 0; i < kRounds; ++i)                                                     \
      for (int c = 0; c < kChains; ++c) x[c] = fused;                                      \
    float sum = 0.0f, lanes[sizeof(Register) / sizeof(float)];                             \
    for (int c = 0; c < kChains; ++c) store(lanes, x[c]), sum += lanes[0];                 \
    return sum;                                                                            \
  }                                                                                        \
  __attribute__((target(flags), noinline)) void copy_##isa(const float* from, float* to) { \
    constexpr std::size_t kStep = sizeof(Register) / sizeof(float);                        \
    for (std::size_t i = 0; i < kNear / sizeof(float); i += 4 * kStep) {                   \
      const Register p = load(from + i), q = load(from + i + kStep);                       \
      const Register r = load(from + i + 2 * kStep), s = load(from + i + 3 * kStep);       \
      store(to + i, p), store(to + i + kStep, q);                                          \
      store(to + i + 2 * kStep, r), store(to + i + 3 * kStep, s);                          \
    }                                                                                      \
  }
TILLER_PEAKS(sse2, "sse2", __m128, _mm_set1_ps, _mm_add_ps(_mm_mul_ps(x[c], m), a), _mm_loadu_ps, _mm_storeu_ps)
TILLER_PEAKS(avx2, "avx2,fma", __m256, _mm256_set1_ps, _mm256_fmadd_ps(x[c], m, a), _mm256_loadu_ps, _mm256_storeu_ps)
TILLER_PEAKS(avx512, "avx512f", __m512, _mm512_set1_ps, _mm512_fmadd_ps(x[c], m, a), _mm512_loadu_ps, _mm512_storeu_ps)
#undef TILLER_PEAKS

struct Peaks {
  float (*fuse)();
  void (*copy)(const float*, float*);
  double lanes;
};
Peaks peaks_of(Isa isa) {
  if (isa == Isa::avx512) return {fuse_avx512, copy_avx512, 16};
  if (isa == Isa::avx2) return {fuse_avx2, copy_avx2, 8};
  return {fuse_sse2, copy_sse2, 4};
}

void print_peaks() {
  const Peaks peaks = peaks_of(best_isa());
  volatile float keep = 0.0f;
  const double fused = 2.0 * peaks.lanes * kChains * kRounds / least_seconds([&] { keep = peaks.fuse(); });
  alignas(64) static float near_from[kNear / sizeof(float)], near_to[kNear / sizeof(float)];
  constexpr int kCopies = 1000;
  const double near = 2.0 * kNear * kCopies / least_seconds([&] {
                        for (int i = 0; i < kCopies; ++i) {
                          peaks.copy(near_from, near_to);
                          keep = near_to[i];
                        }
                      });
  std::vector<char> from(kFar, 1), to(kFar, 2);
  const double far = 2.0 * kFar / least_seconds([&] { std::memcpy(to.data(), from.data(), kFar); });
  std::printf(
      "{\"isa\": \"%s\", \"f32_flops\": %.4g, \"f64_flops\": %.4g, \"near_bytes\": %.4g, \"far_bytes\": %.4g}\n",
      isa_name(best_isa()), fused, 0.5 * fused, near, far);
}

// ---- counting -------------------------------------------------------------------------------------

std::uint32_t* executed = nullptr;  // by place in the program
std::uint32_t elsewhere = 0;        // in other objects
std::size_t text_size() { return static_cast<std::size_t>(&etext - &__executable_start); }

void note_step(int, siginfo_t*, void* context) {
  const auto at = static_cast<std::size_t>(static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_RIP]) -
                  reinterpret_cast<std::size_t>(&__executable_start);
  if (at < text_size())
    ++executed[at];
  else
    ++elsewhere;
}

__attribute__((noinline)) void run_in_single_steps(const std::function<void()>& call) {
  constexpr unsigned long long kTrapFlag = 0x100;
  __writeeflags(__readeflags() | kTrapFlag);
  call();
  __writeeflags(__readeflags() & ~kTrapFlag);
}

struct Kernel {
  std::string name, unit;
  double units;      // a call
  bool doubles;      // its numbers
  double far_bytes;  // a call moves to and from memory; 0: everything stays in the caches
  std::function<void()> call;
  std::function<void()> counted;  // stands for it in single steps; its units
  double counted_units;
};

void print_kernel(const Kernel& kernel) {
  const double s = least_seconds(kernel.call);
  std::memset(executed, 0, text_size() * sizeof *executed);
  elsewhere = 0;
  run_in_single_steps(kernel.counted ? kernel.counted : kernel.call);
  std::printf(
      "{\"kernel\": \"%s\", \"unit\": \"%s\", \"seconds\": %.6g, \"doubles\": %s, \"far_bytes\": %.6g, "
      "\"counted\": %.6g, \"elsewhere\": %u, \"executed\": {",
      kernel.name.c_str(), kernel.unit.c_str(), s / kernel.units, kernel.doubles ? "true" : "false",
      kernel.far_bytes / kernel.units, kernel.counted ? kernel.counted_units : kernel.units, elsewhere);
  const char* comma = "";
  for (std::size_t i = 0; i < text_size(); ++i)
    if (executed[i] > 0) {
      std::printf("%s\"%zx\": %u", comma, i, executed[i]);
      comma = ", ";
    }
  std::printf("}}\n");
  std::fflush(stdout);
}

// ---- kernels --------------------------------------------------------------------------------------

/// Lanes of a cart-pole as planners have them: one start, one set of parameters, an input sequence a lane. With
/// `states` a start for each lane and the last state of each, of one step: a batch as learners have it.
struct Lanes32 {
  tiller::Config config;
  StepSetup setup;
  std::vector<float> state, params, effect_state, controls, history, cost, last;
  CostTerms<float> terms;
  RolloutJob<float> job;

  Lanes32(std::uint32_t lanes, std::uint32_t horizon, std::uint32_t integrator, bool friction, bool states)
      : config(bench::cart_pole_config(tiller_planner_mppi, horizon)),
        state(4 * (states ? lanes : 1), 0.1f),
        params{1.0f, 0.1f, 0.5f, 0.2f, 0.5f},
        effect_state(TILLER_MAX_EFFECT_STATES),
        controls(std::size_t{horizon} * lanes),
        history(TILLER_MAX_DELAY_STEPS),
        cost(lanes),
        last(states ? 4 * lanes : 0) {
    config.integrator = static_cast<tiller_integrator_t>(integrator);
    if (friction) {
      config.effect_count = 2;
      config.effects[0] = {tiller_effect_viscous_friction, 0};
      config.effects[1] = {tiller_effect_coulomb_friction, 0};
      config.param_count = 5;
    }
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    terms = make_cost_terms<float>(config.cost, config.model->state_count);
    for (std::size_t i = 0; i < controls.size(); ++i)
      controls[i] = 10.0f * std::sin(0.37f * static_cast<float>(i % 7919));
    job.setup = &setup;
    job.lanes = lanes;
    job.horizon = horizon;
    job.state = {state.data(), states ? lanes : 0};
    job.params = {params.data(), 0};
    job.effect_state = {effect_state.data(), 0};
    job.controls = {controls.data(), lanes};
    job.history = history.data();
    if (states)
      job.final_state = last.data();
    else
      job.cost = &terms, job.cost_out = cost.data();
  }
  void roll() { select_rollout(*config.model).rollout_f32(*config.model, job); }
};

Kernel rollout_kernel(const char* name, std::uint32_t integrator, bool friction) {
  auto lanes = std::make_shared<Lanes32>(128, 50, integrator, friction, false);
  return {name, "step", 128.0 * 50.0, false, 0.0, [lanes] { lanes->roll(); }, {}, 0.0};
}

Kernel batch_kernel() {
  constexpr std::uint32_t kStates = 1u << 20, kFew = 1024;
  auto many = std::make_shared<Lanes32>(kStates, 1, tiller_integrator_semi_implicit_euler, false, true);
  auto few = std::make_shared<Lanes32>(kFew, 1, tiller_integrator_semi_implicit_euler, false, true);
  return {"batched step, a million states",
          "step",
          double(kStates),
          false,
          9.0 * sizeof(float) * kStates,
          [many] { many->roll(); },
          [few] { few->roll(); },
          double(kFew)};
}

/// All filters of the particles by one transition, without moves.
Kernel filter_kernel() {
  auto subject = std::make_shared<bench::PosteriorSubject>(256, 64, 0);
  subject->warm_up();
  return {"filters' update, 4 states",
          "filter",
          256.0,
          true,
          0.0,
          [subject] {
            if (subject->at_end()) subject->warm_up();
            subject->update();
          },
          {},
          0.0};
}

Kernel ilqr_kernel() {
  auto planning = std::make_shared<bench::Planning>(bench::cart_pole_config(tiller_planner_ilqr, 50, false));
  return {"iLQR, one iteration", "stage", 50.0, true, 0.0, [planning] { planning->plan_cold(); }, {}, 0.0};
}

struct HoverSolver {
  bench::Hover hover;
  bench::Block solution_block, riccati_block, factor_block;
  const LqKernel& kernel = select_lq(best_isa(), bench::Hover::kStates, bench::Hover::kInputs);
  QpSolution solution = solution_block.make([&](Arena& a) { return lay_out_qp_solution(a, hover.qp.lq); });
  RiccatiQp riccati = riccati_block.make([&](Arena& a) { return lay_out_riccati_qp(a, hover.qp.lq, kernel); });
  LqFactor factor = factor_block.make([&](Arena& a) { return lay_out_lq_factor(a, hover.qp.lq, false); });

  void factorise() {
    if (!kernel.factorise(hover.qp.lq, factor)) std::abort();
  }
  void solve() {
    hover.qp.repeats = false;
    forget_active_set(riccati.dual);
    std::fill_n(solution.u, bench::Hover::kHorizon * bench::Hover::kInputs, 0.0);
    if (solve_riccati_qp(riccati, hover.qp, QpLimits{}, solution).status != QpStatus::solved) std::abort();
  }
};

std::vector<Kernel> kernels() {
  auto hover = std::make_shared<HoverSolver>();
  hover->hover.set_start(0);
  std::vector<Kernel> all;
  all.push_back(rollout_kernel("rollout step, semi-implicit", tiller_integrator_semi_implicit_euler, false));
  all.push_back(rollout_kernel("rollout step, RK4", tiller_integrator_rk4, false));
  all.push_back(
      rollout_kernel("rollout step, semi-implicit, two frictions", tiller_integrator_semi_implicit_euler, true));
  all.push_back(batch_kernel());
  all.push_back(filter_kernel());
  all.push_back(ilqr_kernel());
  all.push_back(
      {"Riccati sweep, 12 states, 4 inputs", "stage", 10.0, true, 0.0, [hover] { hover->factorise(); }, {}, 0.0});
  all.push_back({"hover QP from cold, N = 10", "program", 1.0, true, 0.0, [hover] { hover->solve(); }, {}, 0.0});
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "--sets") == 0) {
    for (int i = 1; i < kIsaCount; ++i)
      if (has_isa(static_cast<Isa>(i))) std::printf("%s ", isa_name(static_cast<Isa>(i)));
    return 0;
  }
  executed = static_cast<std::uint32_t*>(
      mmap(nullptr, text_size() * sizeof *executed, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  struct sigaction action = {};
  action.sa_sigaction = note_step;
  action.sa_flags = SA_SIGINFO;
  if (executed == MAP_FAILED || sigaction(SIGTRAP, &action, nullptr) != 0) return 1;
  print_peaks();
  for (const Kernel& kernel : kernels()) print_kernel(kernel);
  return 0;
}

#else
int main() {
  std::puts("./dev bench roofline counts on x86-64 Linux alone");
  return 1;
}
#endif
