#include <gtest/gtest.h>

#include <limits>

#include "core/input_cone.hpp"
#include "safety/answer.h"

namespace tiller {
namespace {

// What OutputGate never asks of the proven core, because its constructor refuses such cones: see docs/safety/proof.md.

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kPeriod_s = 0.02;

/// One input in [0.5, 2] with a rate of 10/s, safe at 1.
tiller_gate_t one_input() {
  tiller_gate_t gate{};
  gate.count = 1;
  gate.low[0] = 0.5, gate.high[0] = 2.0, gate.rate_per_s[0] = 10.0, gate.safe_command[0] = 1.0;
  gate.period_s = kPeriod_s;
  tiller_gate_settle(&gate);
  return gate;
}

const tiller_gate_cones_t* as_cones(const InputCones& cones) {
  return reinterpret_cast<const tiller_gate_cones_t*>(&cones);
}

TEST(GateCore, WhatConesTakeOutsideTheLimitsDoesNotGoOut) {
  const tiller_input_cone_t nothing = {0b1, 0, 0.0, 0.0};  // leaves 0 alone, which is below the limit
  const InputCones cones = make_input_cones(&nothing, 1);
  tiller_gate_t gate = one_input();
  gate.rate_per_s[0] = kInf;
  const double wanted[] = {1.5};
  double out[] = {0.0};
  EXPECT_EQ(tiller_gate_pass(&gate, as_cones(cones), wanted, wanted, kPeriod_s, out), tiller_status_command_not_finite);
  EXPECT_EQ(out[0], 1.0) << "the command in force stays";
  EXPECT_EQ(gate.last[0], 1.0);
  EXPECT_EQ(gate.cuts, 1u);
  EXPECT_EQ(tiller_gate_pass(&gate, nullptr, wanted, wanted, kPeriod_s, out), tiller_status_ok);
  EXPECT_EQ(out[0], 1.5);
}

TEST(GateCore, ASafeCommandThatConesTakeOutsideTheLimitsIsNotTaken) {
  tiller_gate_t gate = one_input();
  for (const double outside : {0.0, 3.0, kInf, std::numeric_limits<double>::quiet_NaN()}) {
    tiller_gate_begin(&gate, &outside);
    EXPECT_EQ(gate.safe_command[0], 1.0) << outside;
    EXPECT_EQ(gate.last[0], 1.0) << outside;
  }
  const double inside = 0.75;
  tiller_gate_begin(&gate, &inside);
  EXPECT_EQ(gate.safe_command[0], 0.75);
  EXPECT_EQ(gate.last[0], 0.75);
}

// Requirement: SR-3
TEST(GateCore, OnlyMotionMoves) {
  const double planned[] = {1.1}, hold[] = {0.9};
  for (int state = 0; state < tiller_machine_states; ++state) {
    tiller_machine_t machine{};
    machine.state = static_cast<tiller_state_t>(state);
    machine.armed = state != tiller_state_safe;
    tiller_gate_t gate = one_input();
    double out[] = {0.0};
    EXPECT_EQ(tiller_answer(&machine, &gate, nullptr, planned, hold, kPeriod_s, out), tiller_status_ok);
    EXPECT_EQ(out[0], state == tiller_state_active ? 1.1 : state == tiller_state_hold ? 0.9 : 1.0) << state;
  }
}

// Requirement: SR-10
TEST(GateCore, APlanWithANanIsAnsweredByHoldFeedback) {
  const double planned[] = {std::numeric_limits<double>::quiet_NaN()}, hold[] = {0.9};
  tiller_machine_t machine{tiller_state_active, tiller_status_ok, true};
  tiller_gate_t gate = one_input();
  double out[] = {0.0};
  EXPECT_EQ(tiller_answer(&machine, &gate, nullptr, planned, hold, kPeriod_s, out), tiller_status_command_not_finite);
  EXPECT_EQ(out[0], 0.9);
}

}  // namespace
}  // namespace tiller
