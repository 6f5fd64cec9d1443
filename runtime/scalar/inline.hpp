#pragma once

/// For the small functions that lanes are made of: code compiled for one instruction set must not be emitted out of
/// line, and what is not inlined is not folded.
#define TILLER_INLINE inline __attribute__((always_inline))
/// The same behind a lambda's parameters.
#define TILLER_INLINED __attribute__((always_inline))
