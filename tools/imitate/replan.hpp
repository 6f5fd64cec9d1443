#pragma once

#include "tools/imitate/likelihood.hpp"

namespace tiller::tools::imitate {

struct ReplanOptions {
  int iterations = 100;
  double tolerance = 1e-9;  ///< relative improvement of the cost at which it ends
};

/// The best motion from `start` under `cost`, from the inputs `guess` (nu x steps) on: iLQR in double precision with
/// the limits of the inputs kept by leaving out what presses against them. `spent` iterations, nullable.
/// Cost: O(iterations steps n^3). What stands for limits on changes is not kept.
Motion replan(const Scene& scene, const tiller_config_t& cost, const Vector& start, const Matrix& guess,
              const ReplanOptions& options = {}, double* value = nullptr);

/// The motion of a receding horizon: at each of `steps` periods the best plan of `horizon` periods, its first input.
/// `guess` (nu x horizon) begins the first plan.
Motion recede(const Scene& scene, const tiller_config_t& cost, const Vector& start, const Matrix& guess,
              Eigen::Index steps);

}  // namespace tiller::tools::imitate
