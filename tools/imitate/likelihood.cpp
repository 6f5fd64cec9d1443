#include "tools/imitate/likelihood.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

/// log of the normal distribution's mass above -z, and its slope.
double log_mass(double z, double& slope) {
  const double density = std::exp(-0.5 * z * z) * 0.3989422804014327;
  if (z > -8) {
    const double mass = 0.5 * std::erfc(-z * 0.7071067811865476);
    slope = density / mass;
    return std::log(mass);
  }
  const double inverse = 1 / (z * z);  // far out the first terms of the asymptotic series
  slope = -z / (1 - inverse + 3 * inverse * inverse);
  return -0.5 * z * z - std::log(-z) - 0.9189385332046727 + std::log1p(-inverse + 3 * inverse * inverse);
}

/// A quadratic in the state, and its derivatives by the parameter of each weight.
struct Value {
  Vector p;
  Matrix P;
  std::vector<Vector> dp;
  std::vector<Matrix> dP;
};

class Sweep {
 public:
  /// `rate` (groups): what a unit of its parameter adds to each weight; without numbers no slopes are made.
  Sweep(const Expansion& e, const Vector& weight, const Vector& rate)
      : e_(e), w_(weight), rate_(rate), groups_(static_cast<std::size_t>(rate.size())), n_(e.n), nu_(e.nu) {}

  void end(Eigen::Index point) {
    v_.p = Vector::Zero(n_);
    v_.P = Matrix::Zero(n_, n_);
    for (std::size_t g = 0; g < e_.groups(); ++g) of(e_.terminal[g], point).add(w_(index(g)), v_.p, v_.P);
    v_.dp.assign(groups_, Vector::Zero(n_));
    v_.dP.assign(groups_, Matrix::Zero(n_, n_));
    for (std::size_t g = 0; g < groups_; ++g) of(e_.terminal[g], point).add(rate_(index(g)), v_.dp[g], v_.dP[g]);
  }

  /// One period back; the policy of its input stands in `gain`, `wish` and `quu` then. False: no positive curvature.
  bool back(Eigen::Index k) {
    expand(k);
    const auto& limit = e_.at_limit[static_cast<std::size_t>(k)];
    free_.clear();
    for (Eigen::Index i = 0; i < nu_; ++i)
      if (limit[static_cast<std::size_t>(i)] == 0 || (planning && limit[static_cast<std::size_t>(i)] * q1_(n_ + i) > 0))
        free_.push_back(static_cast<int>(i));
    const Matrix quu = q2_.bottomRightCorner(nu_, nu_);
    if (!free_.empty() && factor_.compute(pick(quu, free_, free_)).info() != Eigen::Success) return false;
    gain = Matrix::Zero(nu_, n_);
    wish = Vector::Zero(nu_);
    if (!free_.empty()) {
      const Matrix qux = q2_.bottomLeftCorner(nu_, n_);
      const Vector qu = q1_.tail(nu_);
      std::vector<int> all(static_cast<std::size_t>(n_));
      for (Eigen::Index i = 0; i < n_; ++i) all[static_cast<std::size_t>(i)] = static_cast<int>(i);
      const Matrix k_free = -factor_.solve(pick(qux, free_, all));
      const Vector wish_free = -factor_.solve(pick(qu, free_));
      for (std::size_t r = 0; r < free_.size(); ++r) {
        gain.row(free_[r]) = k_free.row(static_cast<Eigen::Index>(r));
        wish(free_[r]) = wish_free(static_cast<Eigen::Index>(r));
      }
    }
    contract();
    return true;
  }

  /// Adds the log likelihood of the input of the period that back() has just taken.
  void judge(Eigen::Index k, Likelihood& sum) const {
    judge_free(sum);
    const auto& limit = e_.at_limit[static_cast<std::size_t>(k)];
    for (Eigen::Index i = 0; i < nu_; ++i)
      if (limit[static_cast<std::size_t>(i)] != 0) judge_limited(i, limit[static_cast<std::size_t>(i)], sum);
  }

