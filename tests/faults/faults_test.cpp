#include <gtest/gtest.h>

#include <set>
#include <string>

#include "harness/faults/fault.hpp"
#include "harness/faults/fault_refusals.hpp"

// Every kind of fault on both plants. What must hold is judged in every run (fault_run.cpp): commands within their
// limits, the motor stopped in time, nothing driven for long without a genuine reading, SAFE latched.

namespace tiller::faults {
namespace {

class Matrix : public ::testing::TestWithParam<std::size_t> {};

TEST_P(Matrix, EndsAsItMust) {
  const Fault& fault = all_faults()[GetParam()];
  for (const Robot robot : kRobots) {
    const Outcome o = run_fault(fault, robot, 1);
    EXPECT_EQ(o.wrong, nullptr) << fault.name << " on the " << name_of(robot) << ": " << (o.wrong ? o.wrong : "")
                                << " at " << o.wrong_s << " s; " << tiller_state_name(o.state) << ", "
                                << tiller_status_name(o.status);
  }
}

INSTANTIATE_TEST_SUITE_P(Faults, Matrix, ::testing::Range<std::size_t>(0, all_faults().size()),
                         [](const auto& made) { return std::string(all_faults()[made.param].name); });

TEST(Kinds, AreManyAndNamedOnce) {
  std::set<std::string> names;
  for (const Fault& f : all_faults()) EXPECT_TRUE(names.insert(f.name).second) << f.name;
  EXPECT_GE(names.size(), 60u);
}

TEST(Refusal, ConfigurationThatDoesNotFitBecomesNoController) {
  for (const Refusal& r : all_refusals())
    for (const Robot robot : kRobots) EXPECT_TRUE(is_refused(r, robot)) << r.name << " on the " << name_of(robot);
}

/// The judge must be able to say no: a fault that nobody answers.
TEST(Judge, SeesAMotorThatIsNotStopped) {
  Fault ignored{"ignored", "", "", Route::kMemory, End::kStops, Timeout::kSensor, ""};
  for (const Robot robot : kRobots) {
    const Outcome o = run_fault(ignored, robot, 1);
    ASSERT_NE(o.wrong, nullptr);
    EXPECT_STREQ(o.wrong, "the motor was still driven after the timeout");
    EXPECT_NEAR(o.wrong_s, 0.14, 0.021) << "the timeout and two ticks";
  }
}

TEST(Judge, SeesMotionWithoutGenuineReadings) {
  // an encoder that drifts more slowly than any limit: nobody can reject it, and the judge must not call it well
  Fault drift{"drift", "", "", Route::kMemory, End::kBounded, Timeout::kSensor, ""};
  drift.measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] += 0.1 * (w.ticks + 1);
    return true;
  };
  const Outcome o = run_fault(drift, Robot::kPendulum, 1);
  ASSERT_NE(o.wrong, nullptr);
  EXPECT_STREQ(o.wrong, "driven without a genuine reading for too long");
}

}  // namespace
}  // namespace tiller::faults
