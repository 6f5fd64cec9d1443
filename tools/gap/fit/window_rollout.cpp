#include "tools/gap/fit/window_rollout.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "rollout/late_reading.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {

WindowRollout::WindowRollout(const WindowData& data, const tiller_config_t& config, std::size_t points)
    : data_(data), model_(*config.model), table_(select_rollout(*config.model)) {
  states_.resize(std::size_t{TILLER_MAX_STATES} * kLanes);
  params_.resize(std::size_t{TILLER_MAX_PARAMS} * kLanes);
  unseen_.resize(kMostUnseen * kLanes);
  effect_states_.resize(std::size_t{TILLER_MAX_EFFECT_STATES + 1} * kLanes);
  final_effect_states_.resize(effect_states_.size());
  final_states_.resize(states_.size());
  history_.resize(std::size_t{TILLER_MAX_DELAY_STEPS + 2} * TILLER_MAX_INPUTS);
  path_.resize((kBefore + points + 1) * row());
  predicted_.resize((points + 1) * (config.measurement_count + data.gauges.count()) * kLanes);
}

double WindowRollout::command(const Window& w, std::size_t point, std::size_t input) const {
  return data_.controls[w.grid][point * model_.input_count + input];
}

const double* WindowRollout::history(const Window& w, std::size_t start) {
  const std::uint32_t nu = model_.input_count;
  for (std::size_t d = 0; d < hypothesis_->setup.delay_steps; ++d)
    for (std::uint32_t i = 0; i < nu; ++i)
      history_[d * nu + i] = start > d ? command(w, start - 1 - d, i) : data_.commands_before[w.grid][i];
  return history_.data();
}

// Periods before the window over which effects follow the measured path: as many as there are without a hole.
std::size_t WindowRollout::path_steps(const Window& w) const {
  const std::vector<double>& path = data_.path[w.grid];
  const auto most = static_cast<std::size_t>(
      std::lround(kPathRunIn_s * data_.grids[w.grid].time_scale / data_.grids[w.grid].period_s));
  std::size_t steps = 0;
  while (steps < most && steps < w.start && std::isfinite(path[(w.start - steps - 1) * model_.state_count])) ++steps;
  return steps;
}

// Period by period from the measured state: what the effects' own states make of the motion that was.
void WindowRollout::follow_path(const Window& w, std::size_t start) {
  const std::uint32_t nu = model_.input_count;
  RolloutJob<double> job;
  job.setup = &hypothesis_->setup;
  job.lanes = kLanes;
  job.horizon = 1;
  job.period_s = data_.grids[w.grid].period_s;
  job.params = {params_.data(), kLanes};
  job.final_state = final_states_.data();
  for (std::size_t k = start; k < w.start; ++k) {
    job.state.data = data_.path[w.grid].data() + k * model_.state_count;
    job.effect_state = {effect_states_.data(), kLanes};
    job.controls.data = data_.controls[w.grid].data() + k * nu;
    job.history = history(w, k);
    job.final_effect_state = final_effect_states_.data();
    table_.rollout_f64(model_, job);
    effect_states_.swap(final_effect_states_);
  }
}

// The command that acts in period k, in the mean over the period, where the input's delays take it `late` periods.
double WindowRollout::command_late(const Window& w, std::size_t k, std::size_t input, double late) const {
  const auto whole = static_cast<std::size_t>(late);
  const auto at = [&](std::size_t back) {
    return k >= back ? command(w, k - back, input) : data_.commands_before[w.grid][input];
  };
  const double share = late - static_cast<double>(whole);
  return at(whole) + (share > 0 ? share * (at(whole + 1) - at(whole)) : 0);
}

// Periods by which delays of the slot's input move the command, lane by lane.
void WindowRollout::delay_before(const EffectSlot& slot, double period_s, double* late) const {
  const StepSetup& setup = hypothesis_->setup;
  std::fill_n(late, kLanes, 0.0);
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kDelay) && setup.effects[e].port == slot.port)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        late[l] += std::max(0.0, params_[setup.effects[e].param * kLanes + l] / period_s);
}

// What a supply may have given before its log began, where that begins in motion, beyond the first command's; null
// where it is known.
const double* WindowRollout::before_the_log(const Window& w, std::uint32_t state) const {
  if (data_.begins_at_rest[w.grid]) return nullptr;
  for (std::size_t i = 0; i < hypothesis_->unseen.size(); ++i)
    if (hypothesis_->unseen[i] == state) return unseen_.data() + i * kLanes;
  return nullptr;
}

// Whether an unseen state is of the log's start, and not of the window's.
bool WindowRollout::is_of_the_log(std::uint32_t state) const {
  const StepSetup& setup = hypothesis_->setup;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kLoad) && setup.effects[e].state == state) return true;
  return false;
}