  Matrix gain;
  Vector wish;
  bool planning = false;  // an input at a limit whose cost falls away from there is free
  Matrix quu() const { return q2_.bottomRightCorner(nu_, nu_); }

 private:
  static Eigen::Index index(std::size_t g) { return static_cast<Eigen::Index>(g); }
  static const SparseQuadratic& of(const std::vector<SparseQuadratic>& list, Eigen::Index k) {
    return list[static_cast<std::size_t>(k)];
  }
  static Matrix pick(const Matrix& m, const std::vector<int>& rows, const std::vector<int>& columns) {
    Matrix out(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns.size()));
    for (Eigen::Index r = 0; r < out.rows(); ++r)
      for (Eigen::Index c = 0; c < out.cols(); ++c)
        out(r, c) = m(rows[static_cast<std::size_t>(r)], columns[static_cast<std::size_t>(c)]);
    return out;
  }
  static Vector pick(const Vector& v, const std::vector<int>& rows) {
    Vector out(static_cast<Eigen::Index>(rows.size()));
    for (Eigen::Index r = 0; r < out.size(); ++r) out(r) = v(rows[static_cast<std::size_t>(r)]);
    return out;
  }

  /// Q of the period, from the value behind it.
  void expand(Eigen::Index k) {
    const Matrix& f = e_.f[static_cast<std::size_t>(k)];
    const auto defect = e_.defect.col(k);
    q1_ = f.transpose() * (v_.p + v_.P * defect);
    q2_ = f.transpose() * v_.P * f;
    for (std::size_t g = 0; g < e_.groups(); ++g) of(e_.stage[g], k).add(w_(index(g)), q1_, q2_);
    dq1_.resize(groups_);
    dq2_.resize(groups_);
    for (std::size_t g = 0; g < groups_; ++g) {
      dq1_[g] = f.transpose() * (v_.dp[g] + v_.dP[g] * defect);
      dq2_[g] = f.transpose() * v_.dP[g] * f;
      of(e_.stage[g], k).add(rate_(index(g)), dq1_[g], dq2_[g]);
    }
  }

  /// The value of the period's state. The input minimises Q, so that its own answer to the weights has no say.
  void contract() {
    Matrix m(n_ + nu_, n_);
    m << Matrix::Identity(n_, n_), gain;
    Vector z = Vector::Zero(n_ + nu_);
    z.tail(nu_) = wish;
    v_.p = m.transpose() * (q1_ + q2_ * z);
    v_.P = m.transpose() * q2_ * m;
    for (std::size_t g = 0; g < groups_; ++g) {
      v_.dp[g] = m.transpose() * (dq1_[g] + dq2_[g] * z);
      v_.dP[g] = m.transpose() * dq2_[g] * m;
    }
  }

  void judge_free(Likelihood& sum) const {
    if (free_.empty()) return;
    const auto count = static_cast<Eigen::Index>(free_.size());
    const Vector qu = pick(Vector(q1_.tail(nu_)), free_), k = pick(wish, free_);
    const Matrix root = factor_.matrixL();
    sum.value +=
        root.diagonal().array().log().sum() + 0.5 * qu.dot(k) - 0.9189385332046727 * static_cast<double>(count);
    sum.inputs += count;
    // columns: how the mean moves with each weight, and how the covariance does, in the covariance's own units
    Matrix mean(count, index(groups_)), shape(count * count, index(groups_));
    for (std::size_t g = 0; g < groups_; ++g) {
      const Matrix duu = pick(Matrix(dq2_[g].bottomRightCorner(nu_, nu_)), free_, free_);
      const Vector du = pick(Vector(dq1_[g].tail(nu_)), free_);
      Matrix scaled = factor_.matrixL().solve(duu);
      scaled = factor_.matrixL().solve(Matrix(scaled.transpose())).eval();
      sum.gradient(index(g)) += 0.5 * scaled.trace() + k.dot(du) + 0.5 * k.dot(duu * k);
      mean.col(index(g)) = factor_.matrixL().solve(Vector(du + duu * k));
      shape.col(index(g)) = Eigen::Map<const Vector>(scaled.data(), count * count);
    }
    sum.information += mean.transpose() * mean + 0.5 * shape.transpose() * shape;
  }

  /// Input i given the other limited ones where they are, the free ones at their best.
  void judge_limited(Eigen::Index i, int side, Likelihood& sum) const {
    Vector along = Vector::Zero(n_ + nu_), at = Vector::Zero(n_ + nu_);
    along(n_ + i) = 1;
    at.tail(nu_) = wish;
    if (!free_.empty()) {
      const Matrix all = quu();
      const Vector answer = -factor_.solve(pick(Vector(all.col(i)), free_));
      for (std::size_t r = 0; r < free_.size(); ++r) along(n_ + free_[r]) = answer(static_cast<Eigen::Index>(r));
    }
    const double q = along.dot(q1_ + q2_ * at), h = along.dot(q2_ * along), root = std::sqrt(h);
    double slope = 0;
    sum.value += log_mass(-side * q / root, slope);
    ++sum.limited;
    Vector score(index(groups_));
    for (std::size_t g = 0; g < groups_; ++g) {
      const double dq = along.dot(dq1_[g] + dq2_[g] * at), dh = along.dot(dq2_[g] * along);
      score(index(g)) = -side * slope * (dq / root - 0.5 * q * dh / (h * root));
    }
    sum.gradient += score;
    sum.information += score * score.transpose();
  }

  const Expansion& e_;
  const Vector& w_;
  const Vector& rate_;
  std::size_t groups_;
  Eigen::Index n_, nu_;
  Value v_;
  Vector q1_;
  Matrix q2_;
  std::vector<Vector> dq1_;
  std::vector<Matrix> dq2_;
  std::vector<int> free_;
  Eigen::LLT<Matrix> factor_;
};

