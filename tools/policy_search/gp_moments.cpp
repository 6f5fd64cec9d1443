#include "tools/policy_search/gp_moments.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace tiller::tools::policy {
namespace {

/// What the mean of one output is made of. q_i = E[k(x, x_i)] at x ~ N(m, S).
struct MeanParts {
  Matrix t;  // (S + L)^-1
  Matrix q_by_x;
  Vector q, weighted;  // (n) q and beta q
  Vector h;            // (inputs) sum beta q zeta
};

Vector inverse_squares(const Bumps& b, Eigen::Index a) { return (-2.0 * b.log_length.col(a).array()).exp().matrix(); }

MeanParts mean_parts(const Bumps& bumps, Eigen::Index a, const Matrix& zeta, const Matrix& s) {
  MeanParts p;
  Matrix sum = s;
  sum.diagonal().array() += (2.0 * bumps.log_length.col(a).array()).exp();
  const Eigen::LLT<Matrix> factor(sum);
  p.t = factor.solve(Matrix::Identity(s.rows(), s.rows()));
  const double log_scale =
      2.0 * bumps.log_signal(a) + bumps.log_length.col(a).sum() - factor.matrixLLT().diagonal().array().log().sum();
  p.q_by_x.noalias() = p.t * zeta;
  const Eigen::RowVectorXd exponent = (zeta.array() * p.q_by_x.array()).colwise().sum();
  p.q = (log_scale - 0.5 * exponent.array()).exp().matrix().transpose();
  p.weighted = p.q.cwiseProduct(bumps.beta.col(a));
  p.h.noalias() = zeta * p.weighted;
  return p;
}

/// What the covariance of two outputs is made of: Q_ij = E[k_a(x, x_i) k_b(x, x_j)].
struct PairParts {
  Vector inverse_a, inverse_b;  // diagonals of L^-1
  Matrix a, b;                  // (inputs x n) L^-1 zeta
  Matrix r_inverse, u;          // R = I + S P, P = L_a^-1 + L_b^-1; U = R^-1 S
  Matrix q;                     // (n x n)
};

Vector log_kernel_at(const Bumps& bumps, Eigen::Index a, const Matrix& zeta, const Matrix& scaled) {
  const Eigen::RowVectorXd exponent = (zeta.array() * scaled.array()).colwise().sum();
  return (2.0 * bumps.log_signal(a) - 0.5 * exponent.array()).matrix().transpose();
}

PairParts pair_parts(const Bumps& bumps, Eigen::Index a, Eigen::Index b, const Matrix& zeta, const Matrix& s) {
  PairParts p;
  p.inverse_a = inverse_squares(bumps, a);
  p.inverse_b = inverse_squares(bumps, b);
  p.a = p.inverse_a.asDiagonal() * zeta;
  p.b = p.inverse_b.asDiagonal() * zeta;
  const Matrix r = Matrix::Identity(s.rows(), s.rows()) + s * (p.inverse_a + p.inverse_b).asDiagonal();
  const Eigen::PartialPivLU<Matrix> lu(r);
  p.r_inverse = lu.inverse();
  p.u = p.r_inverse * s;
  p.u = 0.5 * (p.u + p.u.transpose()).eval();
  const Matrix ua = p.u * p.a, ub = p.u * p.b;
  const Vector row = log_kernel_at(bumps, a, zeta, p.a) + 0.5 * (p.a.cwiseProduct(ua)).colwise().sum().transpose() -
                     Vector::Constant(zeta.cols(), 0.5 * std::log(lu.determinant()));
  const Vector column = log_kernel_at(bumps, b, zeta, p.b) + 0.5 * (p.b.cwiseProduct(ub)).colwise().sum().transpose();
  p.q.noalias() = p.a.transpose() * ub;
  for (Eigen::Index j = 0; j < p.q.cols(); ++j) p.q.col(j) = (p.q.col(j) + row).array().exp() * std::exp(column(j));
  return p;
}

/// Derivatives of one output's mean and gain; `by_mean` is the whole derivative with respect to the mean.
void mean_adjoint(const Bumps& bumps, Eigen::Index a, const Matrix& zeta, const MeanParts& p, double by_mean,
                  const Vector& by_gain, InputDerivative& out, BumpsDerivative* own) {
  const Vector by_h = p.t * by_gain;
  const Vector by_weighted = (zeta.transpose() * by_h).array() + by_mean;
  const Vector g = by_weighted.cwiseProduct(p.weighted);  // with respect to log q
  Matrix by_zeta = by_h * p.weighted.transpose() - p.q_by_x * g.asDiagonal();
  Matrix by_t = by_gain * p.h.transpose() - 0.5 * zeta * g.asDiagonal() * zeta.transpose();
  by_t = 0.5 * (by_t + by_t.transpose()).eval();
  const Matrix by_sum = -p.t * by_t * p.t - 0.5 * g.sum() * p.t;
  out.mean -= by_zeta.rowwise().sum();
  out.covariance += by_sum;
  if (!own) return;
  own->x += by_zeta;
  own->beta.col(a) += by_weighted.cwiseProduct(p.q);
  const Vector squares = (2.0 * bumps.log_length.col(a).array()).exp().matrix();
  own->log_length.col(a) += 2.0 * by_sum.diagonal().cwiseProduct(squares);
  own->log_length.col(a).array() += g.sum();
}

/// The derivatives through the pair's points and lengths; g are those with respect to log Q.
void pair_own_adjoint(const PairParts& p, Eigen::Index a, Eigen::Index b, const Matrix& zeta, const Matrix& g,
                      const Vector& row, const Vector& column, const Matrix& moment, BumpsDerivative& own) {
  const Matrix by_a = p.u * (p.a * row.asDiagonal() + p.b * g.transpose());
  const Matrix by_b = p.u * (p.b * column.asDiagonal() + p.a * g);
  own.x += p.inverse_a.asDiagonal() * by_a + p.inverse_b.asDiagonal() * by_b - p.a * row.asDiagonal() -
           p.b * column.asDiagonal();
  own.log_length.col(a) +=
      (-2.0 * by_a.cwiseProduct(p.a) + (p.a.cwiseProduct(zeta) * row.asDiagonal())).rowwise().sum();
  own.log_length.col(b) +=
      (-2.0 * by_b.cwiseProduct(p.b) + (p.b.cwiseProduct(zeta) * column.asDiagonal())).rowwise().sum();
  const Vector by_p = (-0.5 * p.u * moment * p.u - 0.5 * row.sum() * p.u).diagonal();
  own.log_length.col(a) -= 2.0 * by_p.cwiseProduct(p.inverse_a);
  own.log_length.col(b) -= 2.0 * by_p.cwiseProduct(p.inverse_b);
}

/// Derivatives of scale * (beta_a' Q beta_b - [a = b] tr(W Q)).
void pair_adjoint(const Bumps& bumps, Eigen::Index a, Eigen::Index b, const Matrix& zeta, const Matrix& s, double scale,
                  InputDerivative& out, BumpsDerivative* own) {
  const PairParts p = pair_parts(bumps, a, b, zeta, s);
  Matrix g(p.q.rows(), p.q.cols());
  for (Eigen::Index j = 0; j < g.cols(); ++j) {
    g.col(j) = (scale * bumps.beta(j, b)) * bumps.beta.col(a);
    if (a == b && !bumps.w.empty()) g.col(j) -= scale * bumps.w[static_cast<std::size_t>(a)].col(j);
    g.col(j) = g.col(j).cwiseProduct(p.q.col(j));
  }
  const Vector row = g.rowwise().sum(), column = g.colwise().sum().transpose();
  const Vector slope = p.a * row + p.b * column;
  const Matrix cross = p.a * (g * p.b.transpose());
  const Matrix moment = p.a * row.asDiagonal() * p.a.transpose() + p.b * column.asDiagonal() * p.b.transpose() + cross +
                        cross.transpose();
  out.mean += p.r_inverse.transpose() * slope;
  out.covariance += 0.5 * p.r_inverse.transpose() * moment * p.r_inverse -
                    0.5 * row.sum() * (p.inverse_a + p.inverse_b).asDiagonal() * p.r_inverse;
  if (!own) return;
  own->beta.col(a) += scale * (p.q * bumps.beta.col(b));
  own->beta.col(b) += scale * (p.q.transpose() * bumps.beta.col(a));
  pair_own_adjoint(p, a, b, zeta, g, row, column, moment, *own);
}

}  // namespace

