#include "tools/import/contact_law.hpp"

#include <algorithm>

namespace tiller::tools {
namespace {

constexpr double kReach_m = 0.001;   // from here on a place begins to push
constexpr double kDeepest_m = 0.02;  // what is deeper in is not thrown out faster
constexpr double kOpen = 1e-6;       // impedance of what does not touch
constexpr int kSweeps = 3;           // of several places
constexpr double kLeastShare = 0.1;  // of a place's own yielding that a pull across may leave (Painleve's case)

/// One direction of one place that joints can move.
struct Row {
  std::size_t place = 0, along = 0;
  std::vector<Expression> reach, response;  // (joints)
  Expression wanted;                        // the acceleration that its forces are to make
  Expression impedance;
  Expression force;
};

/// 1 up to x = 0, 0 from `width` on, level at both ends.
Expression fades(const Expression& x, double width) {
  const Expression t = min(max(Expression(1.0) - x * Expression(1.0 / width), 0.0), 1.0);
  return t * t * (Expression(3.0) - Expression(2.0) * t);
}

/// max(y, 0), in a form that does not lose its digits below 0.
Expression push_only(const Expression& y, double corner_N) {
  const Expression root = sqrt(y * y + Expression(corner_N * corner_N));
  return select(less(0.0, y), (y + root) * Expression(0.5), Expression(0.5 * corner_N * corner_N) / (root + abs(y)));
}

/// What brings a pull across of `size` (of either sign) to `most` or less: half the difference of two hyperbolas.
Expression share_within(const Expression& size, const Expression& most, double corner_N) {
  const Expression above = size + most, below = size - most, corner(corner_N * corner_N);
  return Expression(2.0) * most / (sqrt(above * above + corner) + sqrt(below * below + corner));
}

/// A symmetric positive system by elimination without pivots.
std::vector<Expression> solve_symmetric(std::vector<std::vector<Expression>> a, std::vector<Expression> b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Expression inverse = Expression(1.0) / a[k][k];
    for (std::size_t r = k + 1; r < n; ++r) {
      const Expression factor = a[k][r] * inverse;
      for (std::size_t c = r; c < n; ++c) a[r][c] -= factor * a[k][c];
      b[r] -= factor * b[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t c = k + 1; c < n; ++c) b[k] -= a[k][c] * b[c];
    b[k] = b[k] / a[k][k];
  }
  return b;
}

bool moves(const std::vector<Expression>& reach) {
  return std::any_of(reach.begin(), reach.end(), [](const Expression& r) { return !r.is(0.0); });
}

Expression product(const std::vector<Expression>& a, const std::vector<Expression>& b) {
  Expression sum;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return sum;
}

class Solver {
 public:
  Solver(const std::vector<ContactPair>& pairs, const std::vector<ContactTerms>& terms,
         const std::vector<ContactRows<Expression>>& places, const std::vector<std::vector<Expression>>& inverse,
         const std::vector<Expression>& free)
      : places_(places) {
    for (std::size_t p = 0; p < pairs.size(); ++p)
      for (std::size_t k = 0; k < pairs[p].points.size(); ++k) pair_of_.push_back(p);
    for (std::size_t i = 0; i < places.size(); ++i) add(i, pairs[pair_of_[i]], terms[pair_of_[i]], inverse, free);
    couple();
    if (places.size() > 1) solve_together();
    const int sweeps = places.size() > 1 ? kSweeps : 1;
    for (int sweep = 0; sweep < sweeps; ++sweep)
      for (std::size_t i = 0; i < places.size(); ++i) confine(i, pairs[pair_of_[i]], terms[pair_of_[i]].friction);
  }

  ContactAnswer answer(const std::vector<Expression>& free) const {
    ContactAnswer out;
    out.acceleration = free;
    out.force.assign(3 * places_.size(), 0.0);
    for (const Row& row : rows_) {
      for (std::size_t j = 0; j < free.size(); ++j) out.acceleration[j] += row.response[j] * row.force;
      out.force[3 * row.place + row.along] = row.force;
    }
    for (const ContactRows<Expression>& place : places_) out.gap.push_back(place.gap);
    return out;
  }

 private:
  void add(std::size_t i, const ContactPair& pair, const ContactTerms& terms,
           const std::vector<std::vector<Expression>>& inverse, const std::vector<Expression>& free) {
    const ContactRows<Expression>& place = places_[i];
    const Expression top(pair.law.impedance), time = terms.settle_s;
    Expression whole = top * fades(place.gap, kReach_m);
    if (place.has_edge) whole = whole * fades(place.past_edge, kReach_m);
    const Expression normal = max(whole, kOpen);
    const Expression across = normal / (normal + (Expression(1.0) - normal) * Expression(1.0 / pair.grip_ratio));
    const Expression rate = Expression(2.0 / pair.law.impedance) / time;
    const Expression swing = time * terms.damping_ratio;
    const Expression pull = max(place.gap, -kDeepest_m) * Expression(1.0 / pair.law.impedance) / (swing * swing);
    for (std::size_t k = 0; k < (terms.friction.is(0.0) ? 1u : 3u); ++k) {
      if (!moves(place.reach[k])) continue;
      Row row;
      row.place = i;
      row.along = k;
      row.reach = place.reach[k];
      for (const std::vector<Expression>& line : inverse) row.response.push_back(product(line, row.reach));
      row.wanted = -(rate * place.speed[k]) - place.drift[k] - product(row.reach, free);
      if (k == 0) row.wanted -= pull;
      row.impedance = k == 0 ? normal : across;
      rows_.push_back(row);
    }
  }

