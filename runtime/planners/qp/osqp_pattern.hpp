#pragma once

#include "planners/qp/osqp_qp.hpp"

namespace tiller {

/// Walks the columns of P (upper triangle) and A in order, and calls visit(row, value) for each entry and next() after
/// each column; values come from `qp`, or are zero without one. The one text of the pattern: counting, filling and
/// updating use it.
class OsqpColumns {
 public:
  explicit OsqpColumns(const OsqpShape& shape)
      : shape_(shape),
        n_(static_cast<int>(shape.sizes.states)),
        m_(static_cast<int>(shape.sizes.inputs)),
        scenarios_(static_cast<int>(shape.sizes.scenarios)),
        horizon_(static_cast<int>(shape.sizes.horizon)),
        s_(n_ * scenarios_) {
    for (int i = 0; i < s_; ++i) {
      if (!bounded(i)) continue;
      soft(i) ? ++soft_count_ : ++hard_count_;
    }
  }
  int slacks() const { return horizon_ * soft_count_; }
  int variables() const { return horizon_ * (m_ + s_) + slacks(); }
  int rows() const { return horizon_ * (s_ + m_ + hard_count_ + 3 * soft_count_); }
  int u_column(int k) const { return k * (m_ + s_); }
  int x_column(int k) const { return (k - 1) * (m_ + s_) + m_; }  // k = 1..N
  int slack_column(int k, int which) const { return horizon_ * (m_ + s_) + (k - 1) * soft_count_ + which; }
  int dynamics_row(int k) const { return k * s_; }  // of x_{k+1}
  int input_row(int k) const { return horizon_ * s_ + k * m_; }
  /// First row of the bounds of state i at stage k: one if hard; x - e, x + e, e if soft.
  int state_row(int k, int i) const {
    int row = horizon_ * (s_ + m_) + (k - 1) * (hard_count_ + 3 * soft_count_);
    for (int j = 0; j < i; ++j) row += bounded(j) ? (soft(j) ? 3 : 1) : 0;
    return row;
  }
  bool bounded(int i) const { return shape_.bounded && shape_.bounded[i]; }
  bool soft(int i) const { return shape_.soft && shape_.soft[i]; }

  template <class Visit, class Next>
  void objective(const Qp* qp, Visit visit, Next next) const {
    for (int k = 0; k < horizon_; ++k) {
      for (int c = 0; c < m_; ++c, next()) {
        for (int j = 0; k > 0 && shape_.sizes.qux && j < scenarios_; ++j)
          for (int r = 0; r < n_; ++r)
            visit(x_column(k) + j * n_ + r, qp && qp->lq.qux ? qp->lq.qux[(k * m_ + c) * s_ + j * n_ + r] : 0.0);
        for (int r = 0; r <= c; ++r)
          if (entry(shape_.quu, r * m_ + c))
            visit(u_column(k) + r,
                  qp ? qp->lq.quu[(k * m_ + r) * m_ + c] + (r == c ? qp->lq.regularisation : 0.0) : 0.0);
      }
      for (int j = 0; j < scenarios_; ++j)
        for (int c = 0; c < n_; ++c, next())
          for (int r = 0; r <= c; ++r)
            if (entry(shape_.qxx, r * n_ + c))
              visit(x_column(k + 1) + j * n_ + r,
                    qp ? qp->lq.qxx[(((k + 1) * scenarios_ + j) * n_ + r) * n_ + c] : 0.0);
    }
    for (int k = 1; k <= horizon_; ++k)
      for (int i = 0; i < s_; ++i)
        if (bounded(i) && soft(i)) {
          visit(slack_column(k, soft_index(i)), qp && qp->slack_quadratic ? qp->slack_quadratic[i] : 0.0);
          next();
        }
  }

  template <class Visit, class Next>
  void constraints(const Qp* qp, Visit visit, Next next) const {
    for (int k = 0; k < horizon_; ++k) {
      for (int c = 0; c < m_; ++c, next()) {
        for (int r = 0; r < s_; ++r)
          if (entry(shape_.b, (r % n_) * m_ + c))
            visit(dynamics_row(k) + r, qp ? -qp->lq.b[(k * s_ + r) * m_ + c] : 0.0);
        visit(input_row(k) + c, 1.0);
      }
      for (int i = 0; i < s_; ++i, next()) {
        visit(dynamics_row(k) + i, 1.0);
        const int j = i / n_, c = i % n_;
        for (int r = 0; k + 1 < horizon_ && r < n_; ++r)
          if (entry(shape_.a, r * n_ + c))
            visit(dynamics_row(k + 1) + j * n_ + r,
                  qp ? -qp->lq.a[(((k + 1) * scenarios_ + j) * n_ + r) * n_ + c] : 0.0);
        if (!bounded(i)) continue;
        visit(state_row(k + 1, i), 1.0);
        if (soft(i)) visit(state_row(k + 1, i) + 1, 1.0);
      }
    }
    for (int k = 1; k <= horizon_; ++k)
      for (int i = 0; i < s_; ++i)
        if (bounded(i) && soft(i)) {
          const int row = state_row(k, i);
          visit(row, -1.0);
          visit(row + 1, 1.0);
          visit(row + 2, 1.0);
          next();
        }
  }
  int soft_index(int i) const {
    int index = 0;
    for (int j = 0; j < i; ++j) index += bounded(j) && soft(j);
    return index;
  }

 private:
  static bool entry(const std::uint8_t* mask, int at) { return !mask || mask[at]; }
  OsqpShape shape_;
  int n_, m_, scenarios_, horizon_, s_;
  int hard_count_ = 0, soft_count_ = 0;
};

}  // namespace tiller
