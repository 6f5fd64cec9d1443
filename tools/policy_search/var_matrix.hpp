#pragma once

#include <Eigen/Core>
#include <vector>

#include "tools/policy_search/tape.hpp"

namespace tiller::tools::policy {

/// A small matrix of taped numbers, by column.
class VarMatrix {
 public:
  VarMatrix() = default;
  VarMatrix(int rows, int cols) : rows_(rows), cols_(cols), v_(static_cast<std::size_t>(rows * cols)) {}
  /// Fresh variables of these values.
  VarMatrix(Tape& tape, const Eigen::MatrixXd& values);

  int rows() const { return rows_; }
  int cols() const { return cols_; }
  Var& operator()(int i, int j = 0) { return v_[static_cast<std::size_t>(j * rows_ + i)]; }
  const Var& operator()(int i, int j = 0) const { return v_[static_cast<std::size_t>(j * rows_ + i)]; }
  Eigen::MatrixXd values() const;
  /// The derivatives that the tape's sweep found, or finds up to now.
  Eigen::MatrixXd derivatives(const Tape& tape) const;
  /// Within a deferred step alone.
  void add_to(Tape& tape, const Eigen::MatrixXd& derivatives) const;
  VarMatrix transposed() const;
  VarMatrix part(const std::vector<int>& rows, const std::vector<int>& cols) const;

 private:
  int rows_ = 0, cols_ = 0;
  std::vector<Var> v_;
};

VarMatrix operator*(const VarMatrix& a, const VarMatrix& b);
VarMatrix operator+(const VarMatrix& a, const VarMatrix& b);

/// A normal distribution.
struct VarNormal {
  VarMatrix mean;        ///< (n x 1)
  VarMatrix covariance;  ///< (n x n)

  VarNormal() = default;
  explicit VarNormal(int n) : mean(n, 1), covariance(n, n) {}
  int size() const { return mean.rows(); }
  VarNormal part(const std::vector<int>& which) const { return {mean.part(which, {0}), covariance.part(which, which)}; }

 private:
  VarNormal(VarMatrix m, VarMatrix s) : mean(std::move(m)), covariance(std::move(s)) {}
};

/// Of something that depends on a normal input: the input-output covariance is S gain.
struct VarMoments {
  VarMatrix mean, covariance, gain;
};

std::vector<int> range(int from, int to);

}  // namespace tiller::tools::policy
