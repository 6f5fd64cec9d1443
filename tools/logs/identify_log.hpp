#pragma once

#include <string>
#include <vector>

#include "tiller/model.h"
#include "tools/robot/log_map.hpp"

namespace tiller::tools {

/// A log as it was measured, in SI units, in the order of time. A row is a moment at which at least one sensor was read
/// or, in a table, a line. Sensors that are read at other rates are missing (NaN) in between; inputs hold there.
struct Log {
  std::string path;
  LogMap map;                               ///< how it was read: [log] where names and units are its writer's own
  std::string note;                         ///< what of it is unlike a plain log, and how it was read; empty: nothing
  std::vector<int> line;                    ///< (rows) of the file, 1-based; of a bag: number of the row
  std::vector<double> time_s;               ///< (rows) from the first row on
  std::vector<std::vector<double>> state;   ///< (nx) of (rows); NaN: not measured; empty: no such column
  std::vector<std::vector<double>> input;   ///< (nu) of (input_times())
  std::vector<std::vector<double>> scale;   ///< (nu) of (input_times()), what [log] schedule multiplies the input by
  std::vector<std::vector<double>> sensor;  ///< (map.sensors) of (rows); NaN: not measured
  std::vector<double> input_time_s;         ///< stamps of the inputs' own; empty: those of the rows
  bool undriven = false;                    ///< inputs are 0 because the log has none
  std::size_t rows() const { return time_s.size(); }
  const std::vector<double>& input_times() const { return input_time_s.empty() ? time_s : input_time_s; }
};

/// Reads a CSV and checks what can be checked without physics: columns, numbers, stamps. False with every reason in
/// `error` as "file:line: column: problem; remedy".
bool read_log(const std::string& path, const LogMap& map, const tiller_model_t& model, const std::vector<int>& measured,
              Log& log, std::string& error);

/// Physics that a log cannot have by accident: a channel that never moves, an angle in degrees, a rate that is not
/// the change of its position, stamps in another unit than seconds. Errors as above; what is merely odd goes to
/// `warnings`.
bool check_log(const Log& log, const LogMap& map, const tiller_model_t& model, double period_s,
               std::vector<std::string>& warnings, std::string& error);

/// Rows [first, last) between which no stamp is missing: a gap is longer than five typical steps.
struct Segment {
  std::size_t first = 0, last = 0;
};
std::vector<Segment> split_at_gaps(const Log& log);

/// Typical (median) time between the samples of the sensor that is read most often: between rows, where each has them
/// all.
double median_step_s(const Log& log);

/// Typical time between the samples of one sensor, whose column is `values`.
double median_step_s(const Log& log, const std::vector<double>& values);

}  // namespace tiller::tools
