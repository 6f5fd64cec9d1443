#include "tools/likelihood_free/summary.hpp"

#include <Eigen/Cholesky>

#include "tools/nets/standardise.hpp"

namespace tiller::tools {
namespace {

/// Changes from one end of a period to the next: (ny x periods).
Matrix changes_of(const Matrix& measured, const Vector& start) {
  Matrix changes = measured;
  changes.col(0) -= start;
  changes.rightCols(measured.cols() - 1) -= measured.leftCols(measured.cols() - 1);
  return changes;
}

class CrossCorrelation : public Summary {
 public:
  explicit CrossCorrelation(const std::vector<Piece>& pieces) : pieces_(pieces) {}
  Matrix learn(const Draws& draws) override { return Summary::of(draws.trajectory); }
  bool is_scaled() const override { return false; }

  Vector of(const Trajectory& trajectory) const override {
    const Eigen::Index ny = trajectory[0].rows(), nu = pieces_[0].input.rows();
    Matrix product = Matrix::Zero(ny, nu);
    Vector sum = Vector::Zero(ny), square = Vector::Zero(ny);
    double count = 0.0;
    for (std::size_t p = 0; p < pieces_.size(); ++p) {
      const Matrix changes = changes_of(trajectory[p], pieces_[p].start);
      product += changes * pieces_[p].input.transpose();
      sum += changes.rowwise().sum();
      square += changes.array().square().rowwise().sum().matrix();
      count += static_cast<double>(changes.cols());
    }
    const Vector mean = sum / count;
    Vector out(ny * nu + 2 * ny);
    out << Eigen::Map<const Vector>(product.data(), product.size()) / count, mean,
        square / count - mean.cwiseProduct(mean);
    return out;
  }

 private:
  const std::vector<Piece>& pieces_;
};

/// All values of a trajectory, one after the other.
Vector flat(const Trajectory& trajectory) {
  Eigen::Index size = 0, at = 0;
  for (const Matrix& piece : trajectory) size += piece.size();
  Vector out(size);
  for (const Matrix& piece : trajectory) {
    out.segment(at, piece.size()) = Eigen::Map<const Vector>(piece.data(), piece.size());
    at += piece.size();
  }
  return out;
}

/// The estimate of one linear model: of a trajectory's values, or of its changes.
class Estimate {
 public:
  /// design (n x terms): one, w (d), products; y (n x values). Gives the estimates of y's rows (d x n), each by the
  /// terms that the other rows have.
  Matrix learn(const Matrix& design, Eigen::Index d, const Matrix& y) {
    const Eigen::LDLT<Matrix> squares(design.transpose() * design);
    const Matrix terms = squares.solve(design.transpose() * y);
    const double freedom = std::max(1.0, static_cast<double>(design.rows() - design.cols()));
    const Matrix residual = y - design * terms;
    Vector variance = residual.colwise().squaredNorm().transpose() / freedom;
    // a value that never errs must not have all the say: a millionth of its spread is kept
    const Vector spread = (y.rowwise() - y.colwise().mean()).colwise().squaredNorm().transpose() / freedom;
    variance = variance.cwiseMax(1e-12 * spread).cwiseMax(1e-300);
    const Matrix slope = terms.middleRows(1, d);  // J' (d x values)
    const Matrix weighed = slope * variance.cwiseInverse().asDiagonal();
    Matrix information = weighed * slope.transpose();
    // what a parameter does not move must not make the others' statistics infinite
    information.diagonal().array() += 1e-9 * information.trace() + 1e-300;
    const Eigen::LLT<Matrix> root(information);
    gain_ = root.matrixL().solve(weighed);
    centre_ = terms.row(0).transpose();
    return left_out(design, d, y, residual, variance, squares.solve(design.transpose()), root);
  }
  Vector of(const Vector& y) const { return gain_ * (y - centre_); }

