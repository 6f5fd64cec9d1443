// The kernel's receive stamps have to arrive where they matter: in the likelihood (how long the plant moved between
// two readings) and in delay compensation (from which state the plan starts). A pendulum swings in wall time; its
// readings wait in the socket for a random time before they are looked at. Two controllers get the same readings: one
// with the stamps of the transport, one with the time of reading. Runs in wall time, so its thresholds leave room for
// a machine that stands still now and then.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <new>
#include <vector>

#include "bus_fault_wires.hpp"
#include "io/monotonic_clock.hpp"

namespace tiller::faults {
namespace {

constexpr double kPeriod_s = 0.1, kNoise_rad = 0.02;
constexpr int kReadings = 70, kSettled = 20;
constexpr std::int64_t kLongestWait_us = 90000;
constexpr std::int64_t kPause_us = 3000;  // the machine stood still between measuring and sending: not a reading

void sleep_us(std::int64_t us) {
  const timespec pause{us / 1000000, (us % 1000000) * 1000};
  nanosleep(&pause, nullptr);
}

tiller_prior_t exactly(double value) { return {tiller_prior_fixed, 0, value, 0.0, value, value}; }

Setup swinging(std::uint64_t seed) {
  Setup s = setup_of(Robot::kPendulum, seed);
  shrink(s);
  s.config.period_s = kPeriod_s;
  s.config.substeps = 4;
  s.config.measurement_sd[0] = kNoise_rad;
  // the state alone is to be found: what is wrong with it is then the stamps' fault
  s.config.priors[0] = exactly(s.plant.parameters["mass_kg"]);
  s.config.priors[2] = exactly(s.plant.parameters["damping_Nms"]);
  s.config.initial_state_sd[1] = 5.0;
  s.config.initial_state[0] = 1.5;
  s.config.initial_state_sd[0] = 0.1;
  s.config.planner.kind = tiller_planner_ilqr;
  s.config.safety.input_low[0] = -1e-6;  // it may plan, and not push: the motion is the pendulum's own
  s.config.safety.input_high[0] = 1e-6;
  s.config.safety.sensor_timeout_s = 5.0;
  s.plant.initial_state["angle_rad"] = 1.5;
  s.plant.encoder_noise_sd["angle_rad"] = kNoise_rad;
  return s;
}

struct Controller {
  explicit Controller(const Setup& s) {
    const std::size_t size = tiller_size(&s.config);
    block = ::operator new (size, std::align_val_t{TILLER_ALIGNMENT});
    EXPECT_EQ(tiller_status_ok, tiller_init(&t, &s.config, nullptr, block, size));
    (void)tiller_arm(t);
  }
  ~Controller() { ::operator delete (block, std::align_val_t{TILLER_ALIGNMENT}); }
  Controller(const Controller&) = delete;
  Controller& operator=(const Controller&) = delete;

  /// The state from which it plans after this reading.
  double planned_from_rad(std::int64_t now_us, const tiller_measurement_t& m) {
    tiller_command_t command;
    (void)tiller_tick(t, now_us, &m, &command);
    double state[TILLER_MAX_STATES] = {};
    EXPECT_EQ(tiller_status_ok, tiller_get_feedback(t, 0, nullptr, state, nullptr));
    return state[0];
  }
  double noise_scale() const {
    tiller_info_t info;
    tiller_get_info(t, &info);
    return info.noise_scale;
  }

  tiller_t* t = nullptr;
  void* block = nullptr;
};

class Swing {
 public:
  explicit Swing(std::uint64_t seed) : setup_(swinging(seed)), random_(seed), stamped_(setup_), unstamped_(setup_) {
    std::string error;
    plant_ = sim::Plant::make(setup_.plant, error);
    SocketCanOptions options;
    options.interface = "vx1";
    options.layout = bus_layout(setup_);
    options.layout.stamp_on_arrival = true;
    OpenError problem;
    EXPECT_EQ(tiller_status_ok, socketcan_open(&transport_, options, &problem)) << problem.text;
    EXPECT_TRUE(port_.open("vx0"));
    began_us_ = monotonic_us();
  }
  ~Swing() { kSocketCanTransport.close(&transport_); }

