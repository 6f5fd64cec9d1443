// CSV files of goals.

#include "tools/robot/goals.hpp"

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>

#include "rollout/attitude.hpp"
#include "tools/base/frame_names.hpp"
#include "tools/robot/section_reader.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostErrors = 5;  // more say no more

/// What a column sets.
struct Column {
  enum class Kind { time, state, output, angle, attitude } kind = Kind::time;
  std::size_t index = 0;  ///< of the state or the output; of an angle: roll, pitch, yaw
  std::size_t first = 0;  ///< of an attitude's angle: the quaternion's first state
  std::string frame;      ///< an angle's
};

class GoalReader {
 public:
  GoalReader(const std::string& path, const RobotFile& robot, Words& errors)
      : path_(path), robot_(robot), errors_(errors), before_(errors.size()) {}

  bool read(std::istream& file, std::vector<Goal>& goals) {
    std::string line;
    for (std::size_t number = 1; std::getline(file, line) && errors_.size() < before_ + kMostErrors; ++number) {
      if (trimmed(line).empty() || trimmed(line)[0] == '#') continue;
      if (names_.empty())
        read_header(csv_cells(line), number);
      else if (errors_.size() == before_)
        read_row(csv_cells(line), number, goals);
    }
    if (errors_.size() == before_ && goals.empty())
      add(1, "goals", "there is none", "write a header and a row for each goal, e.g. time_s," + robot_.names.states[0]);
    return errors_.size() == before_;
  }

 private:
  void add(std::size_t line, const std::string& what, const std::string& problem, const std::string& remedy) {
    errors_.push_back(path_ + ":" + std::to_string(line) + ": " + what + ": " + problem + "; " + remedy);
  }