void judge_window(const Expansion& e, const Vector& weight, const Vector& rate, Eigen::Index first, Eigen::Index last,
                  bool all, Likelihood& sum) {
  Sweep sweep(e, weight, rate);
  sweep.end(last);
  for (Eigen::Index k = last; k-- > first && sum.good;) {
    sum.good = sweep.back(k);
    if (sum.good && (all || k == first)) sweep.judge(k, sum);
  }
}

}  // namespace

void add_likelihood(const Expansion& e, const Vector& weight, const Foresight& foresight, Likelihood& sum) {
  add_likelihood(e, weight, weight, foresight, sum);
}

void add_likelihood(const Expansion& e, const Vector& weight, const Vector& rate, const Foresight& foresight,
                    Likelihood& sum) {
  const Eigen::Index horizon = foresight.horizon;
  if (horizon == 0) return judge_window(e, weight, rate, 0, e.steps, true, sum);
  for (Eigen::Index k = 0; k + horizon <= e.steps && sum.good; k += foresight.every)
    judge_window(e, weight, rate, k, k + horizon, false, sum);
}

Policy policy_along(const Expansion& e, const Vector& weight, bool planning) {
  Policy policy;
  policy.gain.resize(static_cast<std::size_t>(e.steps));
  policy.wish.resize(policy.gain.size());
  policy.precision.resize(policy.gain.size());
  const Vector none;
  Sweep sweep(e, weight, none);
  sweep.planning = planning;
  sweep.end(e.steps);
  for (Eigen::Index k = e.steps; k-- > 0;) {
    if (!sweep.back(k)) return {};
    const auto at = static_cast<std::size_t>(k);
    policy.gain[at] = sweep.gain;
    policy.wish[at] = sweep.wish;
    policy.precision[at] = sweep.quu();
  }
  return policy;
}

}  // namespace tiller::tools::imitate
