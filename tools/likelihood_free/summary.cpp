#include "tools/likelihood_free/summary.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>

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
  void learn(const Draws&) override {}
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
  /// design (n x terms): one, w (d), products; y (n x values).
  void learn(const Matrix& design, Eigen::Index d, const Matrix& y) {
    const Matrix terms = design.colPivHouseholderQr().solve(y);
    const double freedom = std::max(1.0, static_cast<double>(design.rows() - design.cols()));
    Vector variance = (y - design * terms).colwise().squaredNorm().transpose() / freedom;
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
  }
  Vector of(const Vector& y) const { return gain_ * (y - centre_); }

 private:
  Matrix gain_;    // (d x values)
  Vector centre_;  // (values)
};

class LinearEstimate : public Summary {
 public:
  explicit LinearEstimate(const std::vector<Piece>& pieces) : pieces_(pieces) {
    for (const Piece& piece : pieces) has_changes_ = has_changes_ || piece.measured.cols() > 1;
  }
  bool is_scaled() const override { return true; }

  void learn(const Draws& draws) override {
    const Matrix design = design_of(nets::Standardiser::of(draws.v).apply(draws.v).transpose());
    Matrix y(draws.count(), flat(draws.trajectory[0]).size());
    for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) = flat(draws.trajectory[static_cast<std::size_t>(k)]);
    values_.learn(design, draws.v.rows(), y);
    if (!has_changes_) return;
    for (Eigen::Index k = 0; k < y.rows(); ++k) y.row(k) = flat(changes(draws.trajectory[static_cast<std::size_t>(k)]));
    changes_.learn(design, draws.v.rows(), y);
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