  /// Angles of frames that the model tells of, and of quaternions among its states.
  bool is_angle(const std::string& name, Column& column) const {
    const char* const endings[] = {"_roll_rad", "_pitch_rad", "_yaw_rad"};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::string ending = endings[k];
      if (name.size() <= ending.size() || name.compare(name.size() - ending.size(), ending.size(), ending) != 0)
        continue;
      column = {Column::Kind::angle, k, 0, name.substr(0, name.size() - ending.size())};
      const int first = index_of(robot_.names.states, column.frame + "_w");
      if (first >= 0 && (robot_.config.model->quaternion_mask >> first & 1u) != 0) {
        column.kind = Column::Kind::attitude;
        column.first = static_cast<std::size_t>(first);
        return true;
      }
      return index_of(robot_.names.outputs, frame_output_names(column.frame)[3]) >= 0;
    }
    return false;
  }

  void read_header(const Words& names, std::size_t line) {
    names_ = names;
    bool has_time = false;
    for (const std::string& name : names) {
      Column column;
      if (name == "time_s") {
        has_time = true;
      } else if (const int state = index_of(robot_.names.states, name); state >= 0) {
        column = {Column::Kind::state, static_cast<std::size_t>(state), 0, ""};
        about_states_ = true;
      } else if (const int output = index_of(robot_.names.outputs, name); output >= 0) {
        column = {Column::Kind::output, static_cast<std::size_t>(output), 0, ""};
        about_outputs_ = true;
      } else if (is_angle(name, column)) {
        (column.kind == Column::Kind::attitude ? about_states_ : about_outputs_) = true;
      } else {
        Words known = {"time_s"};
        known.insert(known.end(), robot_.names.states.begin(), robot_.names.states.end());
        known.insert(known.end(), robot_.names.outputs.begin(), robot_.names.outputs.end());
        add(line, name, "is neither a state nor an output of the model", remedy_for_unknown(name, known));
      }
      columns_.push_back(column);
    }
    if (!has_time) add(line, "time_s", "the header has no such column", "write from when on each goal holds");
    if (about_outputs_ && robot_.config.cost.output_count == 0)
      add(line, "goals of outputs", "the robot file weighs none",
          "give them weights in [cost] outputs or [cost] frames");
    now_ = goal_of(robot_);
  }

  void read_row(const Words& cells, std::size_t line, std::vector<Goal>& goals) {
    if (cells.size() != columns_.size())
      return add(line, "row",
                 "has " + std::to_string(cells.size()) + " cells, the header " + std::to_string(columns_.size()),
                 "write a cell for each column");
    std::string frame;
    std::array<double, 3> rpy{};
    std::map<std::size_t, std::array<double, 3>> angles;  // by the quaternion's first state
    for (std::size_t c = 0; c < cells.size(); ++c) {
      const Column& column = columns_[c];
      if (cells[c].empty() && column.kind != Column::Kind::time) continue;
      char* end = nullptr;
      const double value = std::strtod(cells[c].c_str(), &end);
      if (cells[c].empty() || *end != '\0' || !(std::fabs(value) <= TILLER_LARGEST_VALUE))
        return add(line, names_[c] + " = " + cells[c], "is no finite number", "write the number alone, in SI units");
      switch (column.kind) {
        case Column::Kind::time:
          if (!goals.empty() && !(value > goals.back().time_s))
            return add(line, "time_s = " + cells[c], "is not after the row before", "sort the rows by time");
          now_.time_s = value;
          break;
        case Column::Kind::state: now_.states[column.index] = value; break;
        case Column::Kind::output: now_.outputs[column.index] = value; break;
        case Column::Kind::attitude: angles[column.first][column.index] = value; break;
        case Column::Kind::angle:
          if (column.frame != frame) turn(frame, rpy);
          frame = column.frame;
          rpy[column.index] = value;
      }
    }
    turn(frame, rpy);
    for (const auto& [first, a] : angles) write_quaternion(from_roll_pitch_yaw(a[0], a[1], a[2]), &now_.states[first]);
    for_quaternions(robot_.config.model->quaternion_mask, [&](std::uint32_t first) {
      if (!is_attitude(&now_.states[first]))
        add(line, robot_.names.states[first], "is the first of a quaternion whose length is not 1",
            "write all four of it, or its roll, pitch and yaw in rad (" + attitude_columns(first) + ")");
    });
    if (errors_.size() != before_) return;
    goals.push_back(now_);
    if (!about_states_) goals.back().states.clear();
    if (!about_outputs_) goals.back().outputs.clear();
  }

  std::string attitude_columns(std::size_t first) const {
    const std::string& name = robot_.names.states[first];  // ends with _w, or is told as it is
    const std::string stem = name.substr(0, name.size() - 2);
    return stem + "_roll_rad, " + stem + "_pitch_rad, " + stem + "_yaw_rad";
  }

  /// Sets a frame's rotation, and makes the angles ready for the next one.
  void turn(const std::string& frame, std::array<double, 3>& rpy) {
    if (frame.empty()) return;
    const auto names = frame_output_names(frame);
    const std::array<double, 9> rotation = rotation_of(rpy);
    for (std::size_t i = 0; i < 9; ++i)
      now_.outputs[static_cast<std::size_t>(index_of(robot_.names.outputs, names[3 + i]))] = rotation[i];
    rpy = {};
  }

  const std::string& path_;
  const RobotFile& robot_;
  Words& errors_;
  const std::size_t before_;
  Words names_;
  std::vector<Column> columns_;
  bool about_states_ = false, about_outputs_ = false;
  Goal now_;
};

}  // namespace

Goal goal_of(const RobotFile& robot) {
  const tiller_cost_config_t& cost = robot.config.cost;
  Goal goal;
  goal.states.assign(cost.target, cost.target + robot.names.states.size());
  for (std::uint32_t j = 0; j < cost.output_count; ++j) goal.outputs.push_back(cost.outputs[j].target);
  return goal;
}

bool read_goals(const std::string& path, const RobotFile& robot, std::vector<Goal>& goals, Words& errors) {
  goals.clear();
  std::ifstream file(path);
  if (!file) {
    errors.push_back(path + ": cannot be read: " + std::strerror(errno));
    return false;
  }
  return GoalReader(path, robot, errors).read(file, goals);
}

}  // namespace tiller::tools
