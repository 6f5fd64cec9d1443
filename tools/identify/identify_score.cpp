#include "tools/identify/identify_score.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tools/identify/identify_roller.hpp"

namespace tiller::tools {
namespace {

// Positions of joints that are measured; where none is, whatever is measured.
std::vector<std::uint32_t> compared_states(const tiller_config_t& config) {
  std::vector<std::uint32_t> all, positions;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    const std::uint32_t state = config.measured_state[k];
    all.push_back(state);
    for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
      if (config.model->joints[j].position == state) positions.push_back(state);
  }
  return positions.empty() ? all : positions;
}

// Errors by step and by horizon of one state.
class Tally {
 public:
  Tally(std::uint32_t state, const std::vector<double>& horizons_s, double period_s) : state_(state) {
    for (const double h : horizons_s) {
      horizons_.push_back({h, static_cast<std::size_t>(std::llround(h / period_s)), {}, 0, 0, 0});
      longest_ = std::max(longest_, horizons_.back().steps);
    }
    square_.resize(longest_);
    count_.resize(longest_);
  }
  /// Errors after 1, 2, ... steps; `covered(steps)` is asked at the horizons alone.
  template <class Covered>
  void add(const std::vector<double>& error, Covered covered) {
    double sum = 0;
    for (std::size_t k = 0; k < error.size(); ++k) {
      if (!std::isfinite(error[k])) break;
      if (error.size() == longest_) {  // the same starts all along, or the curve would jump where starts drop out
        square_[k] += error[k] * error[k];
        ++count_[k];
      }
      sum += error[k] * error[k];
      for (auto& h : horizons_)
        if (h.steps == k + 1) {
          h.end.push_back(std::fabs(error[k]));
          h.covered += covered(k + 1) ? 1 : 0;
          h.along += sum;
          h.along_count += k + 1;
        }
    }
  }
  StateScore result() {
    StateScore score;
    score.state = state_;
    for (auto& h : horizons_) {
      HorizonError e;
      e.horizon_s = h.seconds;
      e.rollouts = h.end.size();
      if (e.rollouts == 0) {
        score.horizons.push_back(e);
        continue;
      }
      double sum = 0;
      for (const double v : h.end) sum += v * v;
      e.rms_end = std::sqrt(sum / static_cast<double>(e.rollouts));
      e.coverage_90 = static_cast<double>(h.covered) / static_cast<double>(e.rollouts);
      e.rms_along = std::sqrt(h.along / static_cast<double>(h.along_count));
      const auto middle = h.end.begin() + static_cast<std::ptrdiff_t>(h.end.size() / 2);
      std::nth_element(h.end.begin(), middle, h.end.end());
      e.median_end = *middle;
      score.horizons.push_back(e);
    }
    for (std::size_t k = 0; k < longest_ && count_[k] > 0; ++k)
      score.curve.push_back(std::sqrt(square_[k] / static_cast<double>(count_[k])));
    return score;
  }
  std::uint32_t state() const { return state_; }
  std::size_t longest() const { return longest_; }

