#include "tools/distill/distill.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/base/thread_pool.hpp"

namespace tiller::tools::distill {
namespace {

constexpr std::uint64_t kValidation = 1u << 20;  // number of the first validation episode
constexpr double kShareFalls = 0.5;              // of the teacher at the wheel, from round to round
constexpr std::uint32_t kLastEpochs = 3;         // the last round's fit may take so many times as long

/// What all episodes of a call share, and each thread's own planners.
class School {
 public:
  School(const RobotFile& teacher, const DistillOptions& options)
      : teacher_(teacher), options_(options), prior_(prior_moments(teacher.config)), pool_(options.threads) {}

  /// `count` episodes from number `first` on; the pupil's planner is made from `pupil`, null: the teacher drives alone.
  /// `taught`: the teacher answers too.
  bool hold(std::uint64_t first, std::uint32_t count, const RobotFile* pupil, bool taught, LessonOptions how,
            std::vector<LessonResult>& results, std::string& error) {
    results.assign(count, {});
    job_ = {first, pupil, taught, how, &results, {}};
    job_.errors.assign(count, "");
    pool_.run(count, &School::episode, this);
    for (const std::string& one : job_.errors)
      if (error.empty()) error = one;
    return error.empty();
  }

 private:
  struct Job {
    std::uint64_t first = 0;
    const RobotFile* pupil = nullptr;
    bool taught = true;
    LessonOptions how;
    std::vector<LessonResult>* results = nullptr;
    std::vector<std::string> errors;
  };
  static void episode(void* self, std::uint32_t i) {
    School& s = *static_cast<School*>(self);
    Job& job = s.job_;
    std::unique_ptr<LonePlanner> teacher, pupil;
    if (job.taught) teacher = LonePlanner::make(s.teacher_.config, job.errors[i]);
    if (job.pupil) pupil = LonePlanner::make(job.pupil->config, job.errors[i]);
    if (!job.errors[i].empty()) return;
    LessonOptions how = job.how;
    how.number = static_cast<std::uint32_t>(job.first + i);
    (*job.results)[i] = give_lesson(s.teacher_.config, s.prior_, teacher.get(), pupil.get(), how);
  }

  const RobotFile& teacher_;
  const DistillOptions& options_;
  const PriorMoments prior_;
  ThreadPool pool_;
  Job job_;
};

double mean_cost(const std::vector<LessonResult>& results) {
  double sum = 0;
  for (const LessonResult& r : results) sum += r.cost;
  return sum / static_cast<double>(results.size());
}

std::string round_text(const DistillOptions& o, std::size_t k, const Round& round) {
  return "round " + std::to_string(k + 1) + " of " + std::to_string(o.iterations) + ": " +
         std::to_string(round.samples) + " samples, error " + error_text(round.error) +
         " of half the range, cost over the teacher's " + format("%.3f", round.cost_ratio);
}

/// The whole course.
class Course {
 public:
  Course(const RobotFile& teacher, const DistillOptions& options, const volatile std::sig_atomic_t& stop)
      : teacher_(teacher),
        options_(options),
        stop_(stop),
        school_(teacher, options),
        pupil_(teacher, options.reads, options.hidden, options.seed) {}

  bool take(Distilled& result, std::string& error) {
    std::vector<LessonResult> exam;
    if (!school_.hold(kValidation, options_.validation, nullptr, true, undisturbed(), exam, error)) return false;
    const double par = mean_cost(exam);
    double best = std::numeric_limits<double>::infinity();
    for (std::uint32_t k = 0; k < options_.iterations; ++k) {
      if (stop_ != 0) return result.interrupted = true;
      Round round;
      if (!learn(k, round, error) || !examine(par, round, error)) return false;
      result.rounds.push_back(round);
      if (options_.progress) options_.progress(round_text(options_, k, round));
      // a round that nobody could judge is no worse than none
      if (!(round.cost_ratio < best) && k > 0) continue;
      best = round.cost_ratio;
      result.best = k;
      result.policy = pupil_.stored();
    }
    return true;
  }

 private:
  LessonOptions undisturbed() const {
    LessonOptions how;
    how.seed = options_.seed;
    how.seconds = options_.seconds;
    how.reads = options_.reads;
    how.pushes_per_s = 0;
    how.nearby = 0;
    return how;
  }

