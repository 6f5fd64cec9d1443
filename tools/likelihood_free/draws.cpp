#include "tools/likelihood_free/draws.hpp"

#include "core/rng.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kRngSensor = 80, kRngStart = 81;  // purposes (core/rng.hpp)

bool is_finite(const Trajectory& trajectory) {
  for (const Matrix& piece : trajectory)
    if (!piece.allFinite()) return false;
  return !trajectory.empty();
}

/// v (d x n) as rows of parameters (n x np).
std::vector<double> rows_of(const Coordinates& coordinates, std::size_t np, const Matrix& v) {
  std::vector<double> rows(static_cast<std::size_t>(v.cols()) * np);
  for (Eigen::Index k = 0; k < v.cols(); ++k)
    coordinates.to_params(v.col(k).data(), rows.data() + static_cast<std::size_t>(k) * np);
  return rows;
}

std::vector<double> normalised(const Vector& weight) {
  const Vector w = weight / weight.sum();
  return {w.data(), w.data() + w.size()};
}

}  // namespace

Draws Draws::at(const std::vector<Eigen::Index>& index) const {
  Draws out{v(Eigen::all, index), {}};
  for (const Eigen::Index k : index) out.trajectory.push_back(trajectory[static_cast<std::size_t>(k)]);
  return out;
}

DrawMaker::DrawMaker(const InferenceProblem& problem, const Coordinates& coordinates)
    : problem_(problem), coordinates_(coordinates) {
  for (const Piece& piece : problem.pieces) observed_.push_back(piece.measured);
}

Ask DrawMaker::ask_of(const double* v) const {
  const Piece& first = problem_.pieces.front();
  const std::uint64_t index = total_;
  Ask ask{Vector(problem_.config->param_count),
          Matrix(first.start.size(), static_cast<Eigen::Index>(problem_.pieces.size())),
          Philox::draw(problem_.config->seed, index, kRngStart).w[0] + 1ull};
  coordinates_.to_params(v, ask.params.data());
  Rng rng(problem_.config->seed, kRngStart, index);
  for (Eigen::Index p = 0; p < ask.start.cols(); ++p)
    for (Eigen::Index i = 0; i < ask.start.rows(); ++i) {
      const double sd = problem_.noise_sd[static_cast<std::size_t>(i)];
      ask.start(i, p) = problem_.pieces[static_cast<std::size_t>(p)].start(i) + (sd > 0 ? sd * rng.normal() : 0.0);
    }
  return ask;
}

void DrawMaker::add_noise(std::uint64_t index, Trajectory& trajectory) const {
  Rng rng(problem_.config->seed, kRngSensor, index);
  for (Matrix& piece : trajectory)
    for (Eigen::Index k = 0; k < piece.cols(); ++k)
      for (Eigen::Index i = 0; i < piece.rows(); ++i)
        if (const double sd = problem_.noise_sd[static_cast<std::size_t>(i)]; sd > 0) piece(i, k) += sd * rng.normal();
}

bool DrawMaker::simulate(const Matrix& v, Draws& out, std::string& error) {
  const std::uint64_t first = total_;
  std::vector<Ask> asks;
  for (Eigen::Index k = 0; k < v.cols(); ++k, ++total_) asks.push_back(ask_of(v.col(k).data()));
  std::vector<Simulated> answers;
  if (!problem_.simulate(asks, answers, error)) return false;
  std::vector<Eigen::Index> good;
  for (std::size_t k = 0; k < answers.size(); ++k) {
    if (is_finite(answers[k].measured)) {
      add_noise(first + k, answers[k].measured);
      good.push_back(static_cast<Eigen::Index>(k));
      continue;
    }
    ++failed_;
    if (first_failure_.empty()) first_failure_ = answers[k].failure.empty() ? "not finite" : answers[k].failure;
  }
  out = {};
  out.v.resize(v.rows(), static_cast<Eigen::Index>(good.size()));
  for (std::size_t k = 0; k < good.size(); ++k) {
    out.v.col(static_cast<Eigen::Index>(k)) = v.col(good[k]);
    out.trajectory.push_back(std::move(answers[static_cast<std::size_t>(good[k])].measured));
  }
  if (problem_.options.progress)
    problem_.options.progress(static_cast<double>(total_) / static_cast<double>(problem_.options.simulations));
  if (!good.empty() || v.cols() == 0) return true;
  error = "all " + std::to_string(v.cols()) + " simulations failed, the first by: " + first_failure_ +
          "; try the simulator by hand, or narrow the priors";
  return false;
}

std::string DrawMaker::failure_text() const {
  if (failed_ == 0) return "";
  return format("%llu of %llu simulations failed and count as impossible, the first by: ",
                static_cast<unsigned long long>(failed_), static_cast<unsigned long long>(total_)) +
         first_failure_;
}

MethodIteration iteration_of(const Coordinates& coordinates, std::size_t np, const Matrix& v, const Vector& weight) {
  MethodIteration out;
  const std::vector<double> w = normalised(weight);
  weighted_moments(rows_of(coordinates, np, v), w, np, out);
  out.effective_samples = effective_samples(w);
  return out;
}

void conclude(const InferenceProblem& problem, const Coordinates& coordinates, const Matrix& v, const Vector& weight,
              Inferred& result) {
  MethodResult& found = result.found;
  found.params = rows_of(coordinates, problem.config->param_count, v);
  found.weight = normalised(weight);
  found.effective_samples = effective_samples(found.weight);
  found.transitions = 0;
  for (const Piece& piece : problem.pieces) found.transitions += static_cast<std::uint64_t>(piece.measured.cols());
}

}  // namespace tiller::tools