  void run() {
    Device device(*plant_, 0.0);
    BusPlant bus(device);
    for (std::uint32_t k = 1; k <= kReadings; ++k) {
      const std::int64_t sent_us = send_reading(bus);
      sleep_us(random_.below(kLongestWait_us));
      tiller_measurement_t m{};
      ASSERT_EQ(tiller_status_ok, kSocketCanTransport.poll(&transport_, &m));
      take(k, sent_us, m);
      const std::int64_t left_us = sent_us + static_cast<std::int64_t>(1e6 * kPeriod_s) - monotonic_us();
      if (left_us > 0) sleep_us(left_us);
    }
  }

  double stamped_off_rad() { return median(stamped_off_); }
  double unstamped_off_rad() { return median(unstamped_off_); }
  double stamped_noise() const { return stamped_.noise_scale(); }
  double unstamped_noise() const { return unstamped_.noise_scale(); }
  std::int64_t oldest_us() const { return oldest_us_; }

 private:
  /// When it was measured. A reading that was held up between the pendulum and the wire is followed by another.
  std::int64_t send_reading(BusPlant& bus) {
    for (int attempt = 0;; ++attempt) {
      const std::int64_t now_us = monotonic_us();
      catch_up(now_us);
      tiller_measurement_t sent{};
      sent.sequence = ++sequence_;
      plant_->measure(sent.value);
      for (const CanFrame& f : bus.frames(sent)) (void)port_.send(f.id, f.data, f.length);
      if (monotonic_us() - now_us < kPause_us || attempt == 20) return now_us;
    }
  }
  static double median(std::vector<double>& values) {
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    return values[values.size() / 2];
  }
  void catch_up(std::int64_t now_us) {
    plant_->advance(1e-6 * static_cast<double>(now_us - began_us_ - moved_us_));
    moved_us_ = now_us - began_us_;
  }

  void take(std::uint32_t k, std::int64_t sent_us, tiller_measurement_t m) {
    const std::int64_t now_us = monotonic_us();
    EXPECT_NEAR(static_cast<double>(m.stamp_us), static_cast<double>(sent_us), 2.0 * kPause_us);
    oldest_us_ = std::max(oldest_us_, now_us - m.stamp_us);
    const double stamped_rad = stamped_.planned_from_rad(now_us, m);
    m.stamp_us = now_us;
    const double unstamped_rad = unstamped_.planned_from_rad(now_us, m);
    if (k <= kSettled) return;
    catch_up(now_us);
    double truth[TILLER_MAX_STATES];
    plant_->true_state(truth);
    stamped_off_.push_back(std::fabs(stamped_rad - truth[0]));
    unstamped_off_.push_back(std::fabs(unstamped_rad - truth[0]));
  }

  Setup setup_;
  Random random_;
  std::unique_ptr<sim::Plant> plant_;
  Controller stamped_, unstamped_;
  SocketCanTransport transport_;
  RawPort port_;
  std::int64_t began_us_ = 0, moved_us_ = 0, oldest_us_ = 0;
  std::vector<double> stamped_off_, unstamped_off_;
  std::uint32_t sequence_ = 0;
};

// At some 2 rad/s, 45 ms in the mean are 0.1 rad, five deviations of the encoder: that much the likelihood without
// stamps has to explain as noise, and so far from the truth its plans begin. With stamps the noise is the encoder's,
// and a plan begins as near as a state estimated from it and carried on for 90 ms: a deviation or two.
TEST(RxStamps, ReachTheLikelihoodAndDelayCompensation) {
  restore_wires();
  Swing swing(1);
  ASSERT_NO_FATAL_FAILURE(swing.run());
  const double off_rad = swing.stamped_off_rad(), unstamped_off_rad = swing.unstamped_off_rad();
  std::printf(
      "plans begin %.4f rad from the truth, %.4f without stamps (medians); noise %.2f and %.2f times "
      "the configured; readings up to %.0f ms old\n",
      off_rad, unstamped_off_rad, swing.stamped_noise(), swing.unstamped_noise(),
      1e-3 * static_cast<double>(swing.oldest_us()));
  EXPECT_GT(swing.oldest_us(), kLongestWait_us / 2);
  EXPECT_LT(off_rad, 2.0 * kNoise_rad);
  EXPECT_GT(unstamped_off_rad, 2.0 * off_rad);
  EXPECT_LT(swing.stamped_noise(), 1.5);
  EXPECT_GT(swing.unstamped_noise(), 1.5 * swing.stamped_noise());
}

}  // namespace
}  // namespace tiller::faults
