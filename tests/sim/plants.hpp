#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "sim/plant/plant.hpp"

namespace tiller::sim {

inline std::unique_ptr<Plant> make(const PlantOptions& options) {
  std::string error;
  auto plant = Plant::make(options, error);
  EXPECT_NE(plant, nullptr) << error;
  return plant;
}

inline PlantOptions pendulum() {
  PlantOptions o;
  o.kind = "pendulum";
  o.watchdog_timeout_s = 0;  // tests that hold one command for long; device_test.cpp covers the watchdog
  return o;
}

inline PlantOptions cart_pole() {
  PlantOptions o;
  o.kind = "cart_pole";
  o.watchdog_timeout_s = 0;
  return o;
}

inline void command(Plant& plant, double value) { plant.apply(&value); }

inline std::vector<double> truth(const Plant& plant) {
  std::vector<double> x(plant.states().size());
  plant.true_state(x.data());
  return x;
}

inline std::vector<double> reading(const Plant& plant) {
  std::vector<double> y(plant.measurements().size());
  plant.measure(y.data());
  return y;
}

inline double motor(const Plant& plant) {
  double force = 0;
  plant.motor(&force);
  return force;
}

}  // namespace tiller::sim
