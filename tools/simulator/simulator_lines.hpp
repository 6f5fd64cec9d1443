#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// Version of the lines; both sides say theirs first.
constexpr int kLinesVersion = 1;

/// What a simulator has to know before the first request: the meaning of the lists in each.
struct SimulatorNames {
  Words parameters, inputs, measurements;
  double period_s = 0.0;
};

/// One simulation that is asked for.
struct SimulationRequest {
  std::vector<double> parameters;  ///< by SimulatorNames, in SI units
  std::vector<double> start;       ///< (ny) measured values at the beginning
  std::vector<double> inputs;      ///< (periods x nu) held over each period
  std::uint64_t seed = 0;          ///< for simulators that draw random numbers, below 2^53
  std::size_t periods = 0;
};

/// What became of one.
struct SimulationAnswer {
  std::vector<double> measured;  ///< (periods x ny) at the end of each period; empty: it failed
  std::string failure;           ///< why; empty: it did not
};

/// The first line to a simulator, its end included:
/// {"tiller_simulator":1,"parameters":["friction"],"inputs":["force_N"],"measurements":["position_m"],"period_s":0.02}
std::string hello_line(const SimulatorNames& names);
/// {"id":7,"seed":1,"parameters":[0.3],"start":[0.0],"inputs":[[1.0],[1.0]]}
std::string request_line(std::uint64_t id, const SimulationRequest& request);

/// Whether a line is {"tiller_simulator":1}; else a sentence in `error`.
bool check_hello(const std::string& line, std::string& error);
/// Reads {"id":7,"measured":[[0.0],[0.1]]} or {"id":7,"error":"..."}. An error and values that are not finite (NaN,
/// null, Infinity) are failures of that simulation. False with a sentence in `error` where the line is no answer to
/// request `id` of `request.periods` rows of `ny` values: then the program is wrong, and not the parameters.
bool read_answer(const std::string& line, std::uint64_t id, const SimulationRequest& request, std::size_t ny,
                 SimulationAnswer& out, std::string& error);

/// A line as an error shows it: control characters replaced, cut after 160 characters.
std::string shown_line(const std::string& line);

}  // namespace tiller::tools