// The state at `start` of an effect that commands alone move, by all of them that count: a limiter that never catches
// up remembers where it began, a lag or a supply forgets no sooner than it follows.
void WindowRollout::follow_commands(const Window& w, const EffectSlot& slot, std::size_t start) {
  const double period = data_.grids[w.grid].period_s;
  const auto steps_of = [&](double seconds) {
    return static_cast<std::size_t>(std::lround(seconds * data_.grids[w.grid].time_scale / period));
  };
  const bool limits = has_role(slot.kind, kLimit), load = has_role(slot.kind, kLoad);
  const std::size_t least = steps_of(kFollowRunIn_s),
                    most = limits || load ? std::max(least, std::min(steps_of(kMemoryRunIn_s), kMemoryRunInPeriods))
                                          : least;
  double* out = effect_states_.data() + slot.state * kLanes;
  const double* params = params_.data() + slot.param * kLanes;
  const auto target = [&](double command) { return load ? std::fabs(command) : command; };
  double keep[kLanes], late[kLanes];  // keep: of the distance, over a period
  const double* time_constant = load ? params + kLanes : params;
  for (std::uint32_t l = 0; l < kLanes; ++l)
    keep[l] = limits ? 0.0 : std::exp(-period / std::max(time_constant[l], 1e-9));
  delay_before(slot, period, late);
  std::size_t k = start > most ? start - most : 0;
  double first = target(data_.commands_before[w.grid][slot.port]);
  if (k > 0) {  // unknown: what follows is about the mean of what it follows
    first = 0;
    for (std::size_t i = k; i < start; ++i) first += target(command(w, i, slot.port)) / static_cast<double>(start - k);
  }
  std::fill_n(out, kLanes, first);
  if (const double* more = load && k == 0 ? before_the_log(w, slot.state) : nullptr)
    for (std::uint32_t l = 0; l < kLanes; ++l) out[l] += more[l];
  for (; k < start; ++k)
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const double change = target(command_late(w, k, slot.port, late[l])) - out[l];
      const double bound = limits && params[l] > 0 ? params[l] * period : std::fabs(change);
      out[l] += (1 - keep[l]) * std::max(-bound, std::min(bound, change));
    }
}

// Commands before the window bring the effects' own states to where they are at its start. The path on the way is the
// model's from a state that the measurements give, or the measured one.
void WindowRollout::run_in(const Window& w) {
  const StepSetup& setup = hypothesis_->setup;
  const std::size_t along = hypothesis_->follows ? path_steps(w) : 0;
  const std::size_t start = w.start - (along > 0 ? along : w.run_in_steps);
  const std::uint32_t nu = model_.input_count;
  std::fill(effect_states_.begin(), effect_states_.end(), 0.0);
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kFollows | kLoad))
      follow_commands(w, setup.effects[e], start);
    else if (has_role(setup.effects[e].kind, kClock))
      std::fill_n(effect_states_.begin() + setup.effects[e].state * kLanes, kLanes,
                  data_.grids[w.grid].since_start_s(start));
  if (along > 0) return follow_path(w, start);
  if (w.run_in_steps == 0) return;
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.horizon = w.run_in_steps;
  job.period_s = data_.grids[w.grid].period_s;
  job.state.data = w.run_in;
  job.params = {params_.data(), kLanes};
  job.effect_state = {effect_states_.data(), kLanes};
  job.controls.data = data_.controls[w.grid].data() + start * nu;
  job.history = history(w, start);
  job.final_effect_state = final_effect_states_.data();
  table_.rollout_f64(model_, job);
  effect_states_.swap(final_effect_states_);
}

// The states before the window that lead to its first one, as far back as its readings are late: each is the state
// whose step ends in the one after it, by Newton's method. Where that leads nowhere (a collision cannot be undone), the
// row is the one after it. The effects' own states are those of the window's start.
void WindowRollout::trace_back(const Window& w) {
  const tiller_config_t& config = hypothesis_->config;
  const double period_s = data_.grids[w.grid].period_s;
  double late_s = 0;
  for (std::uint32_t i = 0; i < config.measurement_count; ++i)
    for (std::uint32_t l = 0; l < kLanes; ++l)
      late_s = std::max(late_s, late_by_s(config, config.measured_state[i], params_.data() + l, kLanes));
  const auto back = std::min(kBefore, static_cast<std::size_t>(std::ceil(late_s / period_s)));
  jacobian_.resize(row() * model_.state_count);
  LineariseJob job;
  job.setup = &hypothesis_->setup;
  job.lanes = kLanes;
  job.period_s = period_s;
  job.params = {params_.data(), kLanes};
  job.effect_state = {effect_states_.data(), kLanes};
  job.next_state = final_states_.data();
  job.next_effect_state = final_effect_states_.data();
  job.a = jacobian_.data();
  for (std::size_t r = 1; r <= back; ++r) {
    double* const at = path_.data() + (kBefore - r) * row();
    std::copy_n(at + row(), row(), at);
    if (r > w.start) continue;  // where the log begins, the robot has stood
    job.state = {at, kLanes};
    job.control = {data_.controls[w.grid].data() + (w.start - r) * model_.input_count, 0};
    job.history = history(w, w.start - r);
    undo_step(job, at);
  }
}

