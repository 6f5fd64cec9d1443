#pragma once

#include <map>
#include <string>
#include <vector>

namespace tiller::bench {

/// One seed of one way on one task.
struct SimulatorLine {
  double exact = 0, log_density = 0;  ///< at the truth, nats; NaN where there is no exact posterior
  double mean_off = 0, sd_ratio = 0;  ///< against the exact posterior, in its deviations; NaN as above
  double inside = 0;                  ///< share of the parameters whose 90 % interval holds the truth
  double seconds = 0, simulations = 0;
  double width = 0;  ///< deviation over the prior's, the geometric mean
};

/// build/bench_simulator.csv: a line per task, way and seed, so that a cut run goes on.
class SimulatorRows {
 public:
  /// Reads what is there; a line that was cut is left out.
  explicit SimulatorRows(std::string path);
  bool has(const std::string& task, const std::string& way, unsigned seed) const;
  void add(const std::string& task, const std::string& way, unsigned seed, const SimulatorLine& line);
  /// Of seeds first .. last, in their order.
  std::vector<SimulatorLine> of(const std::string& task, const std::string& way, unsigned first, unsigned last) const;

 private:
  std::string path_;
  std::map<std::string, std::map<unsigned, SimulatorLine>> rows_;  // by "task/way", by seed
};

}  // namespace tiller::bench
