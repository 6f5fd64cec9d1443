// Friction that a posterior with forces has found beside the model's, in words.

#include "tools/run/friction_text.hpp"

#include <cmath>

#include "posterior/posterior.hpp"
#include "tools/base/interval_text.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

/// Deviations from none: once in two thousand joints without friction.
constexpr double kSure = 3.5;

bool slides(const RobotFile& robot, std::uint32_t joint) {
  return unit_of_field(robot.config.model->force_names[robot.config.model->joints[joint].force]) == "N";
}

std::string amount(double mean, double sd, const char* unit) {
  if (!(sd > 0.0) || !(std::fabs(mean) > kSure * sd)) return "";
  return mean_text(mean, sd) + format(" +- %.2g ", sd) + unit;
}

}  // namespace

/// One that pushes along with the motion is none; a viscous one may be less than what the model has.
std::string dry_text(const RobotFile& robot, const tiller_info_t& info, std::uint32_t joint) {
  if (info.dry_mean[joint] < 0.0) return "";
  return amount(info.dry_mean[joint], info.dry_sd[joint], slides(robot, joint) ? "N" : "N m");
}

std::string viscous_text(const RobotFile& robot, const tiller_info_t& info, std::uint32_t joint) {
  return amount(info.viscous_mean[joint], info.viscous_sd[joint], slides(robot, joint) ? "N s/m" : "N m s");
}

Words friction_lines(const RobotFile& robot, const tiller_info_t& info) {
  Words lines;
  for (std::uint32_t j = 0; j < Posterior::force_joints(robot.config); ++j) {
    const std::string joint = std::string("joint ") + robot.config.model->joints[j].name + ": ";
    if (const std::string dry = dry_text(robot, info, j); !dry.empty())
      lines.push_back(joint + "dry friction beyond the model, " + dry);
    if (const std::string viscous = viscous_text(robot, info, j); !viscous.empty())
      lines.push_back(joint + "viscous friction beyond the model, " + viscous);
  }
  return lines;
}

}  // namespace tiller::tools
