#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

/// The options must be refused, and the message must hold every one of the words.
void expect_refused(const PlantOptions& options, const std::vector<std::string>& words) {
  std::string error;
  EXPECT_EQ(Plant::make(options, error), nullptr);
  for (const std::string& word : words) EXPECT_NE(error.find(word), std::string::npos) << word << " in: " << error;
}

PlantOptions with(void (*change)(PlantOptions&)) {
  PlantOptions o = cart_pole();
  change(o);
  return o;
}

TEST(Options, UnknownNamesAreRefusedWithTheKnownOnes) {
  expect_refused(with([](PlantOptions& o) { o.kind = "unicycle"; }), {"unicycle", "pendulum", "cart_pole"});
  expect_refused(with([](PlantOptions& o) { o.parameters["pole_mass"] = 1; }),
                 {"pole_mass", "cart_pole", "cart_mass_kg", "pole_mass_kg", "half_length_m", "cart_friction_Ns_m"});
  expect_refused(with([](PlantOptions& o) { o.initial_state["theta"] = 1; }), {"theta", "position_m", "rate_rad_s"});
  expect_refused(with([](PlantOptions& o) { o.encoder_noise_sd["rate_rad_s"] = 1; }),
                 {"rate_rad_s", "position_m, angle_rad"});
  expect_refused(with([](PlantOptions& o) { o.encoder_step["x"] = 1; }), {"'x'", "position_m, angle_rad"});
  expect_refused(
      with([](PlantOptions& o) {
        o.effects = {{"gremlins", "", {}}};
      }),
      {"gremlins", "viscous_friction", "coulomb_friction", "constant_offset", "actuator_lag", "input_delay"});
  expect_refused(with([](PlantOptions& o) {
                   o.effects = {{"coulomb_friction", "wheel", {{"friction_SI", 1}}}};
                 }),
                 {"wheel", "cart, pole"});
  expect_refused(with([](PlantOptions& o) {
                   o.effects = {{"actuator_lag", "cart", {{"time_constant_s", 1}}}};
                 }),
                 {"'cart'", "force_N"});
  expect_refused(with([](PlantOptions& o) {
                   o.effects = {{"coulomb_friction", "", {{"mu", 1}}}};
                 }),
                 {"'mu'", "coulomb_friction", "friction_SI"});
}

TEST(Options, NumbersThatCannotBeAreRefused) {
  expect_refused(with([](PlantOptions& o) { o.parameters["pole_mass_kg"] = 0; }), {"pole_mass_kg", "greater than 0"});
  expect_refused(with([](PlantOptions& o) { o.parameters["cart_friction_Ns_m"] = -1; }),
                 {"cart_friction_Ns_m = -1", "at least 0"});
  expect_refused(with([](PlantOptions& o) { o.parameters["cart_mass_kg"] = std::nan(""); }), {"cart_mass_kg"});
  expect_refused(with([](PlantOptions& o) { o.initial_state["angle_rad"] = HUGE_VAL; }), {"angle_rad", "finite"});
  expect_refused(with([](PlantOptions& o) { o.encoder_noise_sd["angle_rad"] = -0.1; }), {"encoder noise", "angle_rad"});
  expect_refused(with([](PlantOptions& o) { o.encoder_step["angle_rad"] = std::nan(""); }), {"encoder step"});
  expect_refused(with([](PlantOptions& o) { o.step_s = 0.002; }), {"step_s = 0.002", "0.001"});
  expect_refused(with([](PlantOptions& o) { o.step_s = 0; }), {"step_s"});
  expect_refused(with([](PlantOptions& o) { o.step_s = 0.0001234567; }), {"whole number of microseconds"});
  expect_refused(with([](PlantOptions& o) { o.measurement_latency_s = -1; }), {"measurement_latency_s"});
  expect_refused(with([](PlantOptions& o) { o.command_latency_s = HUGE_VAL; }), {"command_latency_s"});
  expect_refused(with([](PlantOptions& o) { o.watchdog_timeout_s = -1; }), {"watchdog_timeout_s"});
  expect_refused(with([](PlantOptions& o) { o.process_noise_sd = std::nan(""); }), {"process_noise_sd"});
  expect_refused(with([](PlantOptions& o) { o.command_limit = -5; }), {"command_limit"});
  expect_refused(with([](PlantOptions& o) {
                   o.effects = {{"coulomb_friction", "", {{"friction_SI", -1}}}};
                 }),
                 {"coulomb_friction", "friction_SI = -1"});
  expect_refused(with([](PlantOptions& o) { o.effects = {{"input_delay", "", {}}}; }), {"input_delay", "delay_s"});
  expect_refused(with([](PlantOptions& o) {
                   o.effects = {{"coulomb_friction", "", {{"friction_SI", 1}}},
                                {"coulomb_friction", "cart", {{"friction_SI", 2}}}};
                 }),
                 {"coulomb_friction", "twice"});
}

TEST(Options, ChannelsAreNamedWithTheirUnits) {
  auto plant = make(cart_pole());
  ASSERT_EQ(plant->states().size(), 4u);
  EXPECT_EQ(plant->states()[0].name, "position_m");
  EXPECT_EQ(plant->states()[1].name, "angle_rad");
  EXPECT_EQ(plant->states()[2].name, "velocity_m_s");
  EXPECT_EQ(plant->states()[3].name, "rate_rad_s");
  EXPECT_EQ(plant->commands()[0].name, "force_N");
  EXPECT_EQ(plant->measurements()[1].unit, "rad");
  EXPECT_EQ(plant->parameter("pole_mass_kg"), 0.1);
  EXPECT_TRUE(std::isnan(plant->parameter("nothing")));
  auto other = make(pendulum());
  EXPECT_EQ(other->states()[0].name, "angle_rad");
  EXPECT_EQ(other->commands()[0].name, "torque_Nm");
  EXPECT_EQ(other->measurements().size(), 1u);
}

TEST(Options, CommandLineTextIsRead) {
  std::map<std::string, double> values;
  std::string error;
  EXPECT_TRUE(parse_assignment("pole_mass_kg=0.125", values, error));
  EXPECT_EQ(values.at("pole_mass_kg"), 0.125);
  EXPECT_FALSE(parse_assignment("pole_mass_kg=0.2", values, error));
  EXPECT_NE(error.find("twice"), std::string::npos);
  for (const char* bad : {"", "=1", "x", "x=", "x=1y", "x=nan", "x=1=2"}) {
    error.clear();
    EXPECT_FALSE(parse_assignment(bad, values, error)) << bad;
    EXPECT_FALSE(error.empty());
  }
  HiddenEffect e;
  EXPECT_TRUE(parse_effect("coulomb_friction@pole:friction_SI=0.5", e, error)) << error;
  EXPECT_EQ(e.kind, "coulomb_friction");
  EXPECT_EQ(e.port, "pole");
  EXPECT_EQ(e.parameters.at("friction_SI"), 0.5);
  EXPECT_TRUE(parse_effect("input_delay:delay_s=0.02", e, error)) << error;
  EXPECT_TRUE(e.port.empty());
  for (const char* bad : {"", "@pole", "x@:a=1", "x:a", "x:a=1,a=2"}) EXPECT_FALSE(parse_effect(bad, e, error)) << bad;
}

TEST(Options, HelpNamesEverything) {
  const std::string help = plant_help();
  for (const char* word : {"pendulum", "cart_pole", "half_length_m", "damping_Nms", "coulomb_friction", "delay_s",
                           "force_N", "torque_Nm", "pole"}) {
    EXPECT_NE(help.find(word), std::string::npos) << word;
  }
}

}  // namespace
}  // namespace tiller::sim
