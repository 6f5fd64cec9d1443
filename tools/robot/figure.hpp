#pragma once

#include <array>
#include <string>
#include <vector>

namespace tiller::tools {

/// [figure]: how the pages draw the robot. Frames in a tree, each placed in its parent by numbers, states and
/// parameters, with lines that move along with it. Nothing but pages reads it.

/// A sum of factor * name; a constant has the empty name. Names are states or parameters of the robot.
struct FigureTerm {
  double factor = 0.0;
  std::string name;
};
using FigureValue = std::vector<FigureTerm>;
using FigurePoint = std::array<FigureValue, 3>;

struct FigureCircle {
  FigurePoint at_m;
  FigureValue radius_m;
  std::array<double, 3> normal{0.0, 1.0, 0.0};
};
struct FigureBox {
  FigurePoint at_m, size_m;
};

struct FigureLink {
  std::string name;
  int parent = -1;                      ///< index of an earlier link; -1: the world
  FigurePoint position_m, rpy_rad;      ///< in the parent's frame, as a URDF's origin
  std::vector<FigureValue> quaternion;  ///< (4) w, x, y, z in the place of rpy_rad; empty: none
  std::array<double, 3> axis{0, 0, 1};  ///< of the joint behind it
  FigureValue turn_rad, slide_m;        ///< about and along it
  bool joined = false;                  ///< a line from the parent's origin to this one's
  std::vector<std::vector<FigurePoint>> lines_m;
  std::vector<FigureCircle> circles;
  std::vector<FigureBox> boxes;
};

struct FigureSection {
  int line = 0;  ///< 0: the file has no such section
  std::string view = "3d";
  std::vector<FigurePoint> goals_m;  ///< points that are wanted somewhere: outputs and states stand for their targets
  std::vector<FigureLink> links;
};

/// Reads "0.1 - 2*half_length_m". False with what is wrong in `problem`; names are not looked up.
bool parse_figure_value(const std::string& text, FigureValue& value, std::string& problem);

}  // namespace tiller::tools
