#include "sim/servers/sensor_board.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

namespace tiller::sim {
namespace {

constexpr std::uint32_t node = 48;

std::int32_t reading(const CanFrame& f) {
  std::int32_t value;
  std::memcpy(&value, f.data.data(), 4);
  return value;
}

TEST(SensorBoard, SendsAStampAndMicroUnits) {
  const PlantMeasurement m{0x1'2345'6789, 0x00020003, {-0.0012345, 3.1415926535}};
  const CanFrames frames = sensor_frames(node, m);
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_EQ(frames[0].id, node << 5);
  std::uint32_t words[2];
  std::memcpy(words, frames[0].data.data(), 8);
  EXPECT_EQ(words[0], 0x23456789u);
  EXPECT_EQ(words[1], 0x00020003u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(frames[i + 1].id, node << 5 | (16 + i));
    EXPECT_EQ(frames[i + 1].data[4] | frames[i + 1].data[5] << 8, 3);
    EXPECT_EQ(frames[i + 1].data[6], 1);
  }
  // to the nearest micro-unit: the frame's resolution
  EXPECT_EQ(reading(frames[1]), -1235);
  EXPECT_EQ(reading(frames[2]), 3141593);
}

TEST(SensorBoard, WhatDoesNotFitIsMarkedNotValid) {
  for (const double value : {2148.0, -2148.0, std::nan(""), HUGE_VAL}) {
    const CanFrames frames = sensor_frames(node, {0, 0, {value}});
    EXPECT_EQ(frames[1].data[6], 0) << value;
    EXPECT_EQ(reading(frames[1]), 0) << value;
  }
  EXPECT_EQ(sensor_frames(node, {0, 0, {-2147.0}})[1].data[6], 1);
}

TEST(SensorBoard, ReadsTheControllersStatus) {
  CanFrame f;
  f.id = node << 5 | 1u;
  f.length = 8;
  f.data = {0x04, 0x03, 0x02, 0x01, 2, 1, 200, 0};
  PlantCommand answered;
  EXPECT_TRUE(read_controller_status(node, f, answered));
  EXPECT_EQ(answered.sequence, 0x01020304);
  EXPECT_EQ(answered.state, 2);
  EXPECT_EQ(answered.plan, 200);
  EXPECT_FALSE(answered.has_value);
  EXPECT_FALSE(read_controller_status(node + 1, f, answered));
  f.length = 3;
  EXPECT_FALSE(read_controller_status(node, f, answered));
  f.length = 8;
  f.remote = true;
  EXPECT_FALSE(read_controller_status(node, f, answered));
}

}  // namespace
}  // namespace tiller::sim
