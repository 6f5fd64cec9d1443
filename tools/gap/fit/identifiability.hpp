#pragma once

#include <string>
#include <vector>

#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/fit/shooting.hpp"

namespace tiller::tools::gap {

/// A direction in the space of the free parameters along which the data say less than the priors.
struct UntoldDirection {
  /// Those of the free parameters that take part, and how: changes relative to their values, the largest +-1.
  std::vector<std::size_t> free;
  std::vector<double> change;
  double sd = 0;       ///< from the data alone, relative to the values; infinite: no motion tells
  bool scale = false;  ///< all take part in the same measure, up or down: products and ratios stay
};

/// Directions that the data of a fit with `information` leave open: of the data's information without the priors', in
/// relative coordinates (parameters over their values or priors' widths, errors of a factor over that factor), the
/// eigenvectors with a deviation above kUntold and above what the priors allow. At most free.size(). names: of the
/// parameters, by index. Cost: one eigenvalue problem.
std::vector<UntoldDirection> untold_directions(const Hypothesis& h, const Fit& fit,
                                               const std::vector<std::string>& names);

/// One sentence a direction, for people: "The logs tell mass_kg, damping_Nms and gain only by their ratios ...".
/// names: of the parameters, by index.
std::string untold_text(const Hypothesis& h, const UntoldDirection& d, const std::vector<std::string>& names);

}  // namespace tiller::tools::gap
