// Faults of the planner and of what is believed: the plan fails, is late, hangs; the model is wrong.

#include <cmath>
#include <limits>

#include "harness/faults/fault.hpp"

namespace tiller::faults {
namespace {

bool plan_failed(const World&, const tiller_info_t& info) { return info.plan_failures > 0; }
bool plan_late(const World&, const tiller_info_t& info) { return info.late_plans > 0; }
void breakable(Setup& s) { s.own_cost = true; }
void clocked(Setup& s) { s.clock = true; }

void failing(std::vector<Fault>& list) {
  const char* group = "planner";
  list.push_back({"plan_nan", group, "every trajectory costs NaN", Route::kMemory, End::kStops, Timeout::kHold,
                  "`plan_not_finite`: HOLD on fresh sensors, then SAFE"});
  list.back().prepare = breakable;
  list.back().step = [](World& w) { w.cost = std::nan(""); };
  list.back().noticed = plan_failed;
  list.push_back({"plan_nan_for_a_while", group, "the same for five ticks", Route::kMemory, End::kRides, Timeout::kHold,
                  "HOLD, and back by itself"});
  list.back().prepare = breakable;
  list.back().step = [](World& w) { w.cost = w.ticks < 5 ? std::nan("") : 0.0; };
  list.back().noticed = plan_failed;
  list.push_back({"plan_infeasible", group, "every trajectory costs infinity", Route::kMemory, End::kStops,
                  Timeout::kHold, "`plan_not_finite`: HOLD, then SAFE"});
  list.back().prepare = breakable;
  list.back().step = [](World& w) { w.cost = std::numeric_limits<double>::infinity(); };
  list.back().noticed = plan_failed;
  for (const auto planner : {tiller_planner_sqp, tiller_planner_ilqr}) {
    const bool sqp = planner == tiller_planner_sqp;
    list.push_back({sqp ? "solver_nan_sqp" : "solver_nan_ilqr", group, sqp ? "`sqp` meets NaN" : "`ilqr` meets NaN",
                    Route::kMemory, End::kStops, Timeout::kHold, "`plan_not_finite`: HOLD, then SAFE"});
    list.back().prepare = sqp ? [](Setup& s) {
      s.own_cost = true;
      s.config.planner.kind = tiller_planner_sqp;
    }
                              : [](Setup& s) {
                                  s.own_cost = true;
                                  s.config.planner.kind = tiller_planner_ilqr;
                                };
    list.back().step = [](World& w) { w.cost = std::nan(""); };
    list.back().noticed = plan_failed;
  }
  list.push_back({"solver_infeasible", group, "hard bounds that no input can keep", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "the penalty's solution, within the limits; HOLD if there is none"});
  list.back().prepare = [](Setup& s) {
    s.config.planner.kind = tiller_planner_sqp;
    const std::uint32_t x = s.robot == Robot::kPendulum ? 1 : 3;
    s.config.state_low[x] = 4.0;  // round and round at a speed that gravity does not leave it
    s.config.state_high[x] = 4.1;
    s.config.bound_weight[x] = 10.0;
    s.config.cost.hard_bounds = 1u << x;
  };
  list.push_back({"solver_capped", group, "one iteration for each quadratic program", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "the iterate so far, within the limits"});
  list.back().prepare = [](Setup& s) {
    s.config.planner.kind = tiller_planner_sqp;
    s.config.planner.qp_solver = tiller_qp_osqp;
    s.config.planner.qp_iterations = 1;
  };
}

void late(std::vector<Fault>& list) {
  const char* group = "time to plan";
  list.push_back({"plan_late", group, "no time for one iteration, from now on", Route::kMemory, End::kStops,
                  Timeout::kLatePlans, "`deadline_missed`: the plan moved on, then HOLD, then SAFE"});
  list.back().prepare = clocked;
  list.back().step = [](World& w) { w.clock_step_ns = 20000000; };
  list.back().noticed = plan_late;
  list.push_back({"plan_late_now_and_then", group, "no time in three of ten ticks", Route::kMemory, End::kRides,
                  Timeout::kSensor, "`deadline_missed`: the plan moved on"});
  list.back().prepare = clocked;
  list.back().step = [](World& w) { w.clock_step_ns = w.random.chance(0.3) ? 20000000 : 0; };
  list.back().noticed = plan_late;
  list.push_back({"plan_capped", group, "time for one iteration of two", Route::kMemory, End::kRides, Timeout::kSensor,
                  "`iteration_capped`: the plan so far"});
  list.back().prepare = clocked;
  list.back().step = [](World& w) { w.clock_step_ns = 350000; };  // the deadline is 5 ms
  list.back().noticed = [](const World&, const tiller_info_t& i) { return i.planner_iterations == 1; };
  list.push_back({"clock_of_deadlines_stands", group, "the deadlines' clock stands still", Route::kMemory, End::kRides,
                  Timeout::kSensor, "the cap of iterations ends the plan"});
  list.back().prepare = clocked;
  list.push_back({"clock_of_deadlines_back", group, "the deadlines' clock runs backwards", Route::kMemory, End::kRides,
                  Timeout::kSensor, "the cap of iterations ends the plan"});
  list.back().prepare = clocked;
  list.back().step = [](World& w) { w.clock_step_ns = -1000000; };
}

void hung(std::vector<Fault>& list) {
  const char* group = "planner hangs";
  list.push_back({"tick_hangs", group, "a tick does not end", Route::kMemory, End::kStops, Timeout::kWatchdog,
                  "no command comes: the device's watchdog"});
  list.back().step = [](World& w) { w.hung = true; };
  for (const Route route : {Route::kMemory, Route::kBus, Route::kLcm}) {
    const bool bus = route == Route::kBus, lcm = route == Route::kLcm;
    list.push_back({bus   ? "hangs_behind_repeater_can"
                    : lcm ? "hangs_behind_repeater_lcm"
                          : "hangs_behind_repeater",
                    group, "a tick does not end, and a thread repeats the last command", route, End::kStops,
                    Timeout::kPlanWatch, "the plan's number stands still: the device stops"});
    list.back().step = [](World& w) { w.hung = w.repeater = true; };
    list.push_back({bus   ? "hangs_behind_live_thread_can"
                    : lcm ? "hangs_behind_live_thread_lcm"
                          : "hangs_behind_live_thread",
                    group, "the same, and the thread answers every measurement", route, End::kStops,
                    Timeout::kPlanWatch, "the plan's number stands still: the device stops"});
    list.back().step = [](World& w) { w.hung = w.repeater = w.repeater_answers = true; };
  }
}

/// The robot's model as a user may write one, in C and with an edge to its domain: no step is finite beyond it.
thread_local double domain_left = 1.0;

template <int kRobot>
void edged_dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                    double* dxdt) {
  static const tiller_model_t& whole = *tiller_find_model(kRobot == 0 ? "pendulum" : "cart_pole");
  whole.dynamics(x, u, f, body, p, dxdt);
  dxdt[whole.state_count - 1] += 0.0 * std::sqrt(domain_left);
}

template <int kRobot>
const tiller_model_t& edged_model() {
  static const tiller_model_t model = [] {
    tiller_model_t m = *tiller_find_model(kRobot == 0 ? "pendulum" : "cart_pole");
    m.dynamics = edged_dynamics<kRobot>;
    m.jacobian = nullptr;
    m.kernels = nullptr;
    return m;
  }();
  return model;
}

void no_step(std::vector<Fault>& list) {
  list.push_back({"model_without_a_step", "beliefs",
                  "no hypothesis has a finite step: a model in C beyond sqrt's domain", Route::kMemory, End::kStops,
                  Timeout::kUntaken, "`posterior_degenerate`: nothing is planned from the estimate; SAFE"});
  list.back().prepare = [](Setup& s) {
    domain_left = 1.0;
    s.config.model = s.robot == Robot::kPendulum ? &edged_model<0>() : &edged_model<1>();
  };
  list.back().step = [](World&) { domain_left = -1.0; };
}

void beliefs(std::vector<Fault>& list) {
  const char* group = "beliefs";
  list.push_back({"posterior_collapsed", group, "priors that exclude the truth", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "steers as well as it can; `model_inadequate` or `tempered` say so"});
  list.back().prepare = [](Setup& s) {
    const int i = s.robot == Robot::kPendulum ? 0 : 2;
    s.config.priors[i] = {tiller_prior_uniform, 0, 0.0, 0.0, 1.99, 2.0};
  };
  list.push_back({"posterior_diverges", group, "readings with a hundred times the noise", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "the noise's scale follows; jumps are rejected, SAFE if they go on"});
  list.back().measure = [](World& w, tiller_measurement_t& m) {
    m.value[w.angle()] += 0.2 * (w.random.uniform(-1, 1) + w.random.uniform(-1, 1) + w.random.uniform(-1, 1));
    return true;
  };
  list.back().genuine_sd = 310.0;
  list.push_back({"gap_is_predicted", group, "a gap of six periods that the sensors' timeout allows", Route::kMemory,
                  End::kBounded, Timeout::kSensor, "the estimate is predicted through it, period by period"});
  list.back().prepare = [](Setup& s) { s.config.safety.sensor_timeout_s = 0.2; };
  list.back().measure = [](World& w, tiller_measurement_t&) { return w.ticks >= 6; };
  list.push_back({"filters_begin_anew", group, "a gap of twenty periods that the sensors' timeout allows",
                  Route::kMemory, End::kBounded, Timeout::kSensor, "the filters start again, the parameters stay"});
  list.back().prepare = [](Setup& s) { s.config.safety.sensor_timeout_s = 0.5; };
  list.back().measure = [](World& w, tiller_measurement_t&) { return w.ticks >= 20; };
  list.back().noticed = [](const World&, const tiller_info_t& i) { return i.posterior_failures > 0; };
  list.push_back({"model_wrong", group, "gravity in the plant is half as strong again", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "`model_inadequate`: a status, no stop"});
  list.back().prepare = [](Setup& s) { s.plant.parameters["gravity_m_s2"] = 15.0; };
  list.push_back({"log_full", group, "the recorder holds one tick", Route::kMemory, End::kRides, Timeout::kSensor,
                  "the oldest tick makes room"});
  list.back().prepare = [](Setup& s) { s.config.record_ticks = 1; };
  list.back().noticed = [](const World& w, const tiller_info_t& i) {
    tiller_record_t r;
    return i.ticks > 2 && tiller_get_record(w.controller, i.ticks - 1, &r) == tiller_status_ok &&
           tiller_get_record(w.controller, i.ticks - 2, &r) != tiller_status_ok;
  };
}

}  // namespace

std::vector<Fault> planner_faults() {
  std::vector<Fault> list;
  failing(list);
  late(list);
  hung(list);
  no_step(list);
  beliefs(list);
  return list;
}

}  // namespace tiller::faults
