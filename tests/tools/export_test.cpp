// `tiller export`: the C file, compiled as C99, holds the same bytes as the robot file does.
#include <gtest/gtest.h>

#include <cstring>

#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/export_config.hpp"
#include "tools/robot/robot_file.hpp"

extern "C" {
tiller_config_t cart_pole_config(void);
tiller_config_t pendulum_config(void);
tiller_config_t task_config(void);
}

namespace tiller::tools {
namespace {

template <class T>
void expect_same_bytes(const char* what, const T& exported, const T& read) {
  const auto* a = reinterpret_cast<const unsigned char*>(&exported);
  const auto* b = reinterpret_cast<const unsigned char*>(&read);
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    ASSERT_EQ(a[i], b[i]) << what << ", byte " << i << " of " << sizeof(T);
  }
}

/// The arrays that a configuration points to, element by element.
void expect_same_arrays(const tiller_config_t& one, const tiller_config_t& other) {
  const Config exported(one), read(other);
  expect_same_bytes("effects", exported.effects, read.effects);
  for (std::uint32_t i = 0; i < read.param_count; ++i) expect_same_bytes("prior", exported.priors[i], read.priors[i]);
  expect_same_bytes("state_low", exported.state_low, read.state_low);
  expect_same_bytes("state_high", exported.state_high, read.state_high);
  expect_same_bytes("bound_weight", exported.bound_weight, read.bound_weight);
  expect_same_bytes("terms", exported.terms, read.terms);
  expect_same_bytes("cones", exported.cones, read.cones);
  expect_same_bytes("hold_gain", exported.hold_gain, read.hold_gain);
  expect_same_bytes("measurement_low", exported.measurement_low, read.measurement_low);
  expect_same_bytes("measurement_high", exported.measurement_high, read.measurement_high);
  expect_same_bytes("measurement_rate_per_s", exported.measurement_rate_per_s, read.measurement_rate_per_s);
}

/// The numbers beside them.
tiller_cost_config_t without_arrays(tiller_cost_config_t cost) {
  cost.state_low = cost.state_high = cost.bound_weight = nullptr;
  cost.terms = nullptr;
  return cost;
}
tiller_safety_config_t without_arrays(tiller_safety_config_t safety) {
  safety.cones = nullptr;
  safety.hold_gain = safety.measurement_low = safety.measurement_high = safety.measurement_rate_per_s = nullptr;
  return safety;
}

class Exported : public testing::TestWithParam<std::pair<const char*, tiller_config_t (*)()>> {};

TEST_P(Exported, IsTheRobotFile) {
  std::string errors;
  const auto robot = read_robot_file(std::string(TILLER_TEST_ROBOTS) + "/" + GetParam().first + ".toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const tiller_config_t exported = GetParam().second();
  const tiller_config_t& read = robot->config;
  EXPECT_EQ(exported.model, read.model);
  // group by group: the compiler may leave anything in the padding between them
  expect_same_arrays(exported, read);
  expect_same_bytes("measured_state", exported.measured_state, read.measured_state);
  expect_same_bytes("measurement_sd", exported.measurement_sd, read.measurement_sd);
  expect_same_bytes("process_sd", exported.process_sd, read.process_sd);
  expect_same_bytes("initial_state", exported.initial_state, read.initial_state);
  expect_same_bytes("initial_state_sd", exported.initial_state_sd, read.initial_state_sd);
  expect_same_bytes("body", exported.body, read.body);
  expect_same_bytes("posterior", exported.posterior, read.posterior);
  expect_same_bytes("planner", exported.planner, read.planner);
  expect_same_bytes("cost", without_arrays(exported.cost), without_arrays(read.cost));
  const std::size_t safety_fields = offsetof(tiller_safety_config_t, cone_count) + sizeof(std::uint32_t);
  const tiller_safety_config_t one = without_arrays(exported.safety), other = without_arrays(read.safety);
  EXPECT_EQ(std::memcmp(&one, &other, safety_fields), 0);
  EXPECT_EQ(exported.size, read.size);
  EXPECT_EQ(exported.version, read.version);
  EXPECT_EQ(exported.seed, read.seed);
  EXPECT_EQ(exported.period_s, read.period_s);
  EXPECT_EQ(exported.substeps, read.substeps);
  EXPECT_EQ(exported.integrator, read.integrator);
  EXPECT_EQ(exported.param_count, read.param_count);
  EXPECT_EQ(exported.effect_count, read.effect_count);
  EXPECT_EQ(exported.measurement_count, read.measurement_count);
  EXPECT_EQ(exported.record_ticks, read.record_ticks);
  EXPECT_EQ(tiller_size(&exported), tiller_size(&read));
}

INSTANTIATE_TEST_SUITE_P(Shipped, Exported,
                         testing::Values(std::make_pair("cart_pole", &cart_pole_config),
                                         std::make_pair("pendulum", &pendulum_config)),
                         [](const auto& tested) { return std::string(tested.param.first); });

// Every term of the cost and every setting of the planners: fields, and the arrays that fields point to.
TEST(Export, TheWholeTask) {
  std::string errors;
  const auto robot = read_robot_file(TILLER_TEST_TASK "/task.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const tiller_config_t exported = task_config();
  tiller_cost_config_t read = robot->config.cost;
  ASSERT_EQ(read.reference_steps, 51u);
  ASSERT_EQ(read.demonstration_steps, 21u);
  ASSERT_EQ(exported.cost.reference_steps, 51u);
  ASSERT_EQ(exported.cost.demonstration_steps, 21u);
  for (std::size_t i = 0; i < 51 * 4; ++i) ASSERT_EQ(exported.cost.reference[i], read.reference[i]) << i;
  for (std::size_t i = 0; i < 21 * 4; ++i) ASSERT_EQ(exported.cost.demonstration_mean[i], read.demonstration_mean[i]);
  for (std::size_t i = 0; i < 21 * 16; ++i) ASSERT_EQ(exported.cost.demonstration_root[i], read.demonstration_root[i]);
  read.reference = exported.cost.reference;
  read.demonstration_mean = exported.cost.demonstration_mean;
  read.demonstration_root = exported.cost.demonstration_root;
  expect_same_bytes("cost", without_arrays(exported.cost), without_arrays(read));
  expect_same_arrays(exported, robot->config);
  ASSERT_EQ(exported.safety.cone_count, 2u);
  expect_same_bytes("planner", exported.planner, robot->config.planner);
  EXPECT_EQ(tiller_size(&exported), tiller_size(&robot->config));
}

TEST(Export, TheJointPrior) {
  std::string errors;
  const auto robot = read_robot_file(TILLER_TEST_TASK "/task.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const tiller_mixture_t* read = robot->config.prior_mixture;
  const tiller_config_t config = task_config();
  const tiller_mixture_t* exported = config.prior_mixture;
  ASSERT_NE(read, nullptr);
  ASSERT_NE(exported, nullptr);
  ASSERT_EQ(exported->components, 2u);
  ASSERT_EQ(exported->dimension, 2u);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(exported->weight[i], read->weight[i]);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(exported->mean[i], read->mean[i]);
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(exported->root[i], read->root[i]);
  EXPECT_DOUBLE_EQ(exported->root[0], 0.002);  // by hand: root of 4e-6, then 1e-6 / .002
  EXPECT_DOUBLE_EQ(exported->root[2], 0.0005);
  const char* field = nullptr;
  EXPECT_EQ(tiller_config_check(&config, &field), tiller_status_ok) << field;
  EXPECT_EQ(cart_pole_config().prior_mixture, nullptr);
}

TEST(Export, NamesAreCIdentifiers) {
  EXPECT_EQ(c_identifier("cart-pole 2"), "cart_pole_2");
  EXPECT_EQ(c_identifier("7dof"), "robot_7dof");
  EXPECT_EQ(c_identifier(""), "robot_");
}

}  // namespace
}  // namespace tiller::tools
