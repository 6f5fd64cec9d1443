#include "executive/demonstration_divergence.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/cost.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

/// Lower Cholesky factor (n x n) of a symmetric matrix, zeros above; false where it has none.
bool factorise(std::uint32_t n, const double* matrix, double* factor) {
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c) {
      double sum = c > r ? 0.0 : matrix[r * n + c];
      for (std::uint32_t i = 0; i < c && c <= r; ++i) sum -= factor[r * n + i] * factor[c * n + i];
      if (c == r && !(sum > 0.0 && std::isfinite(sum))) return false;
      factor[r * n + c] = c > r ? 0.0 : c == r ? std::sqrt(sum) : sum / factor[c * n + c];
    }
  return true;
}

/// Inverse of a lower triangular matrix.
void invert_lower(std::uint32_t n, const double* lower, double* inverse) {
  for (std::uint32_t c = 0; c < n; ++c)
    for (std::uint32_t r = 0; r < n; ++r) {
      double sum = r == c ? 1.0 : 0.0;
      for (std::uint32_t i = c; i < r; ++i) sum -= lower[r * n + i] * inverse[i * n + c];
      inverse[r * n + c] = r < c ? 0.0 : sum / lower[r * n + r];
    }
}

double log_diagonal(std::uint32_t n, const double* factor) {
  double sum = 0.0;
  for (std::uint32_t i = 0; i < n; ++i) sum += math::log(factor[i * n + i]);
  return sum;
}

/// out = a' b, all (n x n).
void transposed_product(std::uint32_t n, const double* a, const double* b, double* out) {
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c) {
      double sum = 0.0;
      for (std::uint32_t i = 0; i < n; ++i) sum += a[i * n + r] * b[i * n + c];
      out[r * n + c] = sum;
    }
}

/// C with C' C = S and half of ln det S, where root' root = S^-1. `factor` (n x n) scratch.
bool demonstrated_root(std::uint32_t n, const double* root, double* factor, double* c, double* half_log_det) {
  transposed_product(n, root, root, c);
  if (!factorise(n, c, factor)) return false;
  invert_lower(n, factor, c);  // S^-1 = L L', so S = (L^-1)' L^-1
  *half_log_det = -log_diagonal(n, factor);
  return true;
}

}  // namespace

std::size_t divergence_scratch_size(std::uint32_t n) { return std::size_t{3} * n * n; }

bool gaussian_divergence(std::uint32_t n, const double* root, const double* covariance, double* precision_root,
                         double* rest, double* work) {
  double *const factor = work, *const demonstrated = factor + n * n, *const inverse = demonstrated + n * n;
  double log_demonstrated = 0.0;
  if (!demonstrated_root(n, root, factor, demonstrated, &log_demonstrated)) return false;
  if (!factorise(n, covariance, factor)) return false;
  invert_lower(n, factor, inverse);
  // tr(P^-1 S) = |C R'|^2 with C' C = S
  double trace = 0.0;
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c) {
      double sum = 0.0;
      for (std::uint32_t i = 0; i < n; ++i) sum += demonstrated[r * n + i] * inverse[c * n + i];
      trace += sum * sum;
    }
  if (!std::isfinite(trace)) return false;
  std::copy(inverse, inverse + std::size_t{n} * n, precision_root);
  *rest = 0.5 * (trace - n) + log_diagonal(n, factor) - log_demonstrated;
  return true;
}

void DemonstrationDivergence::lay_out(Arena& arena, tiller_config_t& config) {
  if (!wanted(config)) return;
  config_ = &config;
  given_ = config.cost.demonstration_root;
  const std::size_t square = std::size_t{config.model->state_count} * config.model->state_count;
  const std::size_t all = config.cost.demonstration_steps * square;
  roots_ = arena.take<double>(all);
  covariance_ = arena.take<double>(square);
  work_ = arena.take<double>(divergence_scratch_size(config.model->state_count) + square);  // and a covariance
  if (!roots_) return;
  std::copy(given_, given_ + all, roots_);
  config.cost.demonstration_root = roots_;
}

void DemonstrationDivergence::restore() {
  const std::size_t square = std::size_t{config_->model->state_count} * config_->model->state_count;
  std::copy(given_ + first_ * square, given_ + (first_ + count_) * square, roots_ + first_ * square);
  count_ = 0;
}

void DemonstrationDivergence::clear() {
  if (roots_) restore();
  rest_ = 0.0;
}

void DemonstrationDivergence::weigh_row(std::size_t row, const double* covariance, std::uint32_t steps) {
  const std::uint32_t nx = config_->model->state_count;
  const std::size_t square = std::size_t{nx} * nx;
  const double* const given = given_ + row * square;
  double *const factor = work_, *const demonstrated = factor + square;
  double log_det = 0.0, rest = 0.0;
  if (!demonstrated_root(nx, given, factor, demonstrated, &log_det)) return;
  transposed_product(nx, demonstrated, demonstrated, factor);  // S
  for (std::size_t i = 0; i < square; ++i) covariance_[i] = covariance[i] + kFloor * factor[i];
  if (gaussian_divergence(nx, given, covariance_, roots_ + row * square, &rest, work_))
    rest_ += config_->cost.demonstration_weight * rest * steps;
}

void DemonstrationDivergence::weigh(const Prediction& prediction, std::uint64_t task_step) {
  if (!roots_) return;
  clear();
  if (!prediction.made()) return;
  const std::uint32_t rows = config_->cost.demonstration_steps, horizon = config_->planner.horizon;
  const std::size_t square = std::size_t{config_->model->state_count} * config_->model->state_count;
  const std::uint64_t from = prediction.task_step();
  const auto covariance_at = [&](std::uint32_t k) {
    const std::uint64_t step = task_step + k;
    const std::uint64_t ahead = step > from ? step - from : 0;
    return prediction.covariance(static_cast<std::uint32_t>(std::min<std::uint64_t>(ahead, horizon)));
  };
  first_ = cost_row(task_step, rows);
  count_ = cost_row(task_step + horizon, rows) - first_ + 1;
  std::uint32_t k = 0;
  for (; k <= horizon && task_step + k + 1 < rows; ++k) weigh_row(cost_row(task_step + k, rows), covariance_at(k), 1);
  if (k > horizon) return;
  // the last row, for all that is left
  const std::uint32_t left = horizon + 1 - k;
  double* const mean = work_ + divergence_scratch_size(config_->model->state_count);
  std::fill(mean, mean + square, 0.0);
  for (; k <= horizon; ++k)
    for (std::size_t i = 0; i < square; ++i) mean[i] += covariance_at(k)[i] / left;
  weigh_row(rows - 1, mean, left);
}

}  // namespace tiller
