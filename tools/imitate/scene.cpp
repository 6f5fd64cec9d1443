#include "tools/imitate/scene.hpp"

#include "tools/links/trial_plant.hpp"

namespace tiller::tools::imitate {

LaneRows::LaneRows(const Matrix& m)
    : lanes(padded(static_cast<std::uint32_t>(m.cols()))), data(static_cast<std::size_t>(m.rows()) * lanes) {
  for (Eigen::Index r = 0; r < m.rows(); ++r)
    for (std::uint32_t c = 0; c < lanes; ++c)
      data[static_cast<std::size_t>(r) * lanes + c] = m(r, std::min<Eigen::Index>(c, m.cols() - 1));
}

Matrix LaneRows::columns(Eigen::Index rows, Eigen::Index count) const {
  Matrix m(rows, count);
  for (Eigen::Index r = 0; r < rows; ++r)
    for (Eigen::Index c = 0; c < count; ++c) m(r, c) = data[static_cast<std::size_t>(r * lanes + c)];
  return m;
}

bool Scene::make(const tiller_config_t& robot, std::string& error) {
  config = robot;
  if (make_step_setup(config, setup) != tiller_status_ok) {
    error = "effects: one does not fit the model; run tiller check on the robot file";
  } else if (config.model->quaternion_mask != 0) {
    error = "model: it turns in space (quaternions), for which demonstrations are not read; use a planar model";
  } else if (setup.effect_state_count > 0 || setup.delay_steps > 0) {
    error =
        "effects: a lag, a delay or an effect with a state of its own hides the cause of an input; take the effect "
        "out of a copy of the robot file, learn the weights with that, and copy them back";
  } else if (config.cost.terminal == tiller_terminal_lqr) {
    error =
        "cost.terminal = \"lqr\": its matrix follows from the weights that are to be learnt; write "
        "terminal = \"diagonal\" and terminal_weight";
  } else if (config.cost.input_reference != tiller_input_reference_zero) {
    error =
        "cost.input_reference = \"steady\": demonstrations are read as if inputs counted from zero; take the line out of a "
        "copy of the robot file";
  } else {
    table = &select_rollout(*config.model);
    params.clear();
    for (std::uint32_t i = 0; i < config.param_count; ++i) params.push_back(centre_of(config.priors[i]));
    return true;
  }
  return false;
}

Matrix Scene::step(const Matrix& state, const Matrix& input, Matrix* a, Matrix* b) const {
  const auto columns = static_cast<std::uint32_t>(state.cols());
  const LaneRows x(state), u(input);
  LaneRows next(nx(), columns), by_state(a ? nx() * nx() : 0, columns), by_input(b ? nx() * nu() : 0, columns);
  LineariseJob job;
  job.setup = &setup;
  job.lanes = next.lanes;
  job.state = x.get();
  job.control = u.get();
  job.params = {params.data(), 0};
  job.next_state = next.data.data();
  if (a) job.a = by_state.data.data();
  if (b) job.b = by_input.data.data();
  table->linearise(*config.model, job);
  if (a) *a = by_state.columns(nx() * nx(), columns);
  if (b) *b = by_input.columns(nx() * nu(), columns);
  return next.columns(nx(), columns);
}

Matrix Scene::roll(const Vector& start, const Matrix& input) const {
  const auto steps = static_cast<std::uint32_t>(input.cols());
  LaneRows path(Eigen::Index{nx()} * (steps + 1), 1);
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kLanePadding;
  job.horizon = steps;
  job.state = {start.data(), 0};
  job.params = {params.data(), 0};
  job.controls = {input.data(), 0};  // column-major (nu x steps) is row k nu + i
  job.trajectory = path.data.data();
  table->rollout_f64(*config.model, job);
  const Matrix rows = path.columns(Eigen::Index{nx()} * (steps + 1), 1);
  return Eigen::Map<const Matrix>(rows.data(), nx(), steps + 1);
}

double Scene::cost(const tiller_config_t& of, const Matrix& state, const Matrix& input, const double* before) const {
  const auto points = static_cast<std::uint32_t>(state.cols()), steps = points - 1;
  Matrix u(nu(), points), b(nu(), points);
  u << input, Vector::Zero(nu());
  b.rightCols(steps) = input;
  for (std::uint32_t i = 0; i < nu(); ++i) b(i, 0) = before ? before[i] : input(i, 0);
  const LaneRows x(state), inputs(u), befores(b), p(Eigen::Map<const Vector>(params.data(), params.size()));
  CostTerms<double> terms = make_cost_terms<double>(of.cost, nx());
  LaneRows value(1, points);
  QuadratiseJob job;
  job.setup = &setup;
  job.cost = &terms;
  job.lanes = value.lanes;
  job.stages = steps;
  job.terminal = true;
  job.state = x.get();
  job.control = inputs.get();
  job.before = befores.get();
  job.params = {params.data(), 0};
  job.value = value.data.data();
  table->quadratise(*config.model, job);
  double sum = 0;
  for (std::uint32_t k = 0; k < points; ++k) sum += value.data[k];
  return sum;
}

Vector Scene::difference(const Vector& a, const Vector& b) const {
  Vector d(nx());
  state_differences(*config.model, a.data(), b.data(), d.data());
  return d;
}

}  // namespace tiller::tools::imitate
