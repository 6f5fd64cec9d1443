// examples/ros2_control as a controller manager drives it, at 500 Hz on a pendulum with equations of its own. The headers
// are stubs of this folder: names and signatures of ros2_control, none of its code.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <memory>
#include <regex>
#include <sstream>

#include "controller_interface/controller_interface.hpp"
#include "heap_trap.hpp"

std::unique_ptr<controller_interface::ControllerInterface> load_plugin(const char* class_type, const char* base);

namespace {

using controller_interface::CallbackReturn;
using controller_interface::return_type;

std::string text_of(const char* file) {
  std::ifstream in(std::string(TILLER_EXAMPLE) + "/" + file);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

/// By the attributes of the plugin description, as pluginlib does.
std::unique_ptr<controller_interface::ControllerInterface> load_described() {
  const std::string text = text_of("tiller_controller.xml");
  std::smatch type, base;
  if (!std::regex_search(text, type, std::regex("type=\"([^\"]+)\"")) ||
      !std::regex_search(text, base, std::regex("base_class_type=\"([^\"]+)\"")))
    return nullptr;
  // the first match of type= may be a part of base_class_type=
  std::regex_search(text, type, std::regex("\\stype=\"([^\"]+)\""));
  return load_plugin(type[1].str().c_str(), base[1].str().c_str());
}

class Controller : public ::testing::Test {
 public:
  void SetUp() override {
    controller_ = load_described();
    ASSERT_NE(nullptr, controller_) << "the plugin description names another class";
    ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_init());
    set("state_interfaces", {"pendulum_joint/position"});
    set("command_interfaces", {"pendulum_joint/effort"});
  }
  void set(const char* name, std::vector<std::string> value) { controller_->get_node()->parameters[name] = value; }
  void start() {
    ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_configure({}));
    std::vector<hardware_interface::LoanedCommandInterface> commands;
    std::vector<hardware_interface::LoanedStateInterface> states;
    commands.emplace_back(&effort_Nm_);
    states.emplace_back(&position_rad_);
    controller_->assign_interfaces(std::move(commands), std::move(states));
    ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_activate({}));
  }

  void step(double time_s) {
    constexpr double kMass = 0.45, kLength = 0.5, kDamping = 0.05, kStep = 1e-4;
    for (double t = 0; t < time_s - 0.5 * kStep; t += kStep) {
      rate_rad_s_ += kStep * (effort_Nm_ - kDamping * rate_rad_s_ - kMass * 9.81 * kLength * std::sin(angle_rad_)) /
                     (kMass * kLength * kLength);
      angle_rad_ += kStep * rate_rad_s_;
    }
  }
  void run(double seconds, bool blind = false) {
    for (double t = 0; t < seconds; t += 0.002) {
      position_rad_ = blind ? std::nan("") : angle_rad_;
      if (controller_->update(rclcpp::Time(now_ns_), rclcpp::Duration(2000000)) != return_type::OK) ++failures_;
      changes_ += effort_Nm_ != last_Nm_;
      last_Nm_ = effort_Nm_;
      step(0.002);
      now_ns_ += 2000000;
    }
  }

  std::unique_ptr<controller_interface::ControllerInterface> controller_;
  double position_rad_ = 0, effort_Nm_ = 0, angle_rad_ = 0, rate_rad_s_ = 0, last_Nm_ = 0;
  std::int64_t now_ns_ = 1000000000;
  int failures_ = 0, changes_ = 0;
};

TEST_F(Controller, SwingsThePendulumUpAndAllocatesNothing) {
  start();
  const auto whole = [](void* test) { static_cast<Controller*>(test)->run(8); };
  EXPECT_EQ(0u, tiller_test::heap_calls_in(whole, this));
  EXPECT_EQ(0, failures_);
  EXPECT_LT(std::fabs(std::remainder(angle_rad_ - M_PI, 2 * M_PI)), 0.2);
  EXPECT_LE(changes_, 401) << "one command for each period of 20 ms";
  EXPECT_GT(changes_, 200);
  ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_deactivate({}));
  EXPECT_EQ(0, effort_Nm_) << "the safe command";
}

TEST_F(Controller, WithoutReadingsTheCommandIsTheSafeOneUntilItIsActivatedAgain) {
  start();
  run(0.5);
  EXPECT_NE(0, effort_Nm_);
  run(0.3, true);
  EXPECT_EQ(0, effort_Nm_);
  run(0.5);
  EXPECT_EQ(0, effort_Nm_) << "SAFE latches";
  ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_deactivate({}));
  ASSERT_EQ(CallbackReturn::SUCCESS, controller_->on_activate({}));
  run(0.5);
  EXPECT_NE(0, effort_Nm_);
}

TEST_F(Controller, InterfacesThatDoNotFitTheRobotFileAreRefused) {
  set("state_interfaces", {"a/position", "a/velocity"});
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(CallbackReturn::ERROR, controller_->on_configure({}));
  const std::string told = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(std::string::npos, told.find("1 measurements and 1 inputs; state_interfaces lists 2")) << told;
}

TEST_F(Controller, ClaimsTheInterfacesOfItsParameters) {
  start();
  EXPECT_EQ((std::vector<std::string>{"pendulum_joint/effort"}), controller_->command_interface_configuration().names);
  EXPECT_EQ((std::vector<std::string>{"pendulum_joint/position"}), controller_->state_interface_configuration().names);
}

}  // namespace
