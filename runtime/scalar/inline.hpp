#pragma once

/// For the small functions that lanes are made of: code compiled for one instruction set must not be emitted out of
/// line, and what is not inlined is not folded. A build for sanitizers or coverage (TILLER_PLAIN_CALLS) has one copy
/// and is not optimised: there a function that is written once is compiled once, and keeps its name in a finding's
/// stack.
#if defined(TILLER_PLAIN_CALLS)
#define TILLER_INLINE inline
#define TILLER_INLINED
#define TILLER_FLATTENED __attribute__((noinline))
#else
#define TILLER_INLINE inline __attribute__((always_inline))
/// The same behind a lambda's parameters.
#define TILLER_INLINED __attribute__((always_inline))
/// All that the function calls is inlined into it, the function itself nowhere.
#define TILLER_FLATTENED __attribute__((flatten, noinline))
#endif
