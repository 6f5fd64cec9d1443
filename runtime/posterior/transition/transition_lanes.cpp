#include "posterior/transition/transition_lanes.hpp"

namespace tiller {

// The copies live in namespaces named after their instruction set; the build says which there are.
#define TILLER_DECLARE_COPY(name)           \
  namespace name {                          \
  const TransitionTable& transition_copy(); \
  }
#ifdef TILLER_POSTERIOR_scalar
TILLER_DECLARE_COPY(scalar)
#endif
#ifdef TILLER_POSTERIOR_sse2
TILLER_DECLARE_COPY(sse2)
#endif
#ifdef TILLER_POSTERIOR_avx2
TILLER_DECLARE_COPY(avx2)
#endif
#ifdef TILLER_POSTERIOR_avx512
TILLER_DECLARE_COPY(avx512)
#endif
#ifdef TILLER_POSTERIOR_neon
TILLER_DECLARE_COPY(neon)
#endif

const TransitionTable& transition_table() {
  switch (best_isa()) {
#ifdef TILLER_POSTERIOR_avx512
    case Isa::avx512: return avx512::transition_copy();
#endif
#ifdef TILLER_POSTERIOR_avx2
    case Isa::avx2: return avx2::transition_copy();
#endif
    default: break;
  }
    // the least of those built: the target's baseline, or the one instruction set of a build for a known processor
#if defined(TILLER_POSTERIOR_sse2)
  return sse2::transition_copy();
#elif defined(TILLER_POSTERIOR_neon)
  return neon::transition_copy();
#elif defined(TILLER_POSTERIOR_scalar)
  return scalar::transition_copy();
#elif defined(TILLER_POSTERIOR_avx2)
  return avx2::transition_copy();
#else
  return avx512::transition_copy();
#endif
}

}  // namespace tiller
