#include "tools/distill/lesson.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planners/policy_inputs.hpp"
#include "rollout/measurement.hpp"
#include "tools/distill/lesson_plant.hpp"
#include "tools/robot/stage_cost.hpp"

namespace tiller::tools::distill {
namespace {

constexpr std::uint32_t kPurpose = 0x646e;
constexpr double kTurn_s = 0.5;  // for which teacher or pupil drives
constexpr double kPush_s = 0.1;  // for which a random command acts
constexpr double kNoise = 2.0;   // of process noise over the robot file's: rare states become less rare
constexpr double kNearby = 4.0;  // deviations of a period's noise and the start's that further samples lie off

/// The command as a share of its limits.
double share_of(const tiller_config_t& c, std::uint32_t i, double command) {
  const double low = c.safety.input_low[i], high = c.safety.input_high[i];
  return high > low ? std::clamp((2.0 * command - low - high) / (high - low), -1.0, 1.0) : 0.0;
}

/// One episode under way.
class Lesson {
 public:
  Lesson(const tiller_config_t& config, const PriorMoments& prior, LonePlanner* teacher, LonePlanner* pupil,
         const LessonOptions& options)
      : c_(config),
        o_(options),
        teacher_(teacher),
        pupil_(pupil),
        rng_(options.seed, kPurpose, options.number),
        story_(config, prior, rng_),
        plant_(config, (teacher ? teacher : pupil)->setup(), story_.truth()),
        in_(policy_input_count(config, options.reads)) {
    std::copy(c_.safety.safe_command, c_.safety.safe_command + c_.model->input_count, command_);
    if (teacher_) teacher_->reset();
    if (pupil_) pupil_->reset();
    plant_.start(c_.initial_state);
    disturb(c_.initial_state_sd, pushed() ? kNoise : 1.0);
  }

  LessonResult run() {
    const auto ticks = static_cast<std::uint32_t>(std::lround(o_.seconds / c_.period_s));
    std::uint32_t tick = 0;
    double cost = 0, last = 0;
    for (; tick < ticks && !result_.lost; ++tick) {
      answer(tick);
      last = stage_cost(c_, tick, plant_.state(), command_, story_.truth().data());
      cost += last;
      plant_.step(command_);
      double sd[TILLER_MAX_STATES];
      for (std::uint32_t i = 0; i < c_.model->state_count; ++i) sd[i] = c_.process_sd[i] * std::sqrt(c_.period_s);
      disturb(sd, pushed() ? kNoise : 1.0);
      result_.lost = !readable();
    }
    result_.cost = (cost + last * (ticks - tick)) / std::max(ticks, 1u);
    if (!std::isfinite(result_.cost)) result_.cost = std::numeric_limits<double>::infinity();
    return std::move(result_);
  }

 private:
  bool pushed() const { return o_.pushes_per_s > 0; }

  /// Adds noise of these deviations times `scale` to the state.
  void disturb(const double* sd, double scale) {
    double off[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < c_.model->state_count; ++i) off[i] = scale * sd[i] * rng_.normal();
    plant_.move(off);
  }

  bool readable() const {
    for (std::uint32_t i = 0; i < c_.model->state_count; ++i)
      if (!(std::fabs(plant_.state()[i]) < 1e6)) return false;
    for (std::uint32_t k = 0; k < c_.measurement_count; ++k) {
      const double value = measured_value(c_, story_.truth().data(), k, plant_.state()[c_.measured_state[k]]);
      if (c_.safety.measurement_low && value < c_.safety.measurement_low[k]) return false;
      if (c_.safety.measurement_high && value > c_.safety.measurement_high[k]) return false;
    }
    return true;
  }

  /// Everybody plans; whoever's turn it is gives the command.
  void answer(std::uint32_t tick) {
    story_.tell(tick * c_.period_s);
    Situation s{
        plant_.state(), plant_.effect_state(), nullptr, story_.mean().data(), story_.sd().data(), command_, tick};
    double wanted[TILLER_MAX_INPUTS] = {}, own[TILLER_MAX_INPUTS] = {};
    bool planned = false;
    if (teacher_) planned = ask(*teacher_, s, wanted);
    if (planned) record(s, wanted);
    if (pupil_) (void)ask(*pupil_, s, own);
    choose_driver(tick);
    const double* given = teacher_ && (teacher_drives_ || !pupil_) ? wanted : own;
    if (pushing_ > 0) {
      --pushing_;
      given = push_;
    }
    std::copy(given, given + c_.model->input_count, command_);
  }