Moments bump_moments(const Bumps& bumps, const Vector& m, const Matrix& s) {
  const Eigen::Index outputs = bumps.outputs();
  const Matrix zeta = bumps.x.colwise() - m;
  Moments out{Vector(outputs), Matrix(outputs, outputs), Matrix(bumps.inputs(), outputs)};
  for (Eigen::Index a = 0; a < outputs; ++a) {
    const MeanParts p = mean_parts(bumps, a, zeta, s);
    out.mean(a) = p.weighted.sum();
    out.gain.col(a) = p.t * p.h;
  }
  for (Eigen::Index a = 0; a < outputs; ++a)
    for (Eigen::Index b = a; b < outputs; ++b) {
      const PairParts p = pair_parts(bumps, a, b, zeta, s);
      double value = bumps.beta.col(a).dot(p.q * bumps.beta.col(b)) - out.mean(a) * out.mean(b);
      if (a == b && !bumps.w.empty())
        value += std::exp(2.0 * bumps.log_signal(a)) - bumps.w[static_cast<std::size_t>(a)].cwiseProduct(p.q).sum();
      out.covariance(a, b) = out.covariance(b, a) = value;
    }
  return out;
}

void bump_values(const Bumps& bumps, const Vector& x, Vector& mean, Vector* variance) {
  mean.resize(bumps.outputs());
  if (variance) *variance = Vector::Zero(bumps.outputs());
  const Matrix zeta = bumps.x.colwise() - x;
  for (Eigen::Index a = 0; a < bumps.outputs(); ++a) {
    const Vector k = log_kernel_at(bumps, a, zeta, inverse_squares(bumps, a).asDiagonal() * zeta).array().exp();
    mean(a) = k.dot(bumps.beta.col(a));
    if (variance && !bumps.w.empty())
      (*variance)(a) = std::exp(2.0 * bumps.log_signal(a)) - k.dot(bumps.w[static_cast<std::size_t>(a)] * k);
  }
}

