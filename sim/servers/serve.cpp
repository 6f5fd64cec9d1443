#include "sim/servers/serve.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "sim/servers/plan_watch.hpp"

namespace tiller::sim {
namespace {

constexpr std::int64_t lockstep_epoch_us = 1'000'000;
// how long a wait may last before the stop flag is looked at again
constexpr std::int64_t look_up_us = 50'000;

std::int64_t monotonic_us() {
  using std::chrono::duration_cast, std::chrono::microseconds, std::chrono::steady_clock;
  return duration_cast<microseconds>(steady_clock::now().time_since_epoch()).count();
}

std::int64_t to_us(double seconds) { return std::llround(seconds * 1e6); }

class Server {
 public:
  Server(Plant& plant, PlantLink& link, const ServeOptions& options, ServeReport& report)
      : plant_(plant), link_(link), options_(options), report_(report), watch_(to_us(options.plan_timeout_s)) {
    measurement_.value.resize(plant.measurements().size());
  }

  int run() {
    if (!(options_.period_s >= plant_.options().step_s)) {
      report_.error = "period_s must be at least one physics step";
      return 1;
    }
    while (!over() && (options_.lockstep ? lockstep_period() : real_time_period())) {
    }
    report_.error = link_.error();
    return report_.error.empty() ? 0 : 1;
  }

 private:
  std::int64_t wall_us() const { return options_.now_us ? options_.now_us() : monotonic_us(); }
  bool stopped() const { return options_.stop != nullptr && *options_.stop != 0; }
  bool over() const { return stopped() || (options_.duration_s > 0 && plant_.time_us() >= to_us(options_.duration_s)); }

  void read_encoders(std::int64_t epoch_us) {
    measurement_.stamp_us = epoch_us + plant_.measured_us();
    plant_.measure(measurement_.value.data());
  }

  bool usable(const PlantCommand& command) {
    if (!command.has_value) return true;
    const bool finite =
        std::all_of(command.value.begin(), command.value.end(), [](double v) { return std::isfinite(v); });
    if (finite && command.value.size() == plant_.commands().size()) return true;
    ++report_.bad_commands;
    return false;
  }

  void apply(const PlantCommand& command) {
    watch_.note(command, plant_.time_us());
    if (!command.has_value) return;
    if (watch_.hung(plant_.time_us())) {
      ++report_.hung_commands;
      return;
    }
    plant_.apply(command.value.data());
    ++report_.commands;
    if (!options_.lockstep) note_latency(command.sequence);
  }

  /// A controller that is told when its commands take hold learns from the right ones.
  void note_latency(std::int64_t sequence) {
    const std::int64_t behind = measurement_.sequence - sequence;
    if (sequence == PlantCommand::kUnnumbered || behind < 0 || behind >= kStamps) return;
    const std::int64_t taken_us = start_us_ + plant_.time_us() - stamps_us_[sequence % kStamps];
    if (taken_us < 0) return;
    // over about ten periods: one that was held up by the machine says little of the next
    mean_us_ += (static_cast<double>(taken_us) - mean_us_) / static_cast<double>(std::min(++answers_, kMeanOver));
    measurement_.answer_us = std::llround(mean_us_);
  }

  void end_period() {
    ++report_.periods;
    ++measurement_.sequence;
    link_.after_period(plant_);
    if (options_.on_period) options_.on_period(plant_, measurement_);
  }

  /// True when the answer to the current measurement came before the deadline.
  bool wait_for_answer(std::int64_t deadline_us) {
    PlantCommand command;
    while (!stopped() && link_.error().empty()) {
      const std::int64_t left_us = deadline_us - wall_us();
      if (!link_.receive(command, std::clamp<std::int64_t>(left_us, 0, look_up_us))) {
        if (left_us <= 0) return false;
      } else if (command.sequence != measurement_.sequence && command.sequence != PlantCommand::kUnnumbered) {
        ++report_.stale_commands;
      } else if (usable(command)) {
        apply(command);
        if (command.sequence != PlantCommand::kUnnumbered) return answered_ = true;
      }
    }
    return false;
  }

  /// When the current measurement is sent again, or waited for no longer.
  std::int64_t next_look_us(std::int64_t give_up_us) const {
    const std::int64_t repeat_us = wall_us() + to_us(options_.repeat_s);
    if (!answered_) return repeat_us;
    return link_.is_lossy() ? std::min(repeat_us, give_up_us) : give_up_us;
  }