  void couple() {
    const std::size_t n = rows_.size();
    coupling_.assign(n, std::vector<Expression>(n));
    for (std::size_t r = 0; r < n; ++r)
      for (std::size_t c = 0; c <= r; ++c)
        coupling_[r][c] = coupling_[c][r] = product(rows_[r].reach, rows_[c].response);
  }

  void solve_together() {
    std::vector<std::vector<Expression>> a = coupling_;
    std::vector<Expression> b;
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      a[r][r] = a[r][r] / rows_[r].impedance;
      b.push_back(rows_[r].wanted);
    }
    const std::vector<Expression> force = solve_symmetric(a, b);
    for (std::size_t r = 0; r < rows_.size(); ++r) rows_[r].force = force[r];
  }

  /// A place's forces, those of the others given: as it sticks where that is within the cone, else at the cone's edge,
  /// across as when it stuck. Of one place with one tangent that is exact.
  void confine(std::size_t place, const ContactPair& pair, const Expression& friction) {
    std::vector<std::size_t> own;
    for (std::size_t r = 0; r < rows_.size(); ++r)
      if (rows_[r].place == place) own.push_back(r);
    if (own.empty()) return;
    std::vector<std::vector<Expression>> a;
    std::vector<Expression> left;
    for (const std::size_t r : own) {
      left.push_back(beside(r, own));
      a.emplace_back();
      for (const std::size_t c : own) a.back().push_back(coupling_[r][c]);
      a.back()[a.size() - 1] = a.back()[a.size() - 1] / rows_[r].impedance;
    }
    Row& normal = rows_[own[0]];
    if (normal.along > 0) {  // no joint moves it along the normal: nothing pushes
      for (const std::size_t r : own) rows_[r].force = 0.0;
      return;
    }
    const Expression ease = Expression(1.0) / coupling_[own[0]][own[0]];
    if (own.size() > 1) slip(own, solve_symmetric(a, left), left[0], ease, pair, friction);
    Expression wish = left[0];
    for (std::size_t k = 1; k < own.size(); ++k) wish -= coupling_[own[0]][own[k]] * rows_[own[k]].force;
    normal.force = push_only(wish * ease, pair.smooth_N) * normal.impedance;
  }

  void slip(const std::vector<std::size_t>& own, const std::vector<Expression>& stuck, const Expression& left,
            const Expression& ease, const ContactPair& pair, const Expression& friction) {
    const double least_N = 0.01 * pair.smooth_N;
    Expression square(least_N * least_N);
    for (std::size_t k = 1; k < own.size(); ++k) square += stuck[k] * stuck[k];
    const Expression size = sqrt(square);
    Expression along;  // how the pull across acts on the normal
    for (std::size_t k = 1; k < own.size(); ++k) along += coupling_[own[0]][own[k]] * stuck[k];
    const Expression impedance = rows_[own[0]].impedance;
    const Expression stiffer = max(Expression(1.0) + friction * impedance * ease * along / size, kLeastShare);
    const Expression push = push_only(left * ease / stiffer, pair.smooth_N) * impedance;
    const Expression share = share_within(size, friction * push, pair.smooth_N);
    for (std::size_t k = 1; k < own.size(); ++k) rows_[own[k]].force = stuck[k] * share;
  }

  /// The acceleration that is wanted of a row beside what the forces of other places make.
  Expression beside(std::size_t r, const std::vector<std::size_t>& own) const {
    Expression left = rows_[r].wanted;
    for (std::size_t c = 0; c < rows_.size(); ++c)
      if (std::find(own.begin(), own.end(), c) == own.end()) left -= coupling_[r][c] * rows_[c].force;
    return left;
  }

  const std::vector<ContactRows<Expression>>& places_;
  std::vector<std::size_t> pair_of_;
  std::vector<Row> rows_;
  std::vector<std::vector<Expression>> coupling_;
};

}  // namespace

ContactAnswer answer_contacts(const std::vector<ContactPair>& pairs, const std::vector<ContactTerms>& terms,
                              const std::vector<ContactRows<Expression>>& rows,
                              const std::vector<std::vector<Expression>>& inverse,
                              const std::vector<Expression>& free) {
  return Solver(pairs, terms, rows, inverse, free).answer(free);
}

}  // namespace tiller::tools
