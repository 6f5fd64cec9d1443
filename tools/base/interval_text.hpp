#pragma once

#include <string>

namespace tiller::tools {

/// Significant digits of numbers as large as `largest` at which a difference of `width` shows with two of its own: with
/// fewer an interval collapses to "1.2 .. 1.2". At least `least`, and no more than a double has.
int digits_that_show(double width, double largest, int least = 4);

/// "low .. high" with the digits that its width needs.
struct IntervalText {
  std::string low, high;
};
IntervalText interval_ends(double low, double high, int least = 4);
std::string interval_text(double low, double high, int least = 4);

/// A mean with the digits that its standard deviation needs.
std::string mean_text(double mean, double sd, int least = 4);

}  // namespace tiller::tools
