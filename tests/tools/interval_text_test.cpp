// Numbers beside each other: as many digits as their difference needs.
#include "tools/base/interval_text.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

namespace tiller::tools {
namespace {

TEST(IntervalText, IsAsShortAsEverWhereItIsWide) {
  EXPECT_EQ(interval_text(9.81, 9.92), "9.81 .. 9.92");
  EXPECT_EQ(interval_text(0.1, 12.3456789), "0.1 .. 12.35");
  EXPECT_EQ(interval_text(-0.5, 0.25, 3), "-0.5 .. 0.25");
  EXPECT_EQ(mean_text(1.23456, 0.1), "1.235");
}

// "1.2 .. 1.2" says nothing: the ends differ in what is shown, however narrow the interval is.
TEST(IntervalText, DoesNotCollapse) {
  EXPECT_EQ(interval_text(1.20001, 1.20049), "1.20001 .. 1.20049");
  EXPECT_EQ(mean_text(1.2000449, 1.1e-4), "1.20004");
  for (const double middle : {1.2, -1.2, 9.999, 1234.5, 6.0e-7})
    for (int k = 0; k <= 11; ++k) {
      const double width = std::fabs(middle) * std::pow(10.0, -k);
      const IntervalText ends = interval_ends(middle - 0.5 * width, middle + 0.5 * width);
      const double shown = std::strtod(ends.high.c_str(), nullptr) - std::strtod(ends.low.c_str(), nullptr);
      EXPECT_NEAR(shown / width, 1.0, 0.11) << ends.low << " .. " << ends.high;  // two digits: half a unit at each end
    }
}

TEST(IntervalText, WithoutAWidthItKeepsTheLeast) {
  EXPECT_EQ(interval_text(1.2, 1.2), "1.2 .. 1.2");
  EXPECT_EQ(interval_text(0.0, 0.0), "0 .. 0");
  EXPECT_EQ(interval_text(-INFINITY, 1.25), "-inf .. 1.25");
  EXPECT_EQ(mean_text(NAN, 0.1), "nan");
  EXPECT_EQ(digits_that_show(1e-300, 1.0), 15) << "no more than a double has";
}

}  // namespace
}  // namespace tiller::tools
