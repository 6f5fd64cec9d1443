// Models from outside: compiled once, refused with reasons.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "rollout/cost.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/base/child_process.hpp"
#include "tools/robot/compiler_errors.hpp"
#include "tools/robot/model_compiler.hpp"
#include "tools/robot/model_loader.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

class Loader : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              (std::string("loader_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    setenv("TILLER_CACHE", (folder_ / "cache").c_str(), 1);
    unsetenv("TILLER_CXX");
    unsetenv("TILLER_CC");
    unsetenv("TILLER_INCLUDE");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }
  const tiller_model_t* load(const std::string& file, const std::string& type = "") {
    ModelRequest request;
    request.file = file;
    request.type = type;
    request.robot_dir = folder_.string();
    error_.clear();
    return load_model(request, error_);
  }
  int objects() const {
    int count = 0;
    if (fs::exists(folder_ / "cache"))
      for (const auto& entry : fs::directory_iterator(folder_ / "cache")) count += entry.path().extension() == ".so";
    return count;
  }
  void expect_said(const std::string& word) const {
    EXPECT_NE(error_.find(word), std::string::npos) << "lacks '" << word << "': " << error_;
  }

  fs::path folder_;
  std::string error_;
};

// x'' = u / m, in C.
std::string mass_c(const std::string& extra = "") {
  return R"(#include "tiller/model.h"
static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  (void)f; (void)body;
  dxdt[0] = x[1];
  dxdt[1] = u[0] / p[0];
}
static const char* const states[] = {"position_m", "velocity_m_s"};
static const char* const inputs[] = {"force_N"};
static const char* const params[] = {"mass_kg"};
static const tiller_model_t model = {.size = sizeof(tiller_model_t), .version = TILLER_MODEL_VERSION, .name = "mass",
  .state_count = 2, .input_count = 1, .param_count = 1, .state_names = states, .input_names = inputs,
  .param_names = params, .dynamics = dynamics)" +
         extra + R"(};
const tiller_model_t* tiller_model(void);
const tiller_model_t* tiller_model(void) { return &model; }
)";
}

// The same as a template, with a joint.
std::string mass_hpp(const std::string& divisor = "p.mass_kg") {
  return R"(#pragma once
#include "tiller/model.hpp"
namespace mine {
template <class S>
struct Mass {
  static constexpr const char* name = "mass";
  TILLER_FIELDS(State, S, position_m, velocity_m_s);
  TILLER_FIELDS(Input, S, force_N);
  TILLER_FIELDS(Params, S, mass_kg);
  TILLER_FIELDS(Force, S, rail_N);
  static constexpr tiller_joint_t joints[] = {{"rail", 0, 1, 0, 0}};
  static constexpr unsigned angles = 0;
  static State dynamics(const State& x, const Input& u, const Force& f, const tiller::Body<S>&, const Params& p) {
    return {x.velocity_m_s, (u.force_N + f.rail_N) / )" +
         divisor + R"(};
  }
};
}  // namespace mine
)";
}

TEST_F(Loader, BuiltInByName) {
  ModelRequest request;
  request.name = "cart_pole";
  const tiller_model_t* model = load_model(request, error_);
  ASSERT_NE(model, nullptr) << error_;
  EXPECT_STREQ(model->name, "cart_pole");
  request.name = "cartpole";
  EXPECT_EQ(load_model(request, error_), nullptr);
  expect_said("no built-in model 'cartpole'");
  expect_said("pendulum");
}

/// A cost beside the model of mass_c().
std::string cost_c(const std::string& stage = "stage", const std::string& version = "TILLER_CONFIG_VERSION") {
  return "#include \"tiller/tiller.h\"\n" + mass_c() + R"(
static double stage(const double* x, const double* u, const double* p, double time_s, void* context) {
  (void)context;
  return x[0] + 10 * u[0] + 100 * p[0] + 1000 * time_s;
}
static const tiller_own_cost_t cost = {.size = sizeof(tiller_own_cost_t), .stage = )" +
         stage + ", .version = " + version + R"(};
const tiller_own_cost_t* tiller_cost(void);
const tiller_own_cost_t* tiller_cost(void) { (void)stage; return &cost; }
)";
}

