// No heap after layout: every way to it is counted, and a thousand plans of every planner must not move the count.
// operator new is replaced for the whole program; malloc, calloc, realloc and free are wrapped by the linker (--wrap)
// in everything that is linked statically, which is all of the library.

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "planner_matrix.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "tiller/config.hpp"

namespace {
std::atomic<long> heap_calls{0};
}

extern "C" {
void* __real_malloc(std::size_t);
void* __real_calloc(std::size_t, std::size_t);
void* __real_realloc(void*, std::size_t);
void __real_free(void*);
void* __wrap_malloc(std::size_t size) {
  ++heap_calls;
  return __real_malloc(size);
}
void* __wrap_calloc(std::size_t count, std::size_t size) {
  ++heap_calls;
  return __real_calloc(count, size);
}
void* __wrap_realloc(void* p, std::size_t size) {
  ++heap_calls;
  return __real_realloc(p, size);
}
void __wrap_free(void* p) {
  ++heap_calls;
  __real_free(p);
}
}

void* operator new(std::size_t size) {
  ++heap_calls;
  void* p = __real_malloc(size);
  if (!p) throw std::bad_alloc();
  return p;
}
void operator delete(void* p) noexcept {
  ++heap_calls;
  __real_free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  ++heap_calls;
  __real_free(p);
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  ++heap_calls;
  void* p = std::aligned_alloc(static_cast<std::size_t>(alignment), (size + 63) / 64 * 64);
  if (!p) throw std::bad_alloc();
  return p;
}
void operator delete(void* p, std::align_val_t) noexcept {
  ++heap_calls;
  __real_free(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  ++heap_calls;
  __real_free(p);
}

namespace tiller_test {
namespace {

using Heap = EveryPlanner;

TEST(HeapTrap, sees_what_it_should) {
  const long before = heap_calls;
  void* volatile p = std::malloc(8);
  std::free(p);
  EXPECT_GE(heap_calls, before + 2);
  const long between = heap_calls;
  int* volatile q = new int(3);  // volatile: a compiler may leave out a pair that nobody sees
  delete q;
  EXPECT_GE(heap_calls, between + 2);
}

TEST_P(Heap, is_not_touched_by_plans) {
  tiller::Config c = line_config(GetParam());
  c.planner.particles = 3;
  c.planner.iterations = 2;
  c.planner.risk = tiller_risk_cvar;
  c.planner.cvar_alpha = 0.5;
  c.planner.rollouts = 64;
  switch_options_on(c);
  Bench bench(c);
  const std::vector<double> states[2] = {{1.0, 0.0}, {std::nan(""), 0.0}};
  const long before = heap_calls;
  for (int i = 0; i < 1000; ++i) {
    bench.set_state(states[i % 10 == 9]);
    bench.plan();
  }
  bench.reset();
  EXPECT_EQ(heap_calls, before);
}

TEST(HeapOfSqp, is_not_touched_by_quadratic_programs) {
  for (const std::uint32_t solver : {tiller_qp_riccati, tiller_qp_osqp}) {
    if (solver == tiller_qp_osqp && !tiller::has_osqp()) continue;
    tiller::Config c = line_config(tiller_planner_sqp);
    c.planner.horizon = 20;
    c.planner.qp_solver = solver;
    c.planner.qp_iterations = 200;
    c.planner.qp_tolerance = 1e-3;
    c.safety.input_rate_per_s[0] = 40.0;
    c.cost.hard_bounds = 2u;  // speed
    c.state_low[1] = -0.3;
    c.state_high[1] = 0.3;
    Bench bench(c);
    const std::vector<double> states[3] = {{1.0, 0.0}, {0.5, -0.4}, {std::nan(""), 0.0}};
    const long before = heap_calls;
    for (int i = 0; i < 200; ++i) {
      bench.set_state(states[i % 3]);
      bench.plan();
    }
    bench.reset();
    EXPECT_EQ(heap_calls, before) << solver;
  }
  EXPECT_EQ(tiller::osqp_refused_allocations(), 0);  // nor did OSQP ask its block for more
}

TILLER_EVERY_PLANNER(Heap);

}  // namespace
}  // namespace tiller_test
