#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bench/posterior/paper_tasks.hpp"
#include "tools/likelihood_free/inference.hpp"
#include "tools/simulator/simulator_file.hpp"

namespace tiller::bench {

/// A row of Table I as a black box: pieces of one period, each from its measured state, and a simulator that adds the
/// noise of the transitions itself. The data are those that the exact posterior has.
class PaperBox {
 public:
  PaperBox(const PaperTask& paper, double sigma, std::uint64_t seed);
  PaperBox(const PaperBox&) = delete;
  PaperBox& operator=(const PaperBox&) = delete;

  tools::InferenceProblem& problem() { return problem_; }
  const Episode& episode() const { return episode_; }

 private:
  void simulate(const std::vector<tools::Ask>& asks, std::vector<tools::Simulated>& answers) const;
  const AccuracyTask& task_;
  double sigma_;
  Episode episode_;
  Config config_;
  StepSetup setup_;
  tools::InferenceProblem problem_;
};

/// A machine in MuJoCo, behind the lines of docs/guide/simulator.md: truth drawn from the prior, data by the simulator
/// itself with the sensors' noise.
class MujocoBox {
 public:
  /// "puck" or "hopper". `python` has the package mujoco.
  MujocoBox(const std::string& machine, const std::string& python, std::uint64_t seed);
  /// False with a sentence in `error`.
  bool make_data(std::string& error);
  tools::InferenceProblem& problem() { return problem_; }
  /// Ends the simulator; nothing can be simulated any more.
  void close() { pool_.reset(); }
  double truth() const { return truth_; }

 private:
  std::unique_ptr<tools::SimulatorFile> file_;
  std::unique_ptr<tools::SimulatorPool> pool_;
  tools::InferenceProblem problem_;
  std::uint64_t seed_;
  double truth_ = 0;
  bool is_puck_;
};

}  // namespace tiller::bench
