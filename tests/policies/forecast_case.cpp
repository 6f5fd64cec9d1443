// Prints a case as JSON for forecast_test.py: data and shape of a Gaussian process, a linear policy, a cost, and what
// the library forecasts over three periods.

#include <cstdio>
#include <string>

#include "core/rng.hpp"
#include "tools/policy_search/gaussian_process.hpp"
#include "tools/policy_search/long_term_cost.hpp"

namespace {

using namespace tiller::tools::policy;

std::string text(const Matrix& m) {
  std::string out = "[";
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    out += i ? ", [" : "[";
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      char number[40];
      std::snprintf(number, sizeof number, "%s%.17g", j ? ", " : "", m(i, j));
      out += number;
    }
    out += "]";
  }
  return out + "]";
}

Matrix draws(Eigen::Index rows, Eigen::Index cols) {
  tiller::Rng rng(5, 1, 0);
  Matrix out(rows, cols);
  for (Eigen::Index i = 0; i < out.size(); ++i) out(i) = rng.normal();
  return out;
}

/// States: an angle and its rate. The process sees rate, sine, cosine and the command, and learns a kind of pendulum.
SearchTask make_task() {
  SearchTask task;
  task.states = 2;
  task.angles = {0};
  task.policy_inputs = task.model_inputs = {1, 2, 3};
  task.low = Vector::Constant(1, -2.0);
  task.high = Vector::Constant(1, 3.0);
  task.start_mean = (Vector(2) << 0.4, -0.2).finished();
  task.start_covariance = (Matrix(2, 2) << 0.05, 0.01, 0.01, 0.08).finished();
  task.horizon = 3;
  task.target = (Vector(4) << 0.0, 0.0, 0.0, -1.0).finished();
  task.weight = Vector((Vector(4) << 0.0, 0.1, 0.7, 0.7).finished()).asDiagonal();
  return task;
}

}  // namespace

int main() {
  const Matrix x = draws(4, 25);
  Matrix y(2, 25);
  for (Eigen::Index i = 0; i < 25; ++i)
    y.col(i) << 0.3 * x(0, i), 0.3 * x(3, i) - 0.5 * x(1, i) + 0.1 * x(0, i) * x(2, i);
  GpShape shape;
  shape.log_length = Matrix::Constant(4, 2, 0.4);
  shape.log_length(1, 1) = 0.1;
  shape.log_signal = Vector::Constant(2, -0.3);
  shape.log_noise = Vector::Constant(2, -2.5);
  const SearchTask task = make_task();
  const auto policy = make_linear(3, 1);
  const Vector parameters = (Vector(4) << -0.5, 0.8, 0.3, 0.2).finished();  // weights of rate, sine, cosine; bias
  Forecast forecast;
  long_term_cost(task, condition(x, y, shape, {}), *policy, parameters, nullptr, &forecast);
  const Matrix cost = Eigen::Map<const Vector>(forecast.cost.data(), static_cast<Eigen::Index>(forecast.cost.size()));
  std::printf("{\"x\": %s,\n\"y\": %s,\n\"log_length\": %s,\n\"log_signal\": %s,\n\"log_noise\": %s,\n",
              text(x).c_str(), text(y).c_str(), text(shape.log_length).c_str(), text(shape.log_signal).c_str(),
              text(shape.log_noise).c_str());
  std::printf("\"start_mean\": %s,\n\"start_covariance\": %s,\n\"low\": %s,\n\"high\": %s,\n\"parameters\": %s,\n",
              text(task.start_mean).c_str(), text(task.start_covariance).c_str(), text(task.low).c_str(),
              text(task.high).c_str(), text(parameters).c_str());
  std::printf("\"target\": %s,\n\"weight\": %s,\n\"mean\": %s,\n\"deviation\": %s,\n\"cost\": %s}\n",
              text(task.target).c_str(), text(task.weight).c_str(), text(forecast.mean).c_str(),
              text(forecast.deviation).c_str(), text(cost).c_str());
}