TEST_F(Loader, ACostStandsBesideTheModelInC) {
  ModelRequest request;
  request.robot_dir = folder_.string();
  request.file = "cost.c";
  write("cost.c", cost_c());
  const tiller_own_cost_t* own = nullptr;
  ASSERT_NE(load_model(request, error_, &own), nullptr) << error_;
  ASSERT_NE(own, nullptr);
  const double x[] = {1.0, 0.0}, u = 2.0, p = 3.0;
  EXPECT_EQ(own->stage(x, &u, &p, 4.0, nullptr), 4321.0);
  EXPECT_EQ(own->terminal, nullptr);
  request.file = "mass.c";
  write("mass.c", mass_c());
  ASSERT_NE(load_model(request, error_, &own), nullptr) << error_;
  EXPECT_EQ(own, nullptr) << "a model without a cost";
}

/// A template with a cost, compiled once for all that is asked of it: kernels take a compiler a quarter of a minute.
class Template : public Loader {
 protected:
  static const tiller_model_t* model() {
    static const tiller_model_t* const compiled = compile();
    return compiled;
  }

 private:
  static const tiller_model_t* compile() {
    const fs::path folder = fs::path(testing::TempDir()) / "loader_template";
    fs::remove_all(folder);
    fs::create_directories(folder);
    std::ofstream(folder / "mass.hpp") << mass_hpp() << kCost;
    ModelRequest request;
    request.robot_dir = folder.string();
    request.file = "mass.hpp";
    request.type = "mine::Mass";
    request.cost_type = "mine::Cost";
    std::string error;
    const tiller_model_t* model = load_model(request, error);
    EXPECT_NE(model, nullptr) << error;
    fs::remove_all(folder);
    return model;
  }

  static constexpr const char* kCost = R"(
namespace mine {
template <class S>
struct Cost {
  static S stage(const typename Mass<S>::State& x, const typename Mass<S>::Input& u,
                 const typename Mass<S>::Params& p, const S& time_s) {
    return x.position_m + u.force_N * 10.0 + p.mass_kg * 100.0 + time_s * 1000.0;
  }
  static S terminal(const typename Mass<S>::State& x, const typename Mass<S>::Params&, const S&) {
    return x.position_m * 10000.0;
  }
};
}  // namespace mine
)";
};

TEST_F(Template, ItsCostIsCompiledIntoTheKernels) {
  ASSERT_NE(model(), nullptr);
  tiller::Config config;
  ASSERT_EQ(tiller_config_default(&config, model()), tiller_status_ok);
  config.cost.own_weight = 0.5;
  const CostTerms<double> terms = make_cost_terms<double>(config.cost, config.model->state_count);
  const StepSetup setup;
  const double state[] = {1.0, 0.0}, mass = 3.0, inputs[] = {2.0, 2.0};
  double out[kLanePadding];
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = 1;
  job.horizon = 2;
  job.state = {state, 0};
  job.params = {&mass, 0};
  job.controls = {inputs, 0};
  job.cost = &terms;
  job.cost_out = out;
  select_rollout(*model()).rollout_f64(*model(), job);
  // at rest at 1 m, pushed by 2 N / 3 kg for two periods of 20 ms: u t^2 / 2
  const double after_one = 1.0 + 2.0 / 3.0 * 0.0002, after_two = 1.0 + 2.0 / 3.0 * 0.0008;
  const double expected = 0.5 * ((1.0 + 320.0) + (after_one + 320.0 + 20.0) + 10000.0 * after_two);
  EXPECT_NEAR(out[0], expected, 1e-6);
}

TEST_F(Template, RunsInTheLanesOfThisMachine) {
  ASSERT_NE(model(), nullptr);
  ASSERT_EQ(model()->param_count, 1u);
  EXPECT_STREQ(model()->joints[0].name, "rail");
  ASSERT_NE(model()->kernels, nullptr);
  EXPECT_EQ(select_rollout(*model()).isa, best_isa());

  StepSetup setup;
  setup.period_s = 0.1;
  const double state[] = {1, 0}, params[] = {2.0}, controls[] = {4, 4, 4};
  double final_state[2 * kLanePadding];
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kLanePadding;
  job.horizon = 3;
  job.state.data = state;
  job.params.data = params;
  job.controls.data = controls;
  job.final_state = final_state;
  select_rollout(*model()).rollout_f64(*model(), job);
  EXPECT_NEAR(final_state[0], 1 + 0.5 * 2 * 0.09, 1e-12);  // RK4 is exact for a constant acceleration
  EXPECT_NEAR(final_state[kLanePadding], 0.6, 1e-12);
}

