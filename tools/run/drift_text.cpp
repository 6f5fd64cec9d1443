#include "tools/run/drift_text.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

/// e^log_odds times. The hypotheses are not as exact as the largest odds would have it.
std::string times_text(double log_odds) {
  constexpr double kMost = 1e6;
  const double times = std::exp(log_odds);
  if (times > kMost) return "a million times";
  return format("%.*f times", times < 10 ? 1 : 0, times);
}

std::string beside(double own, const char* first, double first_odds, const char* second, double second_odds) {
  return ": by the data " + times_text(own - first_odds) + " likelier than " + first + " and " +
         times_text(own - second_odds) + " than " + second;
}

}  // namespace

std::string drift_text(const std::string& name, const std::string& unit, const DriftFound& found) {
  if (found.walk == 0.0 && found.jump == 0.0) return name + ": the data do not tell yet whether it drifts";
  const double likeliest = std::max({0.0, found.walk, found.jump});
  // less than that is worth no more than a mention (Kass and Raftery 1995)
  constexpr double kWorthIt = 3.0;
  double odds[] = {0.0, found.walk, found.jump};
  std::sort(odds, odds + 3);
  if (odds[2] - odds[1] < std::log(kWorthIt))
    return name + format(
                      ": the data do not tell whether it stays, walks (%.2g times as likely) or jumps (%.2g times as "
                      "likely)",
                      std::exp(found.walk), std::exp(found.jump));
  if (likeliest == 0.0) return name + " stays" + beside(0.0, "a walk", found.walk, "a jump", found.jump);
  if (likeliest == found.walk) return name + " walks" + beside(found.walk, "a jump", found.jump, "none", 0.0);
  const std::string by = format("%+.3g", found.jumped_by) + (unit.empty() ? "" : " " + unit);
  return name + " jumped by " + by + format(" %.1f s ago", found.age_s) +
         beside(found.jump, "a walk", found.walk, "none", 0.0);
}

}  // namespace tiller::tools