InputDerivative bump_adjoint(const Bumps& bumps, const Vector& m, const Matrix& s, const Moments& by,
                             BumpsDerivative* bumps_derivative) {
  const Eigen::Index outputs = bumps.outputs();
  const Matrix zeta = bumps.x.colwise() - m;
  InputDerivative out{Vector::Zero(m.size()), Matrix::Zero(s.rows(), s.cols())};
  const Matrix both = 0.5 * (by.covariance + by.covariance.transpose());
  std::vector<MeanParts> parts;
  Vector mean(outputs);
  for (Eigen::Index a = 0; a < outputs; ++a) {
    parts.push_back(mean_parts(bumps, a, zeta, s));
    mean(a) = parts.back().weighted.sum();
  }
  const Vector by_mean = by.mean - 2.0 * both * mean;
  for (Eigen::Index a = 0; a < outputs; ++a) {
    mean_adjoint(bumps, a, zeta, parts[static_cast<std::size_t>(a)], by_mean(a), by.gain.col(a), out, bumps_derivative);
    for (Eigen::Index b = a; b < outputs; ++b)
      pair_adjoint(bumps, a, b, zeta, s, (a == b ? 1.0 : 2.0) * both(a, b), out, bumps_derivative);
  }
  return out;
}

}  // namespace tiller::tools::policy