TEST_F(Loader, RefusesCostsThatAreNone) {
  write("null.c", cost_c("0"));
  EXPECT_EQ(load("null.c"), nullptr);
  expect_said("a cost without stage");
  write("old.c", cost_c("stage", "1"));
  EXPECT_EQ(load("old.c"), nullptr);
  expect_said("TILLER_CONFIG_VERSION");
  ModelRequest request;
  request.robot_dir = folder_.string();
  request.file = "mass.c";
  request.cost_type = "Cost";
  write("mass.c", mass_c());
  EXPECT_EQ(load_model(request, error_), nullptr);
  expect_said("cost_type is for .hpp files");
  request.file = "mass.hpp";
  request.type = "mine::Mass";
  request.cost_type = "Cost; int x";
  write("mass.hpp", mass_hpp());
  EXPECT_EQ(load_model(request, error_), nullptr);
  expect_said("must name a cost template");
}

TEST_F(Loader, CIsCompiledOnceAndAgainWhenItChanges) {
  write("mass.c", mass_c());
  const tiller_model_t* model = load("mass.c");
  ASSERT_NE(model, nullptr) << error_;
  EXPECT_EQ(objects(), 1);
  testing::internal::CaptureStderr();
  EXPECT_NE(load("mass.c"), nullptr) << error_;
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "the kept copy serves";
  EXPECT_EQ(objects(), 1);
  write("mass.c", mass_c() + "\n/* changed */\n");
  EXPECT_NE(load("mass.c"), nullptr) << error_;
  EXPECT_EQ(objects(), 2);
  const double x[] = {0, 2}, u[] = {3}, p[] = {1.5};
  const tiller_body_t body = {0, -9.81, 0, 0};
  double dxdt[2];
  model->dynamics(x, u, nullptr, &body, p, dxdt);
  EXPECT_EQ(dxdt[1], 2.0);
}

TEST_F(Loader, IncludedFilesCount) {
  write("divisor.h", "#define DIVISOR p[0]\n");
  std::string text = mass_c();
  const std::string divisor = "p[0]";
  text.replace(text.find(divisor), divisor.size(), "DIVISOR");
  write("mass.c", "#include \"divisor.h\"\n" + text);
  ASSERT_NE(load("mass.c"), nullptr) << error_;
  testing::internal::CaptureStderr();
  EXPECT_NE(load("mass.c"), nullptr) << error_;
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "nothing has changed";
  // what is included may be newer than the copy: a file of tomorrow stands for an edit
  fs::last_write_time(folder_ / "divisor.h", fs::file_time_type::clock::now() + std::chrono::hours(24));
  testing::internal::CaptureStderr();
  EXPECT_NE(load("mass.c"), nullptr) << error_;
  EXPECT_NE(testing::internal::GetCapturedStderr().find("compiling model"), std::string::npos);
}

TEST_F(Loader, CompilerErrorsNameTheUsersFileAndLine) {
  std::string text = mass_hpp();
  text.replace(text.find("x.velocity_m_s,"), 14, "x.velocity_mps");
  const std::string path = write("broken.hpp", text);
  EXPECT_EQ(load("broken.hpp", "mine::Mass"), nullptr);
  expect_said("does not compile");
  expect_said(path + ":14:15: error:");
  expect_said("velocity_mps");
  EXPECT_LT(std::count(error_.begin(), error_.end(), '\n'), 8) << "no chain of templates: " << error_;
  EXPECT_LT(error_.find(path + ":14:15: error:"), error_.find("that follow from this")) << error_;
  EXPECT_EQ(error_.find("/rollout/"), std::string::npos) << "no header of tiller: " << error_;
  write("broken.c", "int tiller_model(void { return 0; }\n");
  EXPECT_EQ(load("broken.c"), nullptr);
  expect_said("broken.c:1:");
  EXPECT_EQ(objects(), 0) << "a failed compilation leaves nothing to be loaded";
}

