#include <cmath>
#include <limits>
#include <vector>

#include "tools/links/link.hpp"

namespace tiller::tools {
namespace {

class SimLink : public Link {
 public:
  SimLink(const RobotFile& robot, SimPlant& plant, bool paced)
      : plant_(plant),
        period_s_(robot.config.period_s),
        paced_(paced),
        timer_(std::llround(1e9 * robot.config.period_s)),
        raw_(plant.plant->measurements().size()),
        states_(plant.plant->states().size()) {}

  Sensed wait(const volatile std::sig_atomic_t& stop) override {
    sim::Plant& plant = *plant_.plant;
    if (begun_) plant.advance(period_s_);
    // a late tick is not made up for by hurrying: simulated time then runs slower than the wall clock, and the run is
    // the same to the last bit
    if (paced_) (void)timer_.wait(&stop);
    begun_ = true;
    Sensed sensed;
    sensed.now_us = kEpochUs + plant.time_us();
    const std::int64_t stamp_us = kEpochUs + plant.measured_us();
    sensed.fresh = stamp_us > last_stamp_us_;  // before a latency has passed, the encoders repeat themselves
    if (!sensed.fresh) return sensed;
    last_stamp_us_ = stamp_us;
    read(sensed.measurement, stamp_us, sensed.now_us);
    return sensed;
  }

  tiller_status_t send(const tiller_command_t& command) override {
    plant_.plant->apply(command.value);
    return tiller_status_ok;
  }

  const PeriodicTimer* timer() const override { return paced_ ? &timer_ : nullptr; }

  bool truth(double* state) const override {
    plant_.plant->true_state(states_.data());
    for (std::size_t i = 0; i < plant_.state_from.size(); ++i) {
      const int from = plant_.state_from[i];
      state[i] = from < 0 ? std::numeric_limits<double>::quiet_NaN() : states_[static_cast<std::size_t>(from)];
    }
    return true;
  }

 private:
  static constexpr std::int64_t kEpochUs = 1000000;  // no stamp is zero or negative

  void read(tiller_measurement_t& m, std::int64_t stamp_us, std::int64_t now_us) {
    plant_.plant->measure(raw_.data());
    m.stamp_us = stamp_us;
    m.sequence = sequence_++;
    const double latency_us = 1e6 * plant_.plant->options().command_latency_s;
    m.command_latency_us = static_cast<std::uint32_t>(now_us - stamp_us + static_cast<std::int64_t>(latency_us));
    for (std::size_t i = 0; i < plant_.measured_from.size(); ++i) m.value[i] = raw_[plant_.measured_from[i]];
  }

  SimPlant& plant_;
  double period_s_;
  bool paced_;
  PeriodicTimer timer_;
  bool begun_ = false;
  std::uint32_t sequence_ = 0;
  std::int64_t last_stamp_us_ = 0;
  std::vector<double> raw_;
  mutable std::vector<double> states_;
};

}  // namespace

std::unique_ptr<Link> make_sim_link(const RobotFile& robot, SimPlant& plant, bool paced) {
  return std::make_unique<SimLink>(robot, plant, paced);
}

}  // namespace tiller::tools
