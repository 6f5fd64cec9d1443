#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tools/simulator/simulator_lines.hpp"

namespace tiller::tools {

/// How simulators are run.
struct SimulatorSetup {
  Words command;            ///< argv, without a shell
  std::string folder;       ///< that it runs in; empty: this process's
  SimulatorNames names;     ///< what the lists of each request mean
  double timeout_s = 10.0;  ///< of one answer, > 0
  double start_s = 60.0;    ///< until the greeting, > 0
  unsigned processes = 1;   ///< side by side, at least 1
  unsigned restarts = 20;   ///< in all, after a death or a time-out
  unsigned ahead = 2;       ///< requests that each is given before it has answered, at least 1
};

/// A black-box simulator as N processes that answer requests over stdin and stdout (docs/guide/simulator.md).
///
/// A simulation fails where its answer is an error or not finite, where the process died, or where it was late: then
/// the process is killed and started anew, and the requests behind go to another one. What fails stands in its answer,
/// and nothing else stops. Answers do not depend on the number of processes, if the simulator is a function of its
/// requests.
class SimulatorPool {
 public:
  explicit SimulatorPool(SimulatorSetup setup);
  ~SimulatorPool();
  SimulatorPool(const SimulatorPool&) = delete;
  SimulatorPool& operator=(const SimulatorPool&) = delete;

  /// Answers to all requests, in their order. False with a sentence in `error`, the line shown, where the program does
  /// not speak the protocol, cannot be started, or has used up its restarts. `progress` (nullable) is told the share
  /// done.
  bool run(const std::vector<SimulationRequest>& requests, std::vector<SimulationAnswer>& answers, std::string& error,
           const std::function<void(double)>& progress = {});

  unsigned restarts() const { return restarts_; }  ///< used so far

 private:
  struct Worker;
  struct Batch;
  bool begin(Worker& worker, std::string& error);
  bool feed(Worker& worker, Batch& batch, std::string& error);
  bool listen(Worker& worker, Batch& batch, std::string& error);
  bool take_line(Worker& worker, const std::string& line, Batch& batch, std::string& error);
  bool lose(Worker& worker, Batch& batch, const std::string& why, std::string& error);
  bool check_clock(Worker& worker, Batch& batch, std::string& error);
  int wait(double longest_s);

  SimulatorSetup setup_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::uint64_t next_id_ = 1;
  unsigned restarts_ = 0;
};

}  // namespace tiller::tools