void WindowRollout::undo_step(const LineariseJob& job, double* at) {
  constexpr int kCorrections = 3;
  const std::uint32_t nx = model_.state_count;
  const double* const next = at + row();
  double distance[kLanes];
  std::fill_n(distance, kLanes, HUGE_VAL);  // below 0: found, or given up
  Eigen::MatrixXd a(nx, nx);
  Eigen::VectorXd off(nx);
  for (int k = 0; k < kCorrections; ++k) {
    table_.linearise(model_, job);
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      if (distance[l] < 0) continue;
      double size = 1;
      for (std::uint32_t i = 0; i < nx; ++i) {
        size = std::max(size, std::fabs(next[i * kLanes + l]));
        off(i) = job.next_state[i * kLanes + l] - next[i * kLanes + l];
        for (std::uint32_t c = 0; c < nx; ++c) a(i, c) = jacobian_[(i * nx + c) * kLanes + l];
      }
      const double far = off.norm();
      // a quaternion's length is nothing that a step keeps
      const Eigen::VectorXd change = model_.quaternion_mask != 0
                                         ? Eigen::VectorXd(a.completeOrthogonalDecomposition().solve(off))
                                         : Eigen::VectorXd(a.partialPivLu().solve(off));
      const bool found = far <= 1e-12 * size, nearer = far < distance[l] && change.allFinite();
      for (std::uint32_t i = 0; i < nx && !found; ++i)
        at[i * kLanes + l] = nearer ? at[i * kLanes + l] - change(i) : next[i * kLanes + l];
      distance[l] = nearer && !found ? far : -1;
    }
  }
}

// What the sensors make of the states, lane by lane.
void WindowRollout::read_sensors(const Window& w) {
  const tiller_config_t& config = hypothesis_->config;
  const std::uint32_t ny = config.measurement_count;
  const double period_s = data_.grids[w.grid].period_s;
  if (hypothesis_->late) trace_back(w);
  for (std::size_t k = 0; k < w.points; ++k)
    for (std::uint32_t i = 0; i < ny; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        predicted_[(k * ny + i) * kLanes + l] =
            reading_on_path(config, params_.data() + l, i, path_.data() + l, kBefore + k, period_s, kLanes);
}

void WindowRollout::read_gauges(const Window& w) {
  const std::size_t count = data_.gauges.count(), first = w.points * hypothesis_->config.measurement_count;
  const double period_s = data_.grids[w.grid].period_s;
  for (std::size_t k = 0; k < w.points; ++k)
    for (std::size_t g = 0; g < count; ++g)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        predicted_[(first + k * count + g) * kLanes + l] =
            k < data_.gauges.before(g)
                ? NAN
                : data_.gauges.reading(g, trajectory() + l, k, kLanes, params_.data() + l, kLanes, period_s);
}

const double* WindowRollout::effects_at_start(const Window& w) {
  if (hypothesis_->setup.effect_state_count > 0) run_in(w);
  return effect_states_.data();
}

const double* WindowRollout::run(const Window& w) {
  const StepSetup& setup = hypothesis_->setup;
  effects_at_start(w);
  for (std::size_t i = 0; i < hypothesis_->unseen.size(); ++i)
    for (std::uint32_t l = 0; l < kLanes && !is_of_the_log(hypothesis_->unseen[i]); ++l)
      effect_states_[hypothesis_->unseen[i] * kLanes + l] += unseen_[i * kLanes + l];
  const std::uint32_t nx = model_.state_count, ny = hypothesis_->config.measurement_count;
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.horizon = w.points - 1;
  job.period_s = data_.grids[w.grid].period_s;
  job.state = {states_.data(), kLanes};
  job.params = {params_.data(), kLanes};
  job.effect_state = {effect_states_.data(), kLanes};
  job.controls.data = data_.controls[w.grid].data() + w.start * model_.input_count;
  job.history = history(w, w.start);
  job.trajectory = path_.data() + kBefore * row();
  table_.rollout_f64(model_, job);
  for (std::size_t k = 0; k < w.points; ++k)
    for (std::uint32_t i = 0; i < ny; ++i)
      std::copy_n(trajectory() + (k * nx + hypothesis_->config.measured_state[i]) * kLanes, kLanes,
                  predicted_.data() + (k * ny + i) * kLanes);
  if (hypothesis_->sensors) read_sensors(w);
  read_gauges(w);
  return predicted_.data();
}

std::size_t WindowRollout::bytes_for(const tiller_config_t& config, std::size_t points, std::size_t gauges) {
  const std::size_t nx = config.model->state_count;
  const std::size_t lanes = 2 * std::size_t{TILLER_MAX_STATES} + TILLER_MAX_PARAMS + kMostUnseen +
                            2 * (TILLER_MAX_EFFECT_STATES + 1) +
                            (points + 1) * (nx + config.measurement_count + gauges) + (kBefore + nx) * nx;
  return sizeof(double) * (lanes * kLanes + (TILLER_MAX_DELAY_STEPS + 2) * TILLER_MAX_INPUTS);
}

}  // namespace tiller::tools::gap
