// CSV files of trajectories: what a reference or a demonstration of the cost is made from.

#include "tools/robot/trajectory_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "rollout/attitude.hpp"
#include "tools/robot/attitude_signs.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostErrors = 5;  // of one file: more say no more
constexpr double kPi = 3.14159265358979323846;

/// Collects "file:line: what: problem; remedy".
struct Findings {
  const std::string& path;
  Words& list;
  std::size_t before;
  bool full() const { return list.size() >= before + kMostErrors; }
  bool none() const { return list.size() == before; }
  void add(std::size_t line, const std::string& what, const std::string& problem, const std::string& remedy) {
    if (full()) return;
    list.push_back(path + ":" + std::to_string(line) + ": " + what + ": " + problem + "; " + remedy);
  }
};

int column_of(const Words& header, const std::string& name) {
  const auto found = std::find(header.begin(), header.end(), name);
  return found == header.end() ? -1 : static_cast<int>(found - header.begin());
}

/// Which column holds what.
struct Columns {
  int time = -1;
  std::vector<int> mean, sd;  // (nx)
};

/// "angle_deg", "angle (rad)": the column that was probably meant, and why it is not taken.
std::string remedy_for_column(const std::string& name, const Words& header, const tiller_model_t& model) {
  const Words states(model.state_names, model.state_names + model.state_count);
  const std::string stem = name.substr(0, name.find('_'));
  for (const std::string& column : header)
    if (column_of(states, column) < 0 && column.rfind(stem, 0) == 0)
      return "is it '" + column + "'? Values are in SI units: convert it and name it " + name;
  const std::string near = nearest(name, header);
  if (!near.empty()) return "is it '" + near + "'? Name it " + name;
  return "add the column; the header is time_s and the model's states, in SI units";
}

Columns find_columns(const Words& header, const tiller_model_t& model, Findings& findings) {
  Columns columns;
  columns.time = column_of(header, "time_s");
  if (columns.time < 0)
    findings.add(1, "time_s", "the header has no such column", remedy_for_column("time_s", header, model));
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const std::string name = model.state_names[i];
    const int estimate = column_of(header, "mean." + name);
    columns.mean.push_back(estimate >= 0 ? estimate : column_of(header, name));
    columns.sd.push_back(column_of(header, "sd." + name));
    if (columns.mean.back() < 0)
      findings.add(1, name, "the header has no such column", remedy_for_column(name, header, model));
  }
  for (std::size_t i = 0; i < header.size(); ++i)
    if (column_of(header, header[i]) != static_cast<int>(i))
      findings.add(1, header[i], "the header has this column twice", "keep one");
  // deviations are those of a distribution only where the file is nothing else: tiller's logs have them too
  const bool all = std::none_of(columns.sd.begin(), columns.sd.end(), [](int c) { return c < 0; });
  if (!all || header.size() != 1 + 2 * columns.mean.size()) columns.sd.clear();
  return columns;
}

struct Table {
  std::vector<double> time_s;
  std::vector<std::vector<double>> mean, sd;  // (nx) of (rows)
};

double number_in(const Words& cells, int column, std::size_t line, const std::string& name, Findings& findings) {
  const std::string cell =
      static_cast<std::size_t>(column) < cells.size() ? cells[static_cast<std::size_t>(column)] : "";
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  if (cell.empty()) {
    findings.add(line, name, "is empty", "give every row a value, or leave the row out");
  } else if (*end != '\0') {
    findings.add(line, name + " = " + cell, "is no number",
                 "write the number alone, in SI units, with a decimal point");
  } else if (!std::isfinite(value)) {
    findings.add(line, name + " = " + cell, "is not finite", "give every row a finite value, or leave the row out");
  }
  return value;
}

void read_row(const Words& cells, std::size_t line, const Columns& columns, const tiller_model_t& model, Table& table,
              Findings& findings) {
  const double time = number_in(cells, columns.time, line, "time_s", findings);
  if (!table.time_s.empty() && !(time > table.time_s.back()))
    findings.add(line, "time_s = " + number_text(time), "is not after the row before", "sort the rows by time");
  table.time_s.push_back(time);
  for (std::size_t i = 0; i < columns.mean.size(); ++i) {
    table.mean[i].push_back(number_in(cells, columns.mean[i], line, model.state_names[i], findings));
    if (columns.sd.empty()) continue;
    const std::string name = std::string("sd.") + model.state_names[i];
    const double sd = number_in(cells, columns.sd[i], line, name, findings);
    if (!(sd > 0) && std::isfinite(sd))
      findings.add(line, name + " = " + number_text(sd), "is not positive", "write a deviation above 0");
    table.sd[i].push_back(sd);
  }
}