TEST_F(Loader, WrongRequestsAreRefused) {
  EXPECT_EQ(load("nowhere.hpp", "Mass"), nullptr);
  expect_said("no such model file");
  write("mass.hpp", mass_hpp());
  EXPECT_EQ(load("mass.hpp"), nullptr);
  expect_said("type must name the struct");
  for (const char* type : {"Mass); system(\"true\"", "1Mass", "a::", "::a", "a b", "a:b", "Mass<int>"}) {
    EXPECT_EQ(load("mass.hpp", type), nullptr) << type;
    expect_said("type must name the struct");
  }
  write("mass.c", mass_c());
  EXPECT_EQ(load("mass.c", "Mass"), nullptr);
  expect_said("has no type");
  write("mass.py", "");
  EXPECT_EQ(load("mass.py"), nullptr);
  expect_said("this is '.py'");
  write("text.so", "not an object");
  EXPECT_EQ(load("text.so"), nullptr);
  expect_said("cannot be loaded");
  EXPECT_EQ(load("mass.hpp", "mine::Weight"), nullptr);
  expect_said("Weight");
  EXPECT_EQ(load_model({}, error_), nullptr);
  expect_said("needs name");
}

TEST_F(Loader, FileNamesAreNeverCommands) {
  const fs::path trap = folder_ / "trap";
  const std::string name = "a b;touch " + trap.filename().string() + ";$(touch trap)`touch trap`.c";
  fs::current_path(folder_);
  write(name, mass_c());
  EXPECT_NE(load(name), nullptr) << error_;
  EXPECT_FALSE(fs::exists(trap));
  write("quote\".hpp", mass_hpp());
  EXPECT_EQ(load("quote\".hpp", "mine::Mass"), nullptr);
  expect_said("rename it");
}

TEST_F(Loader, MissingCompilerAndReadOnlyCache) {
  write("mass.c", mass_c());
  setenv("TILLER_CC", "/nonexistent/cc", 1);
  EXPECT_EQ(load("mass.c"), nullptr);
  expect_said("no compiler '/nonexistent/cc'");
  expect_said("TILLER_CC");
  unsetenv("TILLER_CC");
  setenv("TILLER_CACHE", "/proc/nowhere", 1);
  EXPECT_EQ(load("mass.c"), nullptr);
  expect_said("TILLER_CACHE");
}

TEST_F(Loader, ACacheThatOthersMayWriteIsNotTrusted) {
  write("mass.c", mass_c());
  fs::create_directories(folder_ / "cache");
  fs::permissions(folder_ / "cache", fs::perms::all);
  EXPECT_EQ(load("mass.c"), nullptr);
  expect_said("not to be trusted");
}

TEST_F(Loader, TablesAreChecked) {
  const struct {
    const char* from;
    const char* to;
    const char* said;
  } cases[] = {
      {"TILLER_MODEL_VERSION, .name", "77, .name", "size or version"},
      {".state_count = 2", ".state_count = 33", "state_count is 33; allowed: 1 to 32"},
      {".input_count = 1", ".input_count = 0", "input_count is 0"},
      {".dynamics = dynamics", ".jacobian = 0", "has no dynamics"},
      {"\"velocity_m_s\"", "\"position_m\"", "has 'position_m' twice"},
      {".param_names = params", ".param_names = 0", "param_names is null"},
      {".state_count = 2", ".state_count = 3", "state_count is 3 and state_names has 2 elements"},
      {".input_count = 1", ".input_count = 2", "input_count is 2 and input_names has 1 element"},
      {".param_count = 1", ".param_count = 9", "param_count is 9 and param_names has 1 element"},
      {".input_count = 1", ".input_count = 1, .joint_count = 1", "force_names is null"},
      {".input_count = 1", ".input_count = 1, .output_count = 1, .output_names = states", "outputs is null"},
      {"\"velocity_m_s\"", "0", "state_names[1] is null"},
      {"\"velocity_m_s\"", "(const char*)12", "state_names[1] points to no text"},
      {"\"velocity_m_s\"", "\"speed, m/s\"", "state_names[1] is no name"},
      {".state_names = states", ".state_names = (const char* const*)64", "state_names[0] lies beyond"},
      {"\"velocity_m_s\"", "\"force_N\"", "'force_N' stands in state_names and in input_names"},
      {".input_count = 1", ".input_count = 1, .angle_mask = 4", "angle_mask has bits beyond the 2 states"},
      {".name = \"mass\"", ".name = \"\"", "has no name"},
      {"return &model;", "return 0;", "returned null"},
      {"tiller_model(void)", "my_model(void)", "has no function"},
  };
  for (const auto& c : cases) {
    std::string text = mass_c();
    for (std::size_t at = text.find(c.from); at != std::string::npos; at = text.find(c.from, at + 1)) {
      text.replace(at, std::string(c.from).size(), c.to);
    }
    write("table.c", text);
    EXPECT_EQ(load("table.c"), nullptr) << c.said;
    expect_said(c.said);
  }
}

