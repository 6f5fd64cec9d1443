#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/logs/run_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A part of the row, `rows` x `columns`; columns have names.
struct ViewField {
  std::string name;
  std::size_t rows = 1;
  Words columns;
};

/// What a viewer is told of one tick: one row of doubles, NaN where there is nothing. Of a long horizon every n-th step
/// is in it, and of many particles every n-th, so that a row stays small.
class ViewRow {
 public:
  explicit ViewRow(const RobotFile& robot);

  const std::vector<ViewField>& fields() const { return fields_; }
  std::size_t size() const { return size_; }
  /// Periods between two steps of the fields `plan` and `predicted.*`.
  std::size_t stride() const { return stride_; }
  /// `row` (size) of a tick that is over. Reads the controller; nothing is allocated.
  void fill(const tiller_t* controller, const LoggedTick& tick, double* row);

 private:
  void add(const std::string& name, const Words& columns, std::size_t rows = 1);
  void put(const double* values, std::size_t count);
  void put_inferred(const double* values);
  void put_nothing(std::size_t count);
  void put_plan(const tiller_t* controller);
  void put_prediction(const tiller_t* controller);
  void put_particles(const tiller_t* controller);
  void put_forces(const tiller_info_t& info);
  void put_states(const LoggedTick& tick);
  void put_foreseen(const LoggedTick& tick);

  const RobotFile& robot_;
  const tiller_config_t& config_;
  std::vector<std::size_t> inferred_;  // parameters that are not fixed
  std::size_t nx_, nu_, forces_, steps_, stride_, particles_;
  std::vector<ViewField> fields_;
  std::size_t size_ = 0;
  std::vector<double> plan_;    // (horizon x nu)
  std::vector<double> target_;  // (nx) in force; NaN: a reference is followed
  double* at_ = nullptr;
};

}  // namespace tiller::tools
