#pragma once

#include <string>

namespace tiller::tools {

/// What the data say of a parameter that may drift: tiller_info_t's fields of it.
struct DriftFound {
  double walk = 0.0, jump = 0.0;        ///< logarithms of how much likelier than none
  double age_s = 0.0, jumped_by = 0.0;  ///< of the likeliest jump
};

/// Which of none, a walk and a jump is the likeliest, and beside the others by how much.
std::string drift_text(const std::string& name, const std::string& unit, const DriftFound& found);

}  // namespace tiller::tools
