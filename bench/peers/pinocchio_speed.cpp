// pinocchio_speed MODEL (as pinocchio saves it): nanoseconds of pinocchio's own ABA and Euler step, one robot, one
// thread. Compiled by robots.py against the headers and libraries in pinocchio's wheel; not part of the CMake build.

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/serialization.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <vector>

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  pinocchio::Model model;
  model.loadFromText(argv[1]);
  pinocchio::Data data(model);
  std::vector<double> rounds;
  for (int round = 0; round < 9; ++round) {
    Eigen::VectorXd q = pinocchio::neutral(model), v = Eigen::VectorXd::Constant(model.nv, 0.1), next = q;
    const Eigen::VectorXd force = Eigen::VectorXd::LinSpaced(model.nv, 0.0, 0.3 * (model.nv - 1));
    constexpr int kSteps = 20000;
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < kSteps; ++k) {
      const Eigen::VectorXd& a = pinocchio::aba(model, data, q, v, force);
      q.noalias() += 1e-4 * v.head(q.size());
      v.noalias() += 1e-4 * a;
    }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    rounds.push_back(spent.count() / kSteps);
  }
  std::sort(rounds.begin(), rounds.end());
  std::printf("{\"pinocchio\": %.5g}\n", rounds[rounds.size() / 2]);
  return 0;
}