  /// Publishes the measurement until its answer is there, or the time for it is over. False: the end of it all.
  bool ask() {
    const std::int64_t give_up_us = wall_us() + to_us(options_.answer_timeout_s);
    while (link_.publish(measurement_)) {
      if (wait_for_answer(next_look_us(give_up_us))) return true;
      if (stopped() || !link_.error().empty()) return false;
      if (answered_ && wall_us() >= give_up_us) {
        ++report_.missing_answers;
        return true;
      }
      ++report_.repeats;
    }
    return false;
  }

  /// Waits until the wall clock has caught up. What arrives meanwhile answers nothing.
  void keep_pace() {
    if (options_.pace <= 0) return;
    const std::int64_t since_us = wall_us() - start_us_;
    const std::int64_t period_us = to_us(options_.period_s / options_.pace);
    const bool late = start_us_ == 0 || since_us > period_us;
    start_us_ = late ? wall_us() : start_us_ + period_us;  // the begin of this period; lost time is not made up for
    PlantCommand command;
    for (std::int64_t left_us; !stopped() && link_.error().empty() && (left_us = start_us_ - wall_us()) > 0;)
      if (link_.receive(command, std::min(left_us, look_up_us))) ++report_.stale_commands;
  }

  bool lockstep_period() {
    keep_pace();
    read_encoders(lockstep_epoch_us);
    if (!ask()) return false;
    plant_.advance(options_.period_s);
    end_period();
    return true;
  }

  /// The bodies follow the wall clock; a command acts from the moment at which it arrives.
  void catch_up() {
    // counted here and not by plant_.time_us(), which leaves out what the plant carries to its next step
    const std::int64_t behind_us = wall_us() - start_us_ - advanced_us_;
    if (behind_us <= 0) return;
    plant_.advance(1e-6 * static_cast<double>(behind_us));
    advanced_us_ += behind_us;
  }

  /// Lets time pass and takes what arrives meanwhile. False: the link has an error.
  bool wait_until(std::int64_t until_us) {
    PlantCommand command;
    for (std::int64_t left_us; !stopped() && (left_us = until_us - wall_us()) > 0;) {
      const bool received = link_.receive(command, std::min(left_us, look_up_us));
      if (!link_.error().empty()) return false;
      catch_up();
      if (received && usable(command)) apply(command);
    }
    return true;
  }

  bool real_time_period() {
    if (start_us_ == 0) start_us_ = due_us_ = wall_us();
    const std::int64_t period_us = to_us(options_.period_s);
    if (wall_us() - due_us_ > period_us) {
      // a burst of readings would not bring back the time that the machine has lost
      ++report_.late_periods;
      due_us_ = wall_us();
    }
    due_us_ += period_us;
    catch_up();
    // after a period that was late the bodies may not have taken a step yet: the same reading would be sent twice
    const std::int64_t step_us = std::max<std::int64_t>(1, to_us(plant_.options().step_s));
    while (report_.periods > 0 && !stopped() && start_us_ + plant_.measured_us() <= measurement_.stamp_us)
      if (!wait_until(wall_us() + step_us)) return false;
    if (stopped()) return false;
    read_encoders(start_us_);
    stamps_us_[measurement_.sequence % kStamps] = measurement_.stamp_us;
    if (!link_.publish(measurement_)) return false;
    if (!wait_until(due_us_)) return false;
    end_period();
    return true;
  }

  static constexpr std::int64_t kStamps = 16;
  static constexpr int kMeanOver = 10;

  Plant& plant_;
  PlantLink& link_;
  const ServeOptions& options_;
  ServeReport& report_;
  PlanWatch watch_;
  PlantMeasurement measurement_{0, 0, {}};
  bool answered_ = false;
  std::int64_t stamps_us_[kStamps] = {};  // of the last measurements, by their sequence
  double mean_us_ = 0;                    // from stamp to command
  int answers_ = 0;
  std::int64_t start_us_ = 0;     // the wall clock; real time: at plant time zero; lockstep: at the begin of the period
  std::int64_t due_us_ = 0;       // real time: when the current period ends
  std::int64_t advanced_us_ = 0;  // real time: asked of the plant so far
};

}  // namespace

int serve(Plant& plant, PlantLink& link, const ServeOptions& options, ServeReport& report) {
  report = ServeReport{};
  return Server(plant, link, options, report).run();
}

}  // namespace tiller::sim
