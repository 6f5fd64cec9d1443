#include "rollout/lq.hpp"

#include "rollout/lq_held.hpp"
#include "rollout/rollout.hpp"
#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(LqKernel, kLqGeneral)
TILLER_DECLARE_COPIES(LqKernel, kLqTwelveFour)

std::uint32_t update_lq_held(const LqProblem& p, const LqFactor& f, const double* x, const double* u) {
  const std::size_t m = p.inputs, s = std::size_t{p.states} * p.scenarios;
  std::uint32_t changes = 0;
  for (std::size_t k = 0; k < p.horizon; ++k)
    for (std::size_t i = 0; i < m; ++i) {
      const std::size_t at = k * m + i;
      std::int8_t& held = f.held[at];
      std::int8_t next = 0;
      if (held == 0) {
        next = static_cast<std::int8_t>(u[at] > p.high[at] ? 1 : u[at] < p.low[at] ? -1 : 0);
      } else {
        double pull = f.force[at];
        for (std::size_t j = 0; j < s; ++j) pull += f.carry[at * s + j] * x[k * s + j];
        for (std::size_t j = 0; j < m; ++j) pull += f.curvature[at * m + j] * u[k * m + j];
        next = pull * held > 0.0 ? std::int8_t{0} : held;
      }
      changes += next != held;
      held = next;
    }
  return changes;
}

std::size_t lq_scratch_size(std::uint32_t states, std::uint32_t inputs, std::uint32_t scenarios) {
  const std::size_t s = std::size_t{states} * scenarios;
  return s * s + s * inputs + s;
}

LqFactor lay_out_lq_factor(Arena& arena, const LqProblem& sizes, bool box) {
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, m = sizes.inputs, n = sizes.horizon;
  LqFactor f;
  f.gain = arena.take<double>(n * m * s);
  f.step = arena.take<double>(n * m);
  f.cholesky = arena.take<double>(n * m * m);
  f.carry = arena.take<double>(n * m * s);
  f.value = arena.take<double>((n + 1) * s * s);
  f.slope = arena.take<double>((n + 1) * s);
  f.curvature = arena.take<double>(n * m * m);
  f.force = arena.take<double>(n * m);
  f.scratch = arena.take<double>(lq_scratch_size(sizes.states, sizes.inputs, sizes.scenarios));
  if (box) f.held = arena.take<std::int8_t>(n * m);
  return f;
}

const LqKernel& select_lq(Isa isa, std::uint32_t states, std::uint32_t inputs) {
  static constexpr IsaCopy<LqKernel> kGeneral[] = {TILLER_COPIES(kLqGeneral)};
  static constexpr IsaCopy<LqKernel> kTwelveFour[] = {TILLER_COPIES(kLqTwelveFour)};
  return states == 12 && inputs == 4 ? select_copy(kTwelveFour, isa) : select_copy(kGeneral, isa);
}

const LqKernel& select_lq(const RolloutTable& table, std::uint32_t states, std::uint32_t inputs,
                          std::uint32_t scenarios) {
  const LqKernel* const fixed[] = {table.lq, table.lq_rate};
  const LqKernel* const shared[] = {table.lq_scenarios};
  if (scenarios == 1) {
    for (const LqKernel* kernel : fixed)
      if (kernel && kernel->states == states && kernel->inputs == inputs) return *kernel;
    // a model in C has no instruction set of its own
    return select_lq(best_isa(), states, inputs);
  }
  for (const LqKernel* kernel : shared)
    if (kernel && kernel->states == states && kernel->inputs == inputs) return *kernel;
  return select_lq(best_isa(), 0, 0);
}

std::uint32_t solve_lq_box(const LqKernel& kernel, const LqProblem& problem, const LqFactor& factor, double* x,
                           double* u, std::uint32_t most_sweeps, bool* exact, bool factorised) {
  *exact = false;
  for (std::uint32_t sweep = 1; sweep <= most_sweeps; ++sweep) {
    if (!(factorised && sweep == 1) && !kernel.factorise(problem, factor)) return 0;
    kernel.roll(problem, factor, x, u);
    *exact = !factor.held || !problem.low || update_lq_held(problem, factor, x, u) == 0;
    if (*exact || sweep == most_sweeps) return sweep;
  }
  return most_sweeps;
}

}  // namespace tiller
