#include "tools/tune/tune.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/thread_pool.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/tune/evolution.hpp"
#include "tools/tune/number_edit.hpp"
#include "tools/tune/tune_episode.hpp"

namespace tiller::tools::tune {
namespace {

constexpr double kFirstSigma =
    0.25;  // of the cube: most of the first generation lies in the middle half around the file

class Search {
 public:
  Search(const RobotFile& robot, const std::string& text, const TuneOptions& options,
         const volatile std::sig_atomic_t& stop)
      : robot_(robot), text_(text), options_(options), stop_(stop), threads_(std::max(1u, options.threads)) {}

  bool run(Tuned& result, std::string& error) {
    if (!open_log(error)) return false;
    Evolution evolution(start(), kFirstSigma, options_.first_seed);
    if (!go(file_values(), error)) return ended(result, error);
    while (trials_.size() < options_.trials) {
      const std::vector<double> points = evolution.ask();
      std::vector<double> returns;
      for (std::size_t k = 0; k < evolution.population() && trials_.size() < options_.trials; ++k) {
        if (!go(values_at(points.data() + k * options_.keys.size()), error)) return ended(result, error);
        returns.push_back(trials_.back().mean());
      }
      if (returns.size() == evolution.population()) evolution.tell(points, returns);
    }
    return conclude(result, error);
  }

 private:
  bool open_log(std::string& error) {
    const std::string settings = settings_text(text_, options_);
    return options_.resume ? log_.resume(options_.log, settings, options_.keys, options_.train, error)
                           : log_.create(options_.log, settings, options_.keys, options_.train, error);
  }

  bool ended(Tuned& result, const std::string& error) const {
    result.trials = trials_;
    result.interrupted = error.empty();
    return result.interrupted;
  }

  /// The file's own values in the cube; the middle for a key that the file leaves to its default.
  std::vector<double> start() const {
    std::vector<double> v;
    for (const SearchKey& key : options_.keys) {
      NumberAt at;
      std::string none;
      const double own = find_number(text_, key.path, at, none) ? key.coordinate(at.value) : 0.5;
      v.push_back(std::min(std::max(own, 0.0), 1.0));
    }
    return v;
  }

  /// As they stand in the file; empty: left to the default.
  Words file_values() const {
    Words values;
    for (const SearchKey& key : options_.keys) {
      NumberAt at;
      std::string none;
      values.push_back(find_number(text_, key.path, at, none) ? text_.substr(at.from, at.to - at.from) : "");
    }
    return values;
  }

  Words values_at(const double* v) const {
    Words values;
    for (std::size_t j = 0; j < options_.keys.size(); ++j) values.push_back(options_.keys[j].text(v[j]));
    return values;
  }

  std::string text_with(const Words& values, std::string& error) const {
    std::string text = text_;
    for (std::size_t j = 0; j < values.size(); ++j)
      if (!values[j].empty() && !set_number(text, options_.keys[j].path, values[j], error)) break;
    return text;
  }

  /// One trial: from the log where it is there, else by episodes. False: stopped, or `error` says why.
  bool go(const Words& values, std::string& error) {
    const std::size_t index = trials_.size();
    if (index < log_.trials().size()) {
      if (log_.trials()[index].values != values) {
        error = options_.log + ": trial " + std::to_string(index + 1) +
                " is not the one that this search makes; it is of another version of tiller: name another file with "
                "--log";
        return false;
      }
      trials_.push_back(log_.trials()[index]);
      return true;
    }
    Trial trial;
    if (!play_all(values, options_.first_seed, options_.train, trial, error) || !log_.add(trial, error)) return false;
    trials_.push_back(trial);
    if (options_.progress) options_.progress(index, trials_);
    return true;
  }

  /// Episodes on `count` seeds side by side. Settings that the robot file refuses make no episode and no error.
  bool play_all(const Words& values, std::uint64_t first, std::uint32_t count, Trial& trial, std::string& error) {
    trial = {};
    trial.values = values;
    std::string why;
    const std::string text = text_with(values, why);
    const auto changed = why.empty() ? parse_robot_file(text, robot_.path, why) : nullptr;
    if (!changed) {
      trial.refused = why.empty() ? "refused" : why;
      return true;
    }
    Batch batch{*changed, robot_.config, options_.seconds, first, stop_, std::vector<Outcome>(count)};
    threads_.run(count, &Batch::work, &batch);
    if (stop_ != 0) return false;
    for (const Outcome& outcome : batch.outcomes) {
      if (!outcome.error.empty()) {
        error = outcome.error;
        return false;
      }
      trial.scores.push_back(outcome.score);
      trial.safe += outcome.safe ? 1 : 0;
    }
    return true;
  }

  struct Batch {
    const RobotFile& robot;
    const tiller_config_t& judge;
    double seconds;
    std::uint64_t first;
    const volatile std::sig_atomic_t& stop;
    std::vector<Outcome> outcomes;
    static void work(void* arg, std::uint32_t index) {
      auto& batch = *static_cast<Batch*>(arg);
      batch.outcomes[index] = play(seeded(batch.robot, batch.first + index), batch.judge, batch.seconds, batch.stop);
    }
  };

  bool conclude(Tuned& result, std::string& error) {
    result.trials = trials_;
    for (std::size_t k = 1; k < trials_.size(); ++k)
      if (trials_[k].mean() > trials_[result.best].mean()) result.best = k;
    if (!judge(trials_[0], result.before, error)) return ended(result, error);
    if (result.best == 0) return true;
    if (!judge(trials_[result.best], result.after, error)) return ended(result, error);
    result.text = text_with(trials_[result.best].values, error);
    return error.empty();
  }

  bool judge(const Trial& trial, Judged& judged, std::string& error) {
    judged.values = trial.values;
    judged.train = trial;
    return play_all(trial.values, options_.first_seed + options_.train, options_.test, judged.test, error);
  }

  const RobotFile& robot_;
  const std::string& text_;
  const TuneOptions& options_;
  const volatile std::sig_atomic_t& stop_;
  ThreadPool threads_;
  TrialLog log_;
  std::vector<Trial> trials_;
};

}  // namespace

bool tune(const RobotFile& robot, const std::string& text, const TuneOptions& options,
          const volatile std::sig_atomic_t& stop, Tuned& result, std::string& error) {
  result = {};
  return Search(robot, text, options, stop).run(result, error);
}

}  // namespace tiller::tools::tune
