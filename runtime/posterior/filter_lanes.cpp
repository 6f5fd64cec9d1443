#include "posterior/filter_lanes.hpp"

namespace tiller {

// The copies live in namespaces named after their instruction set; the build says which there are.
#define TILLER_DECLARE_COPY(name)   \
  namespace name {                  \
  const FilterTable& filter_copy(); \
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

const FilterTable& filter_table() {
  switch (best_isa()) {
#ifdef TILLER_POSTERIOR_avx512
    case Isa::avx512: return avx512::filter_copy();
#endif
#ifdef TILLER_POSTERIOR_avx2
    case Isa::avx2: return avx2::filter_copy();
#endif
    default: break;
  }
    // the least of those built: the target's baseline, or the one instruction set of a build for a known processor
#if defined(TILLER_POSTERIOR_sse2)
  return sse2::filter_copy();
#elif defined(TILLER_POSTERIOR_neon)
  return neon::filter_copy();
#elif defined(TILLER_POSTERIOR_scalar)
  return scalar::filter_copy();
#elif defined(TILLER_POSTERIOR_avx2)
  return avx2::filter_copy();
#else
  return avx512::filter_copy();
#endif
}

}  // namespace tiller
