#pragma once

#include <string>
#include <vector>

#include "tiller/model.h"
#include "tools/robot/log_map.hpp"

namespace tiller::tools {

/// A log as it was measured, in SI units, in file order.
struct Log {
  std::string path;
  std::vector<int> line;                   ///< (rows) of the file, 1-based
  std::vector<double> time_s;              ///< (rows) from the first row on
  std::vector<std::vector<double>> state;  ///< (nx) of (rows); NaN: not measured; empty: no such column
  std::vector<std::vector<double>> input;  ///< (nu) of (rows)
  bool undriven = false;                   ///< inputs are 0 because the log has none
  std::size_t rows() const { return time_s.size(); }
};

/// Reads `path` and checks what can be checked without physics: columns, numbers, stamps. False with every reason
/// in `error` as "file:line: column: problem; remedy".
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

/// Typical (median) time between rows.
double median_step_s(const Log& log);

}  // namespace tiller::tools
