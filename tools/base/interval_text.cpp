// Numbers that are read beside each other: as many digits as their difference needs.

#include "tools/base/interval_text.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr int kMostDigits = 15;  // a double's: more are noise of the conversion

int exponent_of(double value) { return static_cast<int>(std::floor(std::log10(value))); }

}  // namespace

int digits_that_show(double width, double largest, int least) {
  width = std::fabs(width);
  largest = std::fabs(largest);
  if (!(width > 0) || !(largest > 0) || !std::isfinite(width) || !std::isfinite(largest)) return least;
  return std::clamp(exponent_of(largest) - exponent_of(width) + 2, least, kMostDigits);
}

IntervalText interval_ends(double low, double high, int least) {
  const int digits = digits_that_show(high - low, std::max(std::fabs(low), std::fabs(high)), least);
  return {format("%.*g", digits, low), format("%.*g", digits, high)};
}

std::string interval_text(double low, double high, int least) {
  const IntervalText ends = interval_ends(low, high, least);
  return ends.low + " .. " + ends.high;
}

std::string mean_text(double mean, double sd, int least) {
  return format("%.*g", digits_that_show(sd, mean, least), mean);
}

}  // namespace tiller::tools
