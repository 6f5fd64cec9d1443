// Memory of `tiller gap` once the logs are read: never more than the bound that it tells, which it knows before it
// searches. Every way to the heap is counted, in bytes in use.
#include <gtest/gtest.h>
#include <malloc.h>

#include <cerrno>

#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/pipeline/gap.hpp"

namespace {
std::size_t in_use = 0, most = 0;

void* taken(void* p) {
  in_use += malloc_usable_size(p);
  if (in_use > most) most = in_use;
  return p;
}
void given_back(void* p) { in_use -= malloc_usable_size(p); }
}  // namespace

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t n) { return taken(__libc_malloc(n)); }
void* calloc(std::size_t n, std::size_t size) { return taken(__libc_calloc(n, size)); }
void* realloc(void* p, std::size_t n) {
  given_back(p);
  return taken(__libc_realloc(p, n));
}
void free(void* p) {
  given_back(p);
  __libc_free(p);
}
void* memalign(std::size_t alignment, std::size_t n) { return taken(__libc_memalign(alignment, n)); }
void* aligned_alloc(std::size_t alignment, std::size_t n) { return taken(__libc_memalign(alignment, n)); }
int posix_memalign(void** p, std::size_t alignment, std::size_t n) {
  *p = taken(__libc_memalign(alignment, n));
  return *p ? 0 : ENOMEM;
}
}  // extern "C"

namespace tiller::tools::gap {
namespace {

struct Use {
  Result result;
  std::size_t most = 0;  ///< over what was in use before
};

Use run(const Synthetic& s, int logs, std::uint32_t max_effects) {
  tiller::Config config = synthetic_config(s);
  config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.95 * s.params[0], 1.05 * s.params[0]};
  std::vector<std::string> names;
  for (std::uint32_t i = 0; i < s.model->param_count; ++i) names.push_back(s.model->param_names[i]);
  Options options;
  options.max_effects = max_effects;
  std::vector<Grid> grids = simulate_logs(s, logs, 100020);
  const std::size_t before = in_use;
  most = in_use;
  Use use;
  use.result = find_gap_on(config, names, std::move(grids), {}, options);
  use.most = most - before;
  std::printf("   %s: %d logs, told %.2f MB, taken %.2f MB\n", s.model->name, logs,
              static_cast<double>(use.result.memory_bytes) / 1e6, static_cast<double>(use.most) / 1e6);
  return use;
}

TEST(Memory, TheTrapCounts) {
  most = in_use;
  const std::size_t before = in_use;
  void* volatile p = std::malloc(100000);
  std::free(p);
  p = ::operator new(50000);
  ::operator delete(p);
  EXPECT_GE(most - before, 100000u);
  EXPECT_EQ(in_use, before);
}

TEST(Memory, StaysWithinWhatIsTold) {
  Synthetic s;
  s.amplitude = 0.8;
  s.delay_s = 0.02;
  s.force = [](double, double v, double, double) { return -0.06 * std::tanh(v / 0.002); };
  const Use use = run(s, 3, 2);
  EXPECT_GE(use.result.ranking.size(), 5u);  // it searched
  EXPECT_LE(use.most, use.result.memory_bytes);
  EXPECT_GE(use.most, use.result.memory_bytes / 10);  // and the bound is not idle

  Synthetic arm;
  arm.model = tiller_find_model("cart_pole");
  arm.params = {1.0, 0.2, 0.4};
  arm.force = [](double, double v, double, double) { return -0.8 * v; };
  const Use other = run(arm, 2, 1);
  EXPECT_LE(other.most, other.result.memory_bytes);
}

}  // namespace
}  // namespace tiller::tools::gap
#endif
