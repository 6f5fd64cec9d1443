#include "tools/policy_search/var_matrix.hpp"

namespace tiller::tools::policy {

VarMatrix::VarMatrix(Tape& tape, const Eigen::MatrixXd& values)
    : VarMatrix(static_cast<int>(values.rows()), static_cast<int>(values.cols())) {
  for (int j = 0; j < cols_; ++j)
    for (int i = 0; i < rows_; ++i) (*this)(i, j) = tape.variable(values(i, j));
}

Eigen::MatrixXd VarMatrix::values() const {
  Eigen::MatrixXd out(rows_, cols_);
  for (int j = 0; j < cols_; ++j)
    for (int i = 0; i < rows_; ++i) out(i, j) = (*this)(i, j).value;
  return out;
}

Eigen::MatrixXd VarMatrix::derivatives(const Tape& tape) const {
  Eigen::MatrixXd out(rows_, cols_);
  for (int j = 0; j < cols_; ++j)
    for (int i = 0; i < rows_; ++i) out(i, j) = tape.derivative((*this)(i, j));
  return out;
}

void VarMatrix::add_to(Tape& tape, const Eigen::MatrixXd& derivatives) const {
  for (int j = 0; j < cols_; ++j)
    for (int i = 0; i < rows_; ++i) tape.add((*this)(i, j), derivatives(i, j));
}

VarMatrix VarMatrix::transposed() const {
  VarMatrix out(cols_, rows_);
  for (int j = 0; j < cols_; ++j)
    for (int i = 0; i < rows_; ++i) out(j, i) = (*this)(i, j);
  return out;
}

VarMatrix VarMatrix::part(const std::vector<int>& rows, const std::vector<int>& cols) const {
  VarMatrix out(static_cast<int>(rows.size()), static_cast<int>(cols.size()));
  for (int j = 0; j < out.cols(); ++j)
    for (int i = 0; i < out.rows(); ++i)
      out(i, j) = (*this)(rows[static_cast<std::size_t>(i)], cols[static_cast<std::size_t>(j)]);
  return out;
}

VarMatrix operator*(const VarMatrix& a, const VarMatrix& b) {
  VarMatrix out(a.rows(), b.cols());
  for (int j = 0; j < b.cols(); ++j)
    for (int i = 0; i < a.rows(); ++i)
      for (int k = 0; k < a.cols(); ++k) out(i, j) += a(i, k) * b(k, j);
  return out;
}

VarMatrix operator+(const VarMatrix& a, const VarMatrix& b) {
  VarMatrix out(a.rows(), a.cols());
  for (int j = 0; j < a.cols(); ++j)
    for (int i = 0; i < a.rows(); ++i) out(i, j) = a(i, j) + b(i, j);
  return out;
}

std::vector<int> range(int from, int to) {
  std::vector<int> out;
  for (int i = from; i < to; ++i) out.push_back(i);
  return out;
}

}  // namespace tiller::tools::policy