/// The header is the first line that is neither empty nor a comment.
bool read_table(std::ifstream& file, const tiller_model_t& model, Table& table, Findings& findings) {
  table.mean.resize(model.state_count);
  table.sd.resize(model.state_count);
  Columns columns;
  bool headed = false;
  std::size_t line = 0;
  for (std::string text; std::getline(file, text) && !findings.full();) {
    ++line;
    const std::string row = trimmed(text);
    if (row.empty() || row[0] == '#') continue;
    if (headed) {
      read_row(csv_cells(row), line, columns, model, table, findings);
      continue;
    }
    columns = find_columns(csv_cells(row), model, findings);
    headed = true;
    if (!findings.none()) return false;
  }
  if (!headed) findings.add(1, "the file", "is empty", "write a header and at least one row");
  if (headed && findings.none() && table.time_s.empty())
    findings.add(line, "the file", "has a header and no rows", "write at least one row");
  return findings.none();
}

void unwrap(std::vector<double>& angle) {
  for (std::size_t k = 1; k < angle.size(); ++k)
    angle[k] -= 2 * kPi * std::round((angle[k] - angle[k - 1]) / (2 * kPi));
}

/// Between two rows a quaternion is shorter than one.
void normalise(const tiller_model_t& model, std::vector<double>& rows) {
  for (std::size_t at = 0; at < rows.size(); at += model.state_count)
    for_quaternions(model.quaternion_mask, [&](std::uint32_t first) {
      double* q = &rows[at + first];
      // what is no attitude in the file stays none, and is told so
      if (std::fabs(dot(read_quaternion(q), read_quaternion(q)) - 1) < 0.1)
        write_quaternion(normalised(read_quaternion(q)), q);
    });
}

/// Row k of the result stands k periods after the first row.
std::vector<double> at_periods(const Table& table, const std::vector<std::vector<double>>& columns, double period_s,
                               std::size_t rows) {
  std::vector<double> out;
  out.reserve(rows * columns.size());
  std::size_t after = 1;
  for (std::size_t k = 0; k < rows; ++k) {
    const double time = table.time_s.front() + static_cast<double>(k) * period_s;
    while (after + 1 < table.time_s.size() && table.time_s[after] < time) ++after;
    const std::size_t before = after - 1, last = std::min(after, table.time_s.size() - 1);
    const double length = table.time_s[last] - table.time_s[before];
    const double share = length > 0 ? std::min((time - table.time_s[before]) / length, 1.0) : 0.0;
    for (const std::vector<double>& column : columns)
      out.push_back(column[before] + share * (column[last] - column[before]));
  }
  return out;
}

/// Content of one file, all demonstrations' angles on the same turn at their start.
void take_turns_of(const Trajectory& first, const tiller_model_t& model, Trajectory& other) {
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.angle_mask >> i & 1) == 0) continue;
    const double turns = 2 * kPi * std::round((other.mean[i] - first.mean[i]) / (2 * kPi));
    for (std::size_t k = 0; k < other.rows; ++k) other.mean[k * model.state_count + i] -= turns;
  }
}

/// Inverse of the lower Cholesky factor of `a` (n x n), in its place: W with W' W = inverse of a.
void whiten(std::vector<double>& a, std::size_t n) {
  for (std::size_t j = 0; j < n; ++j) {  // Cholesky, column by column
    for (std::size_t k = 0; k < j; ++k)
      for (std::size_t i = j; i < n; ++i) a[i * n + j] -= a[i * n + k] * a[j * n + k];
    const double root = std::sqrt(a[j * n + j]);
    for (std::size_t i = j; i < n; ++i) a[i * n + j] /= root;
  }
  for (std::size_t j = 0; j < n; ++j) {  // forward substitution of unit vectors
    std::vector<double> x(n, 0.0);
    for (std::size_t i = j; i < n; ++i) {
      double sum = i == j ? 1.0 : 0.0;
      for (std::size_t k = j; k < i; ++k) sum -= a[i * n + k] * x[k];
      x[i] = sum / a[i * n + i];
    }
    for (std::size_t i = 0; i < n; ++i) a[j * n + i] = i < j ? 0.0 : x[i];  // as a row, below: column j is done with
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) std::swap(a[i * n + j], a[j * n + i]);
}

}  // namespace

