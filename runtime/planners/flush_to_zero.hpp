#pragma once

#include <cstdint>

// Not in the reproducible build: processors disagree on what counts as zero (before or after rounding), and Cortex-M
// and x86 on the rest.
#if defined(TILLER_REPRODUCIBLE)
#define TILLER_KEEPS_DENORMALS 1
#elif defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace tiller {

/// Denormals count as zero while one of these lives on this thread; the caller's mode comes back afterwards.
/// Softmax weights of bad rollouts are denormal, and each costs a microcode assist of some 150 cycles: an update
/// takes thirty times as long without this. Every thread that works on a plan holds one, so that bits do not
/// depend on who did the work.
class FlushToZero {
 public:
#if defined(TILLER_KEEPS_DENORMALS)
  FlushToZero() {}
  ~FlushToZero() {}
#elif defined(__SSE2__)
  FlushToZero() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040u); }  // FTZ | DAZ
  ~FlushToZero() { _mm_setcsr(saved_); }
#elif defined(__aarch64__)
  FlushToZero() {
    asm volatile("mrs %0, fpcr" : "=r"(saved_));
    asm volatile("msr fpcr, %0" : : "r"(saved_ | (std::uint64_t{1} << 24)));  // FZ
  }
  ~FlushToZero() { asm volatile("msr fpcr, %0" : : "r"(saved_)); }
#else
  FlushToZero() {}
  ~FlushToZero() {}
#endif
  FlushToZero(const FlushToZero&) = delete;
  FlushToZero& operator=(const FlushToZero&) = delete;

 private:
#if defined(TILLER_KEEPS_DENORMALS)
#elif defined(__SSE2__)
  unsigned int saved_;
#elif defined(__aarch64__)
  std::uint64_t saved_ = 0;
#endif
};

}  // namespace tiller