 private:
  struct Horizon {
    double seconds;
    std::size_t steps;
    std::vector<double> end;
    double along;
    std::size_t along_count;
    std::size_t covered;
  };
  std::uint32_t state_;
  std::size_t longest_ = 0;
  std::vector<Horizon> horizons_;
  std::vector<double> square_;
  std::vector<std::size_t> count_;
};

// The draws' quantile, where n sorted draws cut the line into n + 1 equally likely parts. Lane 0 is no draw.
double quantile(const double* row, double q, std::vector<double>& scratch) {
  scratch.assign(row + 1, row + Roller::kLanes);
  std::sort(scratch.begin(), scratch.end());
  const double at = q * (static_cast<double>(scratch.size()) + 1) - 1;
  const double floor = std::floor(at);
  const auto below = static_cast<std::size_t>(floor);
  return scratch[below] + (at - floor) * (scratch[below + 1] - scratch[below]);
}

RolloutTrace make_trace(const Grid& grid, std::size_t start, std::size_t steps, std::uint32_t state, Roller& roller) {
  RolloutTrace trace;
  trace.path = grid.path;
  trace.state = state;
  trace.period_s = grid.period_s;
  trace.start_s = grid.first_time_s + static_cast<double>(start) * grid.period_s;
  std::vector<double> scratch;
  for (std::size_t k = 0; k <= steps; ++k) {
    trace.measured.push_back(grid.state[state][start + k]);
    trace.mean.push_back(roller.foreseen(k, state)[0]);
    trace.low.push_back(quantile(roller.foreseen(k, state), 0.05, scratch));
    trace.high.push_back(quantile(roller.foreseen(k, state), 0.95, scratch));
    trace.predictive_low.push_back(quantile(roller.readings(k, state), 0.05, scratch));
    trace.predictive_high.push_back(quantile(roller.readings(k, state), 0.95, scratch));
  }
  return trace;
}

// Whether what was measured lies inside the predictive 5-95 % after `steps`; of an angle, the short way round.
bool covered_by(const tiller_model_t& model, const Grid& grid, std::size_t start, std::size_t steps,
                std::uint32_t state, Roller& roller) {
  double difference[Roller::kLanes];
  std::vector<double> scratch;
  for (std::uint32_t lane = 0; lane < Roller::kLanes; ++lane)
    difference[lane] =
        state_difference(model, state, roller.readings(steps, state)[lane], grid.state[state][start + steps]);
  return quantile(difference, 0.05, scratch) <= 0 && quantile(difference, 0.95, scratch) >= 0;
}

std::vector<double> errors_of(const tiller_model_t& model, const Grid& grid, std::size_t start, std::size_t steps,
                              std::uint32_t state, const Roller& roller) {
  std::vector<double> error;
  for (std::size_t k = 1; k <= steps; ++k)
    error.push_back(state_difference(model, state, roller.foreseen(k, state)[0], grid.state[state][start + k]));
  return error;
}

constexpr double kRunInSteps = 10;    // at least, for a filter to find the states that are not measured
constexpr double kMostStarts = 2000;  // neighbours tell the same: 0.7 % of coverage, as its standard error, is enough

struct Start {
  const Grid* grid;
  std::size_t point, steps;
};

std::vector<Start> find_starts(const std::vector<Grid>& grids, std::size_t longest, std::size_t shortest,
                               const ScoreOptions& options) {
  std::vector<Start> starts;
  double all_s = 0;
  for (const Grid& grid : grids) all_s += static_cast<double>(grid.points()) * grid.period_s;
  const double every_s = std::max(options.start_every_s, all_s / kMostStarts);
  for (const Grid& grid : grids) {
    const auto stride = static_cast<std::size_t>(std::max(1.0, std::round(every_s / grid.period_s)));
    // a log may begin in motion, of which the robot file's [start] knows nothing
    const auto first = static_cast<std::size_t>(std::max(kRunInSteps, std::round(options.run_in_s / grid.period_s)));
    for (std::size_t p = first; p + shortest < grid.points(); p += stride)
      starts.push_back({&grid, p, std::min(longest, grid.points() - 1 - p)});
  }
  return starts;
}

}  // namespace

Score score(const Candidate& candidate, const Fit& fit, const std::vector<Grid>& grids, const ScoreOptions& options) {
  Score result;
  const tiller_config_t& config = candidate.config;
  const tiller_model_t& model = *config.model;
  std::vector<Tally> tallies;
  for (const std::uint32_t state : compared_states(config))
    tallies.emplace_back(state, options.horizons_s, config.period_s);
  const double shortest_s = *std::min_element(options.horizons_s.begin(), options.horizons_s.end());
  const auto shortest = static_cast<std::size_t>(std::llround(shortest_s / config.period_s));
  Roller roller(candidate, fit);
  const std::vector<Start> starts = find_starts(grids, tallies.front().longest(), shortest, options);
  const std::size_t trace_stride = std::max<std::size_t>(1, starts.size() / std::max(1u, options.traces));
  for (std::size_t s = 0; s < starts.size(); ++s) {
    const Start& start = starts[s];
    roller.stand_at(*start.grid, start.point);
    roller.predict(start.steps);
    roller.read(start.steps);
    bool finite = true;
    for (Tally& tally : tallies) {
      const std::vector<double> error = errors_of(model, *start.grid, start.point, start.steps, tally.state(), roller);
      finite = finite && std::isfinite(error.back());
      tally.add(error, [&](std::size_t steps) {
        return covered_by(model, *start.grid, start.point, steps, tally.state(), roller);
      });
    }
    if (!finite) ++result.diverged;
    if (s % trace_stride == trace_stride / 2)
      result.traces.push_back(make_trace(*start.grid, start.point, start.steps, tallies.front().state(), roller));
  }
  for (Tally& tally : tallies) result.states.push_back(tally.result());
  return result;
}

}  // namespace tiller::tools
