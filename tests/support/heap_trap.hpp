#pragma once

// Counts every allocation of the process while a piece of work runs: by taking the place of the C library's functions
// (which new and delete, Eigen and the C++ library end in), or by the sanitizer's own hooks. Include it in one source
// of a program.

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

namespace tiller_test {
inline std::atomic<bool> trap_set{false};
inline std::atomic<std::uint64_t> heap_calls{0};
inline thread_local std::uint64_t heap_calls_here = 0;  ///< of this thread, ever
inline void count_heap_call() {
  if (!trap_set.load(std::memory_order_relaxed)) return;
  heap_calls.fetch_add(1, std::memory_order_relaxed);
  ++heap_calls_here;
}
/// Allocations and releases during work(arg).
inline std::uint64_t heap_calls_in(void (*work)(void*), void* arg) {
  heap_calls = 0;
  trap_set = true;
  work(arg);
  trap_set = false;
  return heap_calls;
}
}  // namespace tiller_test

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TILLER_TEST_SANITIZED 1
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*)(const volatile void*, std::size_t),
                                                         void (*)(const volatile void*));
namespace tiller_test {
inline const int installed = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { count_heap_call(); }, [](const volatile void*) { count_heap_call(); });
}  // namespace tiller_test
#else
#define TILLER_TEST_SANITIZED 0
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t n) {
  tiller_test::count_heap_call();
  return __libc_malloc(n);
}
void* calloc(std::size_t n, std::size_t size) {
  tiller_test::count_heap_call();
  return __libc_calloc(n, size);
}
void* realloc(void* p, std::size_t n) {
  tiller_test::count_heap_call();
  return __libc_realloc(p, n);
}
void free(void* p) {
  tiller_test::count_heap_call();
  __libc_free(p);
}
void* memalign(std::size_t alignment, std::size_t n) {
  tiller_test::count_heap_call();
  return __libc_memalign(alignment, n);
}
void* aligned_alloc(std::size_t alignment, std::size_t n) {
  tiller_test::count_heap_call();
  return __libc_memalign(alignment, n);
}
int posix_memalign(void** p, std::size_t alignment, std::size_t n) {
  tiller_test::count_heap_call();
  *p = __libc_memalign(alignment, n);
  return *p ? 0 : ENOMEM;
}
}  // extern "C"
#endif
