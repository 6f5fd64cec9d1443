#include "posterior/filter_lanes.hpp"

#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(FilterTable, kFilterLanes)

const FilterTable& filter_table() {
  static constexpr IsaCopy<FilterTable> kCopies[] = {TILLER_COPIES(kFilterLanes)};
  return select_copy(kCopies);
}

}  // namespace tiller