  bool learn(std::uint32_t k, Round& round, std::string& error) {
    LessonOptions how = undisturbed();
    how.pushes_per_s = LessonOptions{}.pushes_per_s;
    how.nearby = LessonOptions{}.nearby;
    how.teacher_share = std::pow(kShareFalls, k);
    std::vector<LessonResult> lessons;
    const std::uint64_t first = std::uint64_t{k} * options_.episodes;
    if (!school_.hold(first, options_.episodes, k > 0 ? &driving_ : nullptr, true, how, lessons, error)) return false;
    for (const LessonResult& lesson : lessons) examples_.append(lesson.examples);
    round.samples = examples_.count();
    if (round.samples == 0) return error = "the teacher had no finite plan in any episode; tiller run shows why", false;
    StudyOptions study;
    study.seed = options_.seed + k;
    if (k + 1 == options_.iterations) study.epochs *= kLastEpochs;
    round.error = pupil_.study(examples_, study);
    return with_policy(teacher_, pupil_.stored(), driving_, error);
  }

  bool examine(double par, Round& round, std::string& error) {
    std::vector<LessonResult> exam;
    if (!school_.hold(kValidation, options_.validation, &driving_, false, undisturbed(), exam, error)) return false;
    round.cost_ratio = mean_cost(exam) / par;
    return true;
  }

  const RobotFile& teacher_;
  const DistillOptions& options_;
  const volatile std::sig_atomic_t& stop_;
  School school_;
  Pupil pupil_;
  RobotFile driving_;
  Examples examples_;
};

}  // namespace

std::uint32_t default_reads(const RobotFile& robot) {
  std::uint32_t reads = tiller_policy_state;
  if (robot.config.cost.reference) reads |= tiller_policy_goal;
  for (std::uint32_t p = 0; p < robot.config.param_count; ++p)
    if (robot.config.priors[p].kind != tiller_prior_fixed)
      reads |= tiller_policy_belief_mean | tiller_policy_belief_spread;
  return reads;
}

bool with_teacher(const RobotFile& robot, const std::string& teacher, RobotFile& out, std::string& error) {
  out = robot;
  Words known;
  if (!teacher.empty()) out.config.planner.kind = tiller_planner_kind_count;
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    if (!find_planner(kind) || kind == tiller_planner_policy) continue;
    known.emplace_back(find_planner(kind)->name);
    if (known.back() == teacher) out.config.planner.kind = kind;
  }
  if (out.config.planner.kind < tiller_planner_kind_count && out.config.planner.kind != tiller_planner_policy)
    return true;
  error = (teacher.empty() ? std::string("the robot file's planner is a policy") : "there is no teacher " + teacher) +
          "; name one of " + join(known) + " with --teacher";
  return false;
}

bool with_policy(const RobotFile& robot, const StoredPolicy& policy, RobotFile& out, std::string& error) {
  out = robot;
  out.config.planner.kind = out.config.planner.fallback = tiller_planner_policy;
  return take_policy(policy, out, error);
}

bool distill(const RobotFile& robot, const DistillOptions& asked, const volatile std::sig_atomic_t& stop,
             Distilled& result, std::string& error) {
  DistillOptions options = asked;
  if (options.reads == 0) options.reads = default_reads(robot);
  RobotFile teacher, policy;
  if (!with_teacher(robot, options.teacher, teacher, error)) return false;
  if (!Course(teacher, options, stop).take(result, error)) return false;
  if (result.interrupted) return true;
  if (!with_policy(teacher, result.policy, policy, error)) return false;
  for (std::uint32_t i = 0; i < options.test && stop == 0; ++i) {
    HeldOut one;
    const std::uint64_t seed = kValidation + options.seed * 1000 + i;
    if (!play_held_out(teacher, policy, seed, options.seconds, stop, one, error)) return false;
    result.tests.push_back(one);
    if (options.progress)
      options.progress("held-out draw " + std::to_string(i + 1) + " of " + std::to_string(options.test) +
                       ": cost over the teacher's " + format("%.3f", one.policy_cost / one.teacher_cost));
  }
  result.interrupted = stop != 0;
  return true;
}

}  // namespace tiller::tools::distill
