#include "harness/gap_worlds/gap_worlds.hpp"

#include <algorithm>
#include <cmath>

#include "harness/gap_worlds/gap_setup.hpp"

namespace tiller::bench {
namespace {

std::vector<double> start_state(const Setup& setup, const std::string& name) {
  std::vector<double> state = setup.plant->rest;
  Draws draws(setup.world.seed, "start." + name);
  for (std::size_t i = 0; i < setup.plant->excursion.size(); ++i) {
    state[i] += 0.1 * setup.plant->excursion[i] * draws.between(-1, 1);
  }
  return state;
}

void set_start(sim::PlantOptions& options, const sim::Plant& any, const std::vector<double>& state) {
  for (std::size_t i = 0; i < state.size(); ++i) options.initial_state[any.states()[i].name] = state[i];
}

std::uint64_t noise_seed(const Setup& setup, const std::string& name) {
  return static_cast<std::uint64_t>(Draws(setup.world.seed, "noise." + name).uniform() * 0x1p52);
}

}  // namespace

bool record(const Setup& setup, const std::vector<double>& amplitude, const std::string& name, double seconds,
            Series& series, std::string& error) {
  const auto rows = static_cast<std::size_t>(std::lround(seconds / kWorldPeriod));
  const auto commander = make_commander(setup, amplitude, name, rows, error);
  return commander && record(setup, *commander, name, rows, series, error);
}

bool record(const Setup& setup, Commander& commander, const std::string& name, std::size_t rows, Series& series,
            std::string& error) {
  sim::PlantOptions options = setup.options;
  options.seed = noise_seed(setup, name);
  options.process_noise_sd = setup.world.process_sd;
  auto plant = sim::Plant::make(options, error);
  if (!plant) return false;
  set_start(options, *plant, start_state(setup, name));
  for (const sim::Channel& c : plant->measurements()) {
    options.encoder_noise_sd[c.name] = setup.world.noise_sd;
    options.encoder_step[c.name] = setup.world.encoder_step;
  }
  plant = sim::Plant::make(options, error);
  if (!plant) return false;
  std::vector<double> measured(plant->measurements().size()), clean(measured.size()), truth(plant->states().size()),
      command(plant->commands().size());
  series = Series{name, {}, {}, {}, {}, {}};
  series.clean.resize(measured.size());
  series.measured.resize(measured.size());
  series.truth.resize(truth.size());
  series.input.resize(command.size());
  for (std::size_t k = 0; k < rows; ++k) {
    plant->measure(measured.data());
    plant->measure_clean(clean.data());
    plant->true_state(truth.data());
    commander.next(k, measured.data(), command.data());
    series.time_s.push_back(kWorldPeriod * static_cast<double>(k));
    for (std::size_t i = 0; i < measured.size(); ++i) series.measured[i].push_back(measured[i]);
    for (std::size_t i = 0; i < clean.size(); ++i) series.clean[i].push_back(clean[i]);
    for (std::size_t i = 0; i < truth.size(); ++i) series.truth[i].push_back(truth[i]);
    for (std::size_t i = 0; i < command.size(); ++i) series.input[i].push_back(command[i]);
    plant->apply(command.data());
    plant->advance(kWorldPeriod);
  }
  return true;
}

/// The state at a row as the sensors show it, less noise: a constant error of a sensor moves where a rollout starts,
/// and is a gap only as far as the motion depends on the place.
std::vector<double> seen_state(const Setup& setup, const Series& series, std::size_t row) {
  std::vector<double> state;
  const std::size_t positions = setup.plant->excursion.size(), last = series.time_s.size() - 1;
  for (const auto& column : series.clean) state.push_back(column[row]);
  for (std::size_t i = 0; i < positions; ++i) {
    const double rate = series.truth[positions + i][row];
    const std::size_t before = row > 0 ? row - 1 : 0, after = std::min(row + 1, last);
    const double way = series.truth[i][after] - series.truth[i][before];
    // rates grow as the reading does
    const double slope = std::fabs(way) > 1e-9 ? (series.clean[i][after] - series.clean[i][before]) / way : 1.0;
    state.push_back(std::fabs(slope - 1) > 1e-6 ? slope * rate : rate);
  }
  return state;
}

void add_rollout_error(const Setup& setup, const Series& series, RolloutError& error) {
  sim::PlantOptions options = setup.options;
  options.effects.clear();
  options.seed = noise_seed(setup, series.name);
  options.process_noise_sd = setup.world.process_sd;  // by the clock: the same pushes as in the run
  std::string problem;
  const auto any = sim::Plant::make(options, problem);
  const std::size_t outputs = any->measurements().size();
  error.squares.resize(outputs);
  std::vector<double> state, command(any->commands().size());
  const auto window = static_cast<std::size_t>(std::lround(1.0 / kWorldPeriod));
  for (std::size_t first = 0; first + window < series.time_s.size(); first += window) {
    set_start(options, *any, seen_state(setup, series, first));
    options.start_us = std::llround(1e6 * series.time_s[first]);
    const auto plant = sim::Plant::make(options, problem);
    state.resize(plant->states().size());
    for (std::size_t k = first; k < first + window; ++k) {
      for (std::size_t i = 0; i < command.size(); ++i) command[i] = series.input[i][k];
      plant->apply(command.data());
      plant->advance(kWorldPeriod);
      plant->true_state(state.data());
      for (std::size_t i = 0; i < outputs; ++i) error.squares[i] += std::pow(state[i] - series.clean[i][k + 1], 2);
      error.count += 1;
    }
  }
}

double rms_r(const RolloutError& error, double sensor_sd) {
  double sum = 0;
  for (const double s : error.squares) sum += s;
  return std::sqrt(sum / (error.count * static_cast<double>(error.squares.size()))) / sensor_sd;
}

std::unique_ptr<World> make_world(const WorldCase& wanted, std::string& error, const WorldSize& size) {
  Setup setup;
  if (!make_setup(wanted, setup, error)) return nullptr;
  const auto plant = sim::Plant::make(setup.options, error);
  if (!plant) return nullptr;
  auto world = std::make_unique<World>();
  const std::vector<double> amplitude = calibrate(setup);
  world->robot_toml = robot_text(setup, *plant, amplitude);
  world->sensor_sd = setup.sensor_sd;
  for (const sim::Channel& c : plant->states()) world->states.push_back(c.name);
  for (const sim::Channel& c : plant->measurements()) world->measured.push_back(c.name);
  for (const sim::Channel& c : plant->commands()) world->inputs.push_back(c.name);
  RolloutError squares;
  for (std::size_t i = 0; i < size.work + size.score; ++i) {
    const bool work = i < size.work;
    const std::string name = (work ? "log_" : "score_") + std::to_string(work ? i + 1 : i + 1 - size.work);
    Series series;
    const std::vector<double> fitted = fit_amplitude(setup, amplitude, name);
    if (!record(setup, fitted, name, size.seconds, series, error)) return nullptr;
    if (work) add_rollout_error(setup, series, squares);
    (work ? world->work : world->score).push_back(std::move(series));
  }
  Sealed& answer = world->answer;
  answer.world = wanted;
  for (const auto& [name, value] : setup.options.parameters) {
    answer.names.push_back(name);
    answer.values.push_back(value);
  }
  answer.r = rms_r(squares, setup.sensor_sd);
  for (const double s : squares.squares) answer.r_by_channel.push_back(std::sqrt(s / squares.count) / setup.sensor_sd);
  return world;
}

namespace {

class Played final : public Commander {
 public:
  Played(const std::vector<double>& input, std::size_t rows) : input_(input), inputs_(input.size() / rows) {}
  void next(std::size_t row, const double*, double* command) override {
    for (std::size_t i = 0; i < inputs_; ++i) command[i] = input_[row * inputs_ + i];
  }

 private:
  const std::vector<double>& input_;
  std::size_t inputs_;
};

}  // namespace

bool play(const WorldCase& world, const std::string& name, const std::vector<double>& input, std::size_t rows,
          Series& series, std::string& error) {
  Setup setup;
  Played commander(input, rows);
  return make_setup(world, setup, error) && record(setup, commander, name, rows, series, error);
}

tools::Log as_log(const World& world, const Series& series) {
  tools::Log log;
  log.path = series.name + ".csv";
  log.time_s = series.time_s;
  for (std::size_t k = 0; k < series.time_s.size(); ++k) log.line.push_back(static_cast<int>(k) + 2);
  log.state.resize(world.states.size());
  for (std::size_t i = 0; i < world.states.size(); ++i) {
    for (std::size_t m = 0; m < world.measured.size(); ++m) {
      if (world.measured[m] == world.states[i]) log.state[i] = series.measured[m];
    }
  }
  log.input = series.input;
  return log;
}

}  // namespace tiller::bench
