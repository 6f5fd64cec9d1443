// Plants side by side: each thread's plant moves as if it were alone.
#include <cmath>
#include <thread>

#include "plants.hpp"

namespace tiller::sim {
namespace {

constexpr int kPlants = 8;

PlantOptions options_of(int index) {
  PlantOptions o = index % 2 == 0 ? pendulum() : cart_pole();
  o.initial_state["angle_rad"] = 0.3 + 0.2 * index;
  o.step_s = 0.0005;
  return o;
}

// Ten seconds of 20 ms periods, long enough that threads meet; the plant is made, moved and taken down in the thread
// that calls.
std::vector<double> motion_of(int index) {
  const auto plant = make(options_of(index));
  std::vector<double> motion;
  for (int k = 0; k < 500; ++k) {
    command(*plant, std::sin(0.1 * k + index));
    plant->advance(0.02);
    for (const double x : truth(*plant)) motion.push_back(x);
  }
  return motion;
}

TEST(Threads, PlantsSideBySideMoveAsEachAlone) {
  std::vector<std::vector<double>> alone, together(kPlants);
  for (int i = 0; i < kPlants; ++i) alone.push_back(motion_of(i));
  for (int round = 0; round < 5; ++round) {
    std::vector<std::thread> threads;
    for (int i = 0; i < kPlants; ++i)
      threads.emplace_back([&, i] { together[static_cast<std::size_t>(i)] = motion_of(i); });
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(together, alone) << "to the last bit";
  }
}

}  // namespace
}  // namespace tiller::sim
