// What a run says of a parameter that may drift.

#include "tools/run/drift_text.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace {

using tiller::tools::drift_text;

TEST(DriftText, NamesTheLikeliest) {
  EXPECT_EQ(drift_text("mass_kg", "kg", {std::log(50.0), std::log(2000.0), 3.41, 0.2104}),
            "mass_kg jumped by +0.21 kg 3.4 s ago: by the data 40 times likelier than a walk and 2000 times than none");
  EXPECT_EQ(drift_text("mass_kg", "kg", {std::log(50.0), std::log(10.0), 3.41, -0.2}),
            "mass_kg walks: by the data 5.0 times likelier than a jump and 50 times than none");
  EXPECT_EQ(drift_text("mass_kg", "kg", {-std::log(50.0), -std::log(5.0), 3.41, 0.2}),
            "mass_kg stays: by the data 50 times likelier than a walk and 5.0 times than a jump");
}

TEST(DriftText, ANumberHasNoUnitAndOddsHaveAnEnd) {
  EXPECT_EQ(drift_text("gain", "", {300.0, 900.0, 0.06, -0.1234}),
            "gain jumped by -0.123 0.1 s ago: by the data a million times likelier than a walk and a million times "
            "than none");
}

TEST(DriftText, LittleEvidenceIsToldAsThat) {
  EXPECT_EQ(
      drift_text("mass_kg", "kg", {std::log(0.8), std::log(1.5), 3.41, 0.2}),
      "mass_kg: the data do not tell whether it stays, walks (0.8 times as likely) or jumps (1.5 times as likely)");
}

TEST(DriftText, NothingIsToldBeforeThereAreData) {
  EXPECT_EQ(drift_text("mass_kg", "kg", {}), "mass_kg: the data do not tell yet whether it drifts");
}

}  // namespace