bool read_trajectory(const std::string& path, const tiller_model_t& model, double period_s, Trajectory& out,
                     Words& errors) {
  Findings findings{path, errors, errors.size()};
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    errors.push_back(path + ": cannot be read: " + std::strerror(errno) +
                     "; relative names start at the robot file's folder");
    return false;
  }
  Table table;
  if (!read_table(file, model, table, findings)) return false;
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (model.angle_mask >> i & 1) unwrap(table.mean[i]);
  take_near_signs(model.quaternion_mask, table.mean);
  const double periods = (table.time_s.back() - table.time_s.front()) / period_s;
  if (periods > kMostTrajectoryPeriods) {
    findings.add(1, "time_s", "goes over " + number_text(std::floor(periods)) + " periods",
                 "write seconds, and at most " + number_text(kMostTrajectoryPeriods) + " periods");
    return false;
  }
  out.rows = static_cast<std::size_t>(std::floor(periods + 1e-6)) + 1;
  out.mean = at_periods(table, table.mean, period_s, out.rows);
  normalise(model, out.mean);
  const bool deviations = !table.sd.front().empty();
  out.sd = deviations ? at_periods(table, table.sd, period_s, out.rows) : std::vector<double>();
  return true;
}

Demonstration estimate_demonstration(const std::vector<Trajectory>& given, const tiller_model_t& model) {
  const std::size_t nx = model.state_count;
  std::vector<Trajectory> runs = given;
  Demonstration out;
  out.rows = runs.front().rows;
  for (Trajectory& run : runs) {
    take_turns_of(runs.front(), model, run);
    out.rows = std::min(out.rows, run.rows);
  }
  std::vector<double> low(nx, INFINITY), high(nx, -INFINITY);
  for (const Trajectory& run : runs)
    for (std::size_t k = 0; k < out.rows * nx; ++k) {
      low[k % nx] = std::min(low[k % nx], run.mean[k]);
      high[k % nx] = std::max(high[k % nx], run.mean[k]);
    }
  const auto count = static_cast<double>(runs.size());
  const double shared = (count - 1) / (count + static_cast<double>(nx));
  for (std::size_t k = 0; k < out.rows; ++k) {
    std::vector<double> mean(nx, 0.0), covariance(nx * nx, 0.0);
    for (const Trajectory& run : runs)
      for (std::size_t i = 0; i < nx; ++i) mean[i] += run.mean[k * nx + i] / count;
    for (const Trajectory& run : runs)
      for (std::size_t i = 0; i < nx; ++i)
        for (std::size_t j = 0; j < nx; ++j)
          covariance[i * nx + j] += (run.mean[k * nx + i] - mean[i]) * (run.mean[k * nx + j] - mean[j]) / (count - 1);
    for (std::size_t i = 0; i < nx; ++i) {
      const double floor = std::max(0.01 * (high[i] - low[i]), 1e-3);
      for (std::size_t j = 0; j < nx; ++j)
        covariance[i * nx + j] = i == j ? covariance[i * nx + i] + floor * floor : shared * covariance[i * nx + j];
    }
    whiten(covariance, nx);
    out.mean.insert(out.mean.end(), mean.begin(), mean.end());
    out.root.insert(out.root.end(), covariance.begin(), covariance.end());
  }
  return out;
}

Demonstration demonstration_of(const Trajectory& distribution, const tiller_model_t& model) {
  const std::size_t nx = model.state_count;
  Demonstration out;
  out.rows = distribution.rows;
  out.mean = distribution.mean;
  out.root.assign(out.rows * nx * nx, 0.0);
  for (std::size_t k = 0; k < out.rows; ++k)
    for (std::size_t i = 0; i < nx; ++i) out.root[(k * nx + i) * nx + i] = 1.0 / distribution.sd[k * nx + i];
  return out;
}

}  // namespace tiller::tools