 private:
  /// Least squares without row k has the terms less p_k e_k / (1 - h_k), where p_k = (D' D)^-1 d_k, h_k = d_k' p_k and
  /// e_k is the row's residual; p (terms x n). V and L are those of all rows, of which one is an n-th.
  Matrix left_out(const Matrix& design, Eigen::Index d, const Matrix& y, const Matrix& residual, const Vector& variance,
                  const Matrix& p, const Eigen::LLT<Matrix>& root) const {
    Matrix out(d, y.rows());
    for (Eigen::Index k = 0; k < y.rows(); ++k) {
      const double leverage = std::min(design.row(k).dot(p.col(k)), 1.0 - 1e-6);
      const Vector error = residual.row(k).transpose() / (1.0 - leverage);
      const Vector off = y.row(k).transpose() - centre_ + p(0, k) * error;
      const double shared = error.cwiseQuotient(variance).dot(off);
      out.col(k) = gain_ * off - root.matrixL().solve(p.col(k).segment(1, d) * shared);
    }
    return out;
  }

  Matrix gain_;    // (d x values)
  Vector centre_;  // (values)
};

class LinearEstimate : public Summary {
 public:
  explicit LinearEstimate(const std::vector<Piece>& pieces) : pieces_(pieces) {
    for (const Piece& piece : pieces) has_changes_ = has_changes_ || piece.measured.cols() > 1;
  }
  bool is_scaled() const override { return true; }

  Matrix learn(const Draws& draws) override {
    const Matrix design = design_of(nets::Standardiser::of(draws.v).apply(draws.v).transpose());
    Matrix y(draws.count(), flat(draws.trajectory[0]).size());
    for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) = flat(draws.trajectory[static_cast<std::size_t>(k)]);
    const Matrix values = values_.learn(design, draws.v.rows(), y);
    if (!has_changes_) return values;
    for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) = flat(changes(draws.trajectory[static_cast<std::size_t>(k)]));
    Matrix both(2 * values.rows(), values.cols());
    both << values, changes_.learn(design, draws.v.rows(), y);
    return both;
  }

  Vector of(const Trajectory& trajectory) const override {
    const Vector values = values_.of(flat(trajectory));
    if (!has_changes_) return values;
    Vector both(2 * values.size());
    both << values, changes_.of(flat(changes(trajectory)));
    return both;
  }

 private:
  Trajectory changes(const Trajectory& trajectory) const {
    Trajectory out;
    for (std::size_t p = 0; p < trajectory.size(); ++p) out.push_back(changes_of(trajectory[p], pieces_[p].start));
    return out;
  }
  /// One, w, and where there are ten draws for each term, its products.
  static Matrix design_of(const Matrix& w) {
    const Eigen::Index d = w.cols(), products = d * (d + 1) / 2;
    const bool quadratic = w.rows() >= 10 * (1 + d + products);
    Matrix design(w.rows(), 1 + d + (quadratic ? products : 0));
    design.col(0).setOnes();
    design.middleCols(1, d) = w;
    Eigen::Index at = 1 + d;
    for (Eigen::Index i = 0; quadratic && i < d; ++i)
      for (Eigen::Index j = 0; j <= i; ++j) design.col(at++) = w.col(i).cwiseProduct(w.col(j));
    return design;
  }

  const std::vector<Piece>& pieces_;
  bool has_changes_ = false;  // else values and changes say the same
  Estimate values_, changes_;
};

}  // namespace

Matrix Summary::of(const std::vector<Trajectory>& all) const {
  Matrix out;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Vector one = of(all[k]);
    if (k == 0) out.resize(one.size(), static_cast<Eigen::Index>(all.size()));
    out.col(static_cast<Eigen::Index>(k)) = one;
  }
  return out;
}

Words summary_names() { return {"linear", "cross_correlation", "recurrent"}; }

std::unique_ptr<Summary> make_summary(const std::string& name, const std::vector<Piece>& pieces) {
  if (name == "linear") return std::make_unique<LinearEstimate>(pieces);
  if (name == "cross_correlation") return std::make_unique<CrossCorrelation>(pieces);
  return nullptr;
}

}  // namespace tiller::tools