/// mass_c() with `from` in the place of `to`, wherever it stands.
std::string changed_mass(const std::string& from, const std::string& to) {
  std::string text = mass_c();
  EXPECT_NE(text.find(from), std::string::npos) << from;
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

TEST_F(Loader, ATableWithoutSymbolsIsReadWithCareToo) {
  write("mass.c", changed_mass(".state_count = 2", ".state_count = 32"));
  const std::string object = (folder_ / "mass.so").string();
  const ChildResult compiled = run_child({"cc", "-shared", "-fPIC", "-s", "-std=c99", "-I" TILLER_TEST_INCLUDE,
                                          (folder_ / "mass.c").string(), "-o", object});
  ASSERT_EQ(compiled.exit_code, 0) << compiled.output;
  EXPECT_EQ(load("mass.so"), nullptr) << "where 30 names end nobody knows; some of them are none";
  expect_said("model 'mass': state_names[");
}

TEST_F(Loader, FunctionsKeepToTheirArrays) {
  const struct {
    const char* from;
    const char* to;
    const char* said;
  } cases[] = {
      {"dxdt[0] = x[1];", "", "dynamics does not write dxdt[0] (of position_m)"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1]; dxdt[2] = 0;", "dynamics writes dxdt[2], outside of dxdt"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1]; dxdt[100000000] = 0;", "segmentation fault"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1] + p[1];", "dynamics reads beyond p, whose length is param_count = 1"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1] + f[0];", "dynamics reads beyond f, whose length is joint_count = 0"},
      {"dxdt[0] = x[1];", "static int n; dxdt[0] = x[1] + ++n;", "answers differently to the same arguments"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1]; ((double*)x)[0] = 0.5;", "dynamics changes its argument x"},
      {"dxdt[0] = x[1];", "dxdt[0] = x[1]; for (volatile int i = 0;; i = 1) {}", "dynamics does not return"},
      {".dynamics = dynamics", ".dynamics = dynamics, .output_count = 1, .output_names = params, .outputs = outputs",
       "outputs does not write y[0] (mass_kg)"},
      {".dynamics = dynamics", ".dynamics = dynamics, .jacobian = jacobian",
       "jacobian writes a[4], outside of a, whose length is 4 (state_count = 2, squared)"},
  };
  const std::string others = R"(
static void outputs(const double* x, const double* p, double* y) { (void)x; (void)p; (void)y; }
static void jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* a, double* b) {
  (void)x; (void)u; (void)f; (void)body; (void)p;
  for (int i = 0; i < 5; ++i) a[i] = 0;
  b[0] = b[1] = 0;
}
static const char* const states)";
  for (const auto& c : cases) {
    std::string text = changed_mass(c.from, c.to);
    const std::string head = "static const char* const states";
    text.replace(text.find(head), head.size(), others);
    write("table.c", text);
    EXPECT_EQ(load("table.c"), nullptr) << c.said;
    expect_said("model 'mass': ");
    expect_said(c.said);
  }
}

TEST_F(Loader, WhatCOnlyWarnsOfIsAnError) {
  const struct {
    const char* from;
    const char* to;
    const char* said;
  } cases[] = {
      {"double* dxdt", "float* dxdt", "table.c:13:38: error: initialization of"},
      {"const double* x,", "const float* x,", "the arguments that tiller/model.h declares, double throughout"},
      {"x[1];", "velocity(x);", "implicit declaration of function 'velocity'"},
      {"dxdt[0] = x[1];", "double v; dxdt[0] = v;", "'v' is used uninitialized"},
  };
  for (const auto& c : cases) {
    write("table.c", changed_mass(c.from, c.to));
    EXPECT_EQ(load("table.c"), nullptr) << c.said;
    expect_said("does not compile");
    expect_said(c.said);
  }
}