  bool ask(LonePlanner& planner, Situation& s, double* command) {
    story_.draw(planner.hypotheses(), hypotheses_);
    s.params = hypotheses_.data();
    return planner.plan(s, command);
  }

  void choose_driver(std::uint32_t tick) {
    const auto turn = static_cast<std::uint32_t>(std::max(1.0, std::round(kTurn_s / c_.period_s)));
    if (tick % turn == 0) teacher_drives_ = rng_.uniform() < o_.teacher_share;
    if (!pushed() || rng_.uniform() >= o_.pushes_per_s * c_.period_s) return;
    pushing_ = static_cast<std::uint32_t>(std::max(1.0, std::round(kPush_s / c_.period_s)));
    for (std::uint32_t i = 0; i < c_.model->input_count; ++i) {
      const double low = c_.safety.input_low[i], high = c_.safety.input_high[i];
      push_[i] = low + (high - low) * rng_.uniform();
    }
  }

  void record(const Situation& s, const double* wanted) {
    add(s.state, s, wanted);
    const std::uint32_t nx = c_.model->state_count, nu = c_.model->input_count;
    std::vector<double> gain(std::size_t{nu} * nx);
    if (o_.nearby == 0 || c_.model->quaternion_mask != 0 || !teacher_->feedback(gain.data(), nullptr)) return;
    for (std::uint32_t k = 0; k < o_.nearby; ++k) add_nearby(s, wanted, gain);
  }

  void add_nearby(const Situation& s, const double* wanted, const std::vector<double>& gain) {
    const std::uint32_t nx = c_.model->state_count, nu = c_.model->input_count;
    double x[TILLER_MAX_STATES], u[TILLER_MAX_INPUTS], off[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < nx; ++i) {
      off[i] = kNearby * std::hypot(c_.initial_state_sd[i], c_.process_sd[i] * std::sqrt(c_.period_s)) * rng_.normal();
      x[i] = s.state[i] + off[i];
    }
    for (std::uint32_t i = 0; i < nu; ++i) {
      u[i] = wanted[i];
      for (std::uint32_t j = 0; j < nx; ++j) u[i] += gain[std::size_t{i} * nx + j] * off[j];
    }
    add(x, s, u);
  }

  void add(const double* x, const Situation& s, const double* u) {
    fill_policy_inputs(c_, o_.reads, {x, s.param_mean, s.param_sd, s.last_command, s.step}, in_.data());
    Examples& e = result_.examples;
    e.in.insert(e.in.end(), in_.begin(), in_.end());
    for (std::uint32_t i = 0; i < c_.model->input_count; ++i) e.share.push_back(share_of(c_, i, u[i]));
    e.of.push_back(o_.number);
  }

  const tiller_config_t& c_;
  const LessonOptions& o_;
  LonePlanner *teacher_, *pupil_;
  Rng rng_;
  BeliefStory story_;
  LessonPlant plant_;
  std::vector<double> in_, hypotheses_;
  double command_[TILLER_MAX_INPUTS] = {}, push_[TILLER_MAX_INPUTS] = {};
  bool teacher_drives_ = true;
  std::uint32_t pushing_ = 0;
  LessonResult result_;
};

}  // namespace

void Examples::append(const Examples& more) {
  in.insert(in.end(), more.in.begin(), more.in.end());
  share.insert(share.end(), more.share.begin(), more.share.end());
  of.insert(of.end(), more.of.begin(), more.of.end());
}

LessonResult give_lesson(const tiller_config_t& config, const PriorMoments& prior, LonePlanner* teacher,
                         LonePlanner* pupil, const LessonOptions& options) {
  return Lesson(config, prior, teacher, pupil, options).run();
}

}  // namespace tiller::tools::distill