TEST_F(Loader, AnObjectWithFloatsIsFoundByWhatItDoesNotWrite) {
  write("mass.c", changed_mass("double* dxdt", "float* dxdt"));
  const std::string object = (folder_ / "mass.so").string();
  const ChildResult compiled = run_child({"cc", "-shared", "-fPIC", "-w", "-std=c99", "-fpermissive",
                                          "-I" TILLER_TEST_INCLUDE, (folder_ / "mass.c").string(), "-o", object});
  ASSERT_EQ(compiled.exit_code, 0) << compiled.output;
  EXPECT_EQ(load("mass.so"), nullptr);
  expect_said("dynamics does not write dxdt[1] (of velocity_m_s)");
}

/// What a compiler says of a template, without kernels: of one instantiation, in a second.
std::string compiler_says(const fs::path& folder, const std::string& model, const CompiledSource& source) {
  std::ofstream(source.path) << model;
  std::ofstream(source.wrapper)
      << "#include \"" << source.path << "\"\nusing M = mine::Mass<double>;\n"
      << "M::State rate(const M::State& x) { return M::dynamics(x, {1.0}, {0.0}, {}, {2.0}); }\n";
  const ChildResult child = run_child({"env", "LC_ALL=C", "c++", "-std=c++17", "-Wextra", "-fsyntax-only",
                                       "-I" TILLER_TEST_INCLUDE, "-I" TILLER_TEST_INCLUDE "/..", source.wrapper});
  EXPECT_TRUE(child.started) << folder;
  return child.output;
}

TEST_F(Loader, AFieldThatIsLeftOutIsNoZero) {
  const CompiledSource source = {
      (folder_ / "mass.hpp").string(), (folder_ / "wrapper.cpp").string(), {TILLER_TEST_INCLUDE}};
  EXPECT_EQ(left_out_fields(compiler_says(folder_, mass_hpp(), source), source), "");
  std::string model = mass_hpp();
  const std::string second = ", (u.force_N + f.rail_N) / p.mass_kg";
  model.replace(model.find(second), second.size(), "");
  const std::string told = left_out_fields(compiler_says(folder_, model, source), source);
  EXPECT_NE(told.find(source.path + ":14:27: error: no value for velocity_m_s"), std::string::npos) << told;
  // a joint that nothing drives needs no word of it
  std::string joint = mass_hpp();
  joint.replace(joint.find("0, 1, 0, 0"), 10, "0, 1, 0");
  EXPECT_EQ(left_out_fields(compiler_says(folder_, joint, source), source), "");
}

TEST_F(Loader, ErrorsInHeadersAreToldOfTheModel) {
  const CompiledSource source = {"/home/me/arm.hpp", "/cache/arm.cpp", {"/opt/tiller/include"}};
  const std::string missing =
      "/opt/tiller/include/rollout/model_adapter.hpp: In instantiation of 'void f()':\n"
      "/opt/tiller/include/rollout/model_adapter.hpp:174:28: error: 'dynamics' is not a member of 'Arm<double>'\n"
      "  174 |       return M<S>::dynamics(x, u, f, body, p);\n";
  EXPECT_EQ(author_errors(missing, source).find("  | /home/me/arm.hpp: error: the model has no dynamics\n"), 0u)
      << author_errors(missing, source);
  const std::string name = "/cache/arm.cpp:3:21: error: 'Arm' was not declared in this scope; did you mean 'Arms'?\n";
  EXPECT_NE(author_errors(name, source).find("[model] type"), std::string::npos);
  const std::string late = missing +
                           "/home/me/parts/joint.hpp:7:3: error: 'q' was not declared in this scope\n"
                           "    7 |   q + 1\n      |   ^\n";
  EXPECT_EQ(author_errors(late, source),
            "  | /home/me/parts/joint.hpp:7:3: error: 'q' was not declared in this scope\n"
            "  |     7 |   q + 1\n  |       |   ^\n  | (and 1 that follow from this or repeat it)\n");
}

}  // namespace
}  // namespace tiller::tools
