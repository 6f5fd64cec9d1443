// A CasADi function as its instructions: the equations that an import writes of it against CasADi's own values and
// slopes, which are stored beside it (casadi_test.py --write), and what is refused or told.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "function.hpp"  // as imported
#include "function_lanes.hpp"
#include "scalar/dual.hpp"
#include "scalar/isa.hpp"
#include "tools/import/function_model.hpp"

namespace tiller {
#define TILLER_DECLARE(isa)                 \
  namespace isa {                           \
  Rows derivatives_f32(const Rows& points); \
  Rows derivatives_f64(const Rows& points); \
  }
#ifdef TILLER_TEST_HAS_sse2
TILLER_DECLARE(sse2)
#endif
#ifdef TILLER_TEST_HAS_avx2
TILLER_DECLARE(avx2)
#endif
#ifdef TILLER_TEST_HAS_avx512
TILLER_DECLARE(avx512)
#endif
#ifdef TILLER_TEST_HAS_neon
TILLER_DECLARE(neon)
#endif
#ifdef TILLER_TEST_HAS_scalar
TILLER_DECLARE(scalar)
#endif
}  // namespace tiller

namespace tiller::tools {
namespace {

using Json = nlohmann::json;
using Imported = ::Function<double>;

constexpr std::size_t kStates = 5, kInputs = 2;

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
Json function() { return Json::parse(text_of(TILLER_FUNCTION ".json")); }
std::string details() { return text_of(TILLER_FUNCTION ".details.toml"); }
Json values() { return Json::parse(text_of(TILLER_FUNCTION "_values.json")); }
std::vector<double> numbers(const Json& json) { return json.get<std::vector<double>>(); }

template <class Into>
Into filled(const std::vector<double>& from) {
  Into into;
  EXPECT_EQ(sizeof into, from.size() * sizeof(double));
  std::memcpy(static_cast<void*>(&into), from.data(), sizeof into);
  return into;
}
template <class From>
std::vector<double> listed(const From& from) {
  std::vector<double> out(sizeof from / sizeof(double));
  std::memcpy(out.data(), static_cast<const void*>(&from), sizeof from);
  return out;
}
/// Without the parameter that changes nothing, the last.
std::vector<double> parameters(const Json& row) {
  std::vector<double> p = numbers(row["p"]);
  p.pop_back();
  return p;
}
void expect_close(double ours, double theirs, double tolerance, const std::string& where) {
  EXPECT_NEAR(ours, theirs, tolerance * std::max(1.0, std::fabs(theirs))) << where;
}

// ---- the equations --------------------------------------------------------------------------------

TEST(Function, ValuesAreCasadis) {
  const Json rows = values();
  ASSERT_GE(rows.size(), 40u);
  for (const Json& row : rows) {
    const auto x = filled<Imported::State>(numbers(row["x"]));
    const auto p = filled<Imported::Params>(parameters(row));
    const std::vector<double> rates = listed(Imported::dynamics(x, filled<Imported::Input>(numbers(row["u"])),
                                                                filled<Imported::Force>(numbers(row["f"])), {}, p));
    const std::vector<double> told = listed(Imported::outputs(x, p));
    // sums in another order: some units in the last place of their terms
    for (std::size_t k = 0; k < kStates; ++k)
      expect_close(rates[k], numbers(row["xdot"])[k], 1e-12, Imported::State::names[k]);
    for (std::size_t k = 0; k < 2; ++k) expect_close(told[k], numbers(row["y"])[k], 1e-12, Imported::Output::names[k]);
  }
}

TEST(Function, SlopesAreCasadis) {
  using D = Dual<double, 7>;
  using Model = ::Function<D>;
  std::size_t compared = 0;
  for (const Json& row : values()) {
    const std::vector<double> x = numbers(row["x"]), u = numbers(row["u"]), p = parameters(row), f = numbers(row["f"]);
    D all[kStates + kInputs];
    for (std::size_t k = 0; k < kStates + kInputs; ++k)
      all[k] = D::seed(k < kStates ? x[k] : u[k - kStates], static_cast<int>(k));
    const Model::State dx = Model::dynamics({all[0], all[1], all[2], all[3], all[4]}, {all[5], all[6]}, {f[0], f[1]},
                                            {}, {p[0], p[1], p[2], p[3], p[4]});
    const D rates[kStates] = {dx.a_rad, dx.b_m, dx.a_rad_s, dx.b_m_s, dx.c};
    for (std::size_t r = 0; r < kStates; ++r)
      for (std::size_t c = 0; c < kStates + kInputs; ++c) {
        const Json& theirs = c < kStates ? row["by_x"][r][c] : row["by_u"][r][c - kStates];
        EXPECT_TRUE(std::isfinite(rates[r].d[c]));
        if (!theirs.is_number()) continue;  // CasADi multiplies 0 by the infinite slope of the branch that is not taken
        ++compared;
        expect_close(rates[r].d[c], theirs.get<double>(), 1e-11, std::to_string(r) + " by " + std::to_string(c));
      }
  }
  EXPECT_GE(compared, 1000u);
}

// The branch that is not taken has a root of a negative number.
TEST(Function, ABranchHidesTheOther) {
  for (const double b : {-1.5, 0.0, 1.5}) {
    const Imported::State dx = Imported::dynamics({0.3, b, 0.1, 0.2, 0.7}, {0.0, 0.0}, {0.0, 0.0}, {}, {1, 1, 1, 1, 1});
    EXPECT_TRUE(std::isfinite(dx.c)) << b;
  }
}

void expect_lanes(Rows (*f32)(const Rows&), Rows (*f64)(const Rows&)) {
  Rows points;
  const Json rows = values();
  for (const Json& row : rows) {
    points.push_back(numbers(row["x"]));
    for (const std::vector<double>& more : {numbers(row["u"]), numbers(row["f"]), parameters(row)})
      points.back().insert(points.back().end(), more.begin(), more.end());
  }
  const Rows coarse = f32(points), fine = f64(points);
  ASSERT_EQ(fine.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    for (std::size_t k = 0; k < kStates; ++k) {
      const double theirs = numbers(rows[i]["xdot"])[k];
      expect_close(fine[i][k], theirs, 1e-12, "f64");
      expect_close(coarse[i][k], theirs, 2e-4, "f32");  // b^7 and the steps' arguments have 24 bits
    }
}
#ifdef TILLER_TEST_HAS_sse2
TEST(FunctionLanes, Sse2) { expect_lanes(sse2::derivatives_f32, sse2::derivatives_f64); }
#endif
#ifdef TILLER_TEST_HAS_avx2
TEST(FunctionLanes, Avx2) {
  if (!has_isa(Isa::avx2)) GTEST_SKIP() << "this processor has no AVX2: its copy cannot run here";
  expect_lanes(avx2::derivatives_f32, avx2::derivatives_f64);
}
#endif
#ifdef TILLER_TEST_HAS_avx512
TEST(FunctionLanes, Avx512) {
  if (!has_isa(Isa::avx512)) GTEST_SKIP() << "this processor has no AVX-512: its copy cannot run here";
  expect_lanes(avx512::derivatives_f32, avx512::derivatives_f64);
}
#endif
#ifdef TILLER_TEST_HAS_neon
TEST(FunctionLanes, Neon) { expect_lanes(neon::derivatives_f32, neon::derivatives_f64); }
#endif
#ifdef TILLER_TEST_HAS_scalar
TEST(FunctionLanes, Scalar) { expect_lanes(scalar::derivatives_f32, scalar::derivatives_f64); }
#endif

// ---- refusals -------------------------------------------------------------------------------------

/// What an import says of a function, one problem a line; empty: it takes it.
std::string refusal(const Json& json, const std::string& toml, FunctionModel& model, const Words& unknown = {}) {
  FunctionText text;
  Words errors;
  if (read_compiled_function(json.dump(), "f.casadi", text, errors) &&
      (toml.empty() || read_function_details(toml, "f.details.toml", text, errors)))
    (void)build_function_model(text, unknown, model, errors);
  std::string all;
  for (const std::string& error : errors) all += error + "\n";
  return all;
}
std::string refusal(const Json& json, const std::string& toml = details(), const Words& unknown = {}) {
  FunctionModel model;
  return refusal(json, toml, model, unknown);
}
void expect_in(const std::string& all, const std::string& part) { EXPECT_NE(all.find(part), std::string::npos) << all; }
std::string told(const Json& json, const std::string& toml, FunctionModel& model) {
  EXPECT_EQ(refusal(json, toml, model), "");
  std::string all;
  for (const std::string& note : model.notes) all += note + "\n";
  return all;
}

/// A function of two states, one input and a list of parameters, with samples where `samples` has some.
Json small(const Json& instructions, const Words& parameters = {}, const Json& samples = Json::array()) {
  const auto column = [](const char* name, std::size_t rows, const Words& elements) {
    Json port{{"name", name}, {"shape", {rows, 1}}, {"rows", Json::array()}, {"columns", Json::array()}};
    for (std::size_t k = 0; k < rows; ++k) port["rows"].push_back(k), port["columns"].push_back(0);
    if (!elements.empty()) port["elements"] = elements;
    return port;
  };
  Json out{{"casadi", "0"}, {"name", "small"}, {"instructions", instructions}, {"samples", samples}};
  out["inputs"] = {column("x", 2, {"q_rad", "v_rad_s"}), column("u", 1, {"u_Nm"})};
  if (!parameters.empty()) out["inputs"].push_back(column("p", parameters.size(), parameters));
  out["outputs"] = {column("xdot", 2, {})};
  return out;
}
/// xdot = [v, op(q, u)].
Json with(const Json& operation) {
  return small({{"input", 0, 0, 0},
                {"input", 1, 0, 1},
                {"input", 2, 1, 0},
                operation,
                {"output", 0, 0, 1},
                {"output", 0, 1, 3}});
}

TEST(Function, WhatHasNoPlaceInAModelIsRefusedByName) {
  EXPECT_EQ(refusal(with({"add", 3, 0, 2}), ""), "");
  expect_in(refusal(with({"erf", 3, 0}), ""),
            "f.casadi: xdot[1] needs operation 'erf', which has no place in a model; write");
  expect_in(refusal(with({"asinh", 3, 0}), ""),
            "operation 'asinh', which has no place in a model; write log(x + sqrt(x^2 + 1))");
  expect_in(refusal(with({"call of 'lut' (BSplineInterpolant)", 3, 0}), ""),
            "operation 'call of 'lut' (BSplineInterpolant)'");
  expect_in(refusal(with({"const", 3, "nan"}), ""), "xdot[1] needs a constant NaN");
  expect_in(refusal(with({"const", 3, "-inf"}), ""), "xdot[1] needs a constant infinity");
  // what nobody needs is not refused, nor is what a constant condition leaves out
  EXPECT_EQ(
      refusal(small({{"input", 0, 0, 1}, {"erf", 1, 0}, {"const", 1, "nan"}, {"output", 0, 0, 0}, {"output", 0, 1, 0}}),
              ""),
      "");
  EXPECT_EQ(refusal(small({{"const", 0, 0.0},
                           {"const", 1, "nan"},
                           {"if_else_zero", 2, 0, 1},
                           {"output", 0, 0, 2},
                           {"output", 0, 1, 2}}),
                    ""),
            "");
  // 1 / 0 among constants
  expect_in(refusal(small({{"const", 0, 0.0},
                           {"inv", 1, 0},
                           {"input", 2, 0, 0},
                           {"mul", 1, 1, 2},
                           {"output", 0, 0, 1},
                           {"output", 0, 1, 1}}),
                    ""),
            "xdot[0], xdot[1] need a constant infinity");
}

TEST(Function, AnotherListThanAFunctionsIsTold) {
  expect_in(refusal(with({"add", 3, 0, 9}), ""), "its instructions do not belong together");
  expect_in(refusal(with({"add", 3, 0}), ""), "its instructions do not belong together");
  expect_in(refusal(with({"input", 3, 0, 7}), ""), "its instructions do not belong together");
  expect_in(refusal(small({{"input", 0, 0, 0}, {"output", 4, 0, 0}}), ""), "its instructions do not belong together");
  expect_in(refusal(Json{{"casadi", "0"}}, ""), "cannot be read");
  expect_in(refusal(Json{{"error", "CasADi does not load it"}}, ""), "f.casadi: CasADi does not load it");
  Json cut = function();
  cut["inputs"][0]["elements"].erase(0);
  expect_in(refusal(cut), "input 'x' has not a name for each element");
  Json outside = function();
  outside["outputs"][0]["rows"][1] = 77;
  expect_in(refusal(outside), "'xdot' has not the elements that its shape says");
  Json wrong = function();
  for (Json& row : wrong["instructions"])  // another function than the one that the samples are of
    if (row[0] == "tan") row[0] = "tanh";
  expect_in(refusal(wrong), "where CasADi has");
}

TEST(Function, WrongShapesAreTold) {
  Json three = with({"add", 3, 0, 2});
  three["outputs"][0]["shape"] = {3, 1};
  expect_in(refusal(three, ""), "xdot is 3 x 1 where x has 2 elements");
  Json square = with({"add", 3, 0, 2});
  square["inputs"][0]["shape"] = {2, 2};
  expect_in(refusal(square, ""), "x is 2 x 2 with structural zeros; it has to be a dense column");
  Json without = with({"add", 3, 0, 2});
  without["inputs"][1]["name"] = "w";
  expect_in(refusal(without, ""), "has no argument u (inputs); there are x, w");
  without["outputs"][0]["name"] = "z";
  expect_in(refusal(without, ""), "has no result xdot (derivatives); there are z");
  // by place, where nothing has a name
  Json unnamed = with({"add", 3, 0, 2});
  unnamed["inputs"][0]["name"] = "i0", unnamed["inputs"][1]["name"] = "i1", unnamed["outputs"][0]["name"] = "o0";
  FunctionModel model;
  expect_in(told(unnamed, "", model), "taken as x, u, p, f in this order");
  // time, and outputs of inputs
  Json timed = small({{"input", 0, 0, 1}, {"input", 1, 2, 0}, {"output", 0, 0, 0}, {"output", 0, 1, 1}}, {"t"});
  timed["inputs"][2]["name"] = "t";
  expect_in(
      refusal(timed, ""),
      "xdot[1] needs argument 't', which has no place in a model; arguments are x, u, p and f: equations do not depend on time");
  Json direct = function();
  for (Json& row : direct["instructions"])
    if (row[0] == "output" && row[1] == 1 && row[2] == 0) row[3] = 999;
  direct["instructions"].insert(direct["instructions"].begin(), Json{"input", 999, 1, 0});
  direct["samples"] = Json::array();
  expect_in(refusal(direct), "y[0] (tip_m) depends on u.push_N; outputs are of states and parameters alone");
}

TEST(Function, NamesAreChecked) {
  const Json f = with({"add", 3, 0, 2});
  expect_in(refusal(f, "names.x = [\"q\"]"), "f.details.toml: names.x has 1 names where the function has 2 elements");
  expect_in(refusal(f, "names.x = [\"q\", \"q\"]"), "two elements are called 'q'");
  expect_in(refusal(f, "names.x = [\"u_Nm\", \"v\"]"), "two elements are called 'u_Nm'");
  expect_in(refusal(f, "names.x = [\"double\", \"v\"]"), "is called 'double', a word of C++");
  expect_in(refusal(f, "names.x = [\"count\", \"v\"]"), "is called 'count', a word of C++ or of tiller");
  expect_in(refusal(f, "names.x = [\"a b\", \"v\"]"), "has 'a b'; names are letters");
  expect_in(refusal(f, "names.z = [\"a\"]"), "names.z is none of names.x, u, p, f, y");
  expect_in(refusal(f, "nmaes.x = [\"a\"]"), "nmaes is no key here; is 'names' meant?");
  expect_in(refusal(f, "names.x = 3"), "names.x is not a list of texts");
  expect_in(refusal(f, "period_s = -1"), "period_s is not a number of seconds above 0");
  expect_in(refusal(f, "limits.u_N = 3"), "limits.u_N is no input; is 'u_Nm' meant?");
  expect_in(refusal(f, "limits.u_Nm = [3, 1]"), "limits.u_Nm is not a range");
  expect_in(refusal(f, "angles = [\"w\"]"), "angles has 'w', which is no state");
  expect_in(refusal(f, "[names\nx = 1"), "f.details.toml:1: ");
  expect_in(refusal(f, "joints.arm = \"u_Nm\""), "joints.arm is not { velocity");
  expect_in(refusal(f, "joints.arm = { velocity = \"v\", force = \"u_Nm\" }"),
            "which is no state; there are q_rad, v_rad_s");
  expect_in(refusal(f, "joints.arm = { velocity = \"v_rad_s\", force = \"u\" }"),
            "which is no input and no element of f");
}

// A bioreactor's rates are per hour: a model's derivatives are per second.
TEST(Function, RatesPerHourAreTakenAsSuch) {
  // xdot = [mu x, u]
  const Json f = small({{"input", 0, 0, 0},
                        {"input", 1, 2, 0},
                        {"mul", 1, 0, 1},
                        {"input", 2, 1, 0},
                        {"output", 0, 0, 1},
                        {"output", 0, 1, 2}},
                       {"mu_1_h"});
  const std::string names = "[names]\nx = [\"biomass_g_L\", \"volume_L\"]\nu = [\"feed_L_h\"]\n";
  const std::string values = "[parameters]\nmu_1_h = 0.4\n";
  const auto rate = [](FunctionModel& model, std::size_t k) {
    Words code;
    (void)emit_code(model.graph, {model.derivatives[k]}, "", code);
    return code[0];
  };
  FunctionModel model;
  expect_in(told(f, names + values, model),
            "its derivatives are taken as changes per hour, for its rates are (feed_L_h, "
            "mu_1_h), and divided by 3600; if they are per second: time = \"s\"");
  EXPECT_EQ(rate(model, 1), "u.feed_L_h * S(0.0002777777777777778)");
  const std::string robot = write_function_robot(model, "f.hpp");
  expect_in(robot, "\nperiod_s = 72\n");
  expect_in(robot, "volume_L = 0.00017");
  expect_in(robot, "sensor_timeout_s = 360\n");

  FunctionModel by_second, by_minute;
  EXPECT_EQ(told(f, "time = \"s\"\n" + names + values, by_second).find("per hour"), std::string::npos);
  EXPECT_EQ(rate(by_second, 1), "u.feed_L_h");
  (void)told(f, "time = \"min\"\n" + names + values, by_minute);
  EXPECT_EQ(rate(by_minute, 1), "u.feed_L_h * S(0.016666666666666666)");

  // names of both kinds decide nothing, and a joint's speed is per second
  const std::string both = "[names]\nx = [\"x_m\", \"x_m_s\"]\nu = [\"feed_L_h\"]\n";
  expect_in(refusal(f, both + values), "has rates per hour (feed_L_h, mu_1_h) and per second (x_m_s); say what");
  expect_in(refusal(f, "time = \"day\"\n" + names + values), "time is not \"s\", \"min\" or \"h\"");
  expect_in(
      refusal(with({"add", 3, 0, 2}), "time = \"h\"\n[joints]\na = { velocity = \"v_rad_s\", force = \"u_Nm\" }\n"),
      "has derivatives per h and joints");
}

TEST(Function, ParametersHaveValues) {
  FunctionModel model;
  const std::string notes = told(function(), details(), model);
  expect_in(notes, "parameters idle change nothing: left out");
  ASSERT_EQ(model.parameters.size(), 5u);
  // the matrix by rows in the details, by columns in CasADi
  const double columns[] = {1.0, 0.25, 0.5, 2.0, 1.5};
  for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(model.parameters[k].value, columns[k]) << model.parameters[k].name;
  EXPECT_EQ(model.period_s, 0.01);
  EXPECT_EQ(model.limits[0], std::make_pair(-3.0, 3.0));
  EXPECT_EQ(model.limits[1], std::make_pair(-1.0, 2.0));

  const Json f = small({{"input", 0, 0, 1},
                        {"input", 1, 2, 0},
                        {"input", 2, 2, 1},
                        {"mul", 1, 1, 2},
                        {"output", 0, 0, 0},
                        {"output", 0, 1, 1}},
                       {"k_0", "k_1"});
  expect_in(refusal(f, ""),
            "parameters without a value: k_0, k_1; give them with --value k_0=NUMBER,k_1=NUMBER, or in f.details.toml");
  expect_in(refusal(f, "parameters.k = [1]"), "parameters.k has 1 numbers, and none for k_1");
  EXPECT_EQ(refusal(f, "parameters.k = [1, 2]"), "");
  EXPECT_EQ(refusal(f, "parameters.k_0 = 1\nparameters.k_1 = 2"), "");
  expect_in(refusal(f, "parameters = { k = [1, 2], m = 3 }"), "parameters.m is no parameter of the function");
  expect_in(refusal(f, "parameters.k = \"a\""), "parameters.k is not a number, a list of numbers");
  expect_in(refusal(f, "parameters.k = [[1, 2], [3]]"), "parameters.k is not a number, a list of numbers");
  expect_in(refusal(f, "parameters.k = [inf, 1]"), "parameters.k is not");
  expect_in(refusal(f, "parameters.k = [1, 2]", {"k_2"}), "--unknown k_2: is no parameter of f.casadi; is 'k_");
  expect_in(refusal(function(), details(), {"idle"}),
            "--unknown idle: is no parameter of f.casadi that changes anything");
}

TEST(Function, JointsAreFoundAndChecked) {
  FunctionModel model;
  told(function(), details(), model);
  ASSERT_EQ(model.joints.size(), 2u);
  EXPECT_EQ(model.joints[0].name, "a");
  EXPECT_EQ(model.joints[0].position, 0);
  EXPECT_EQ(model.joints[0].velocity, 2);
  EXPECT_EQ(model.joints[0].drive, -1) << "push_N drives both accelerations and the fifth state";
  EXPECT_EQ(model.joints[1].velocity, 3);
  EXPECT_EQ(model.angles, 1u) << "a_rad enters by sines alone";
  FunctionModel plain;
  told(function(), details() + "\n", plain);
  FunctionModel flat;
  told(function(), "angles = []\n" + details(), flat);
  EXPECT_EQ(flat.angles, 0u);

  // an input as the force of a joint, where the function has none
  FunctionModel arm;
  told(with({"add", 3, 0, 2}), "joints.arm = { velocity = \"v_rad_s\", force = \"u_Nm\" }", arm);
  ASSERT_EQ(arm.joints.size(), 1u);
  EXPECT_EQ(arm.joints[0].position, 0);
  EXPECT_EQ(arm.joints[0].drive, 0);
  expect_in(write_function_model(arm).text, "u.u_Nm + f.u_Nm");
  FunctionModel none;
  expect_in(told(with({"add", 3, 0, 2}), "", none), "has no forces f, so effects at joints");
  expect_in(refusal(with({"mul", 3, 2, 2}), "joints.arm = { velocity = \"v_rad_s\", force = \"u_Nm\" }"),
            "xdot[1] (of v_rad_s) is no straight line of the forces u_Nm");
  expect_in(refusal(with({"sin", 3, 0}), "joints.arm = { velocity = \"v_rad_s\", force = \"u_Nm\" }"),
            "the force u_Nm of joint arm changes nothing");
  // more forces than positions
  Json two = with({"add", 3, 0, 2});
  two["inputs"].push_back(
      {{"name", "f"}, {"shape", {2, 1}}, {"rows", {0, 1}}, {"columns", {0, 0}}, {"elements", {"f_0", "f_1"}}});
  expect_in(refusal(two, ""), "forces f_0, f_1 have no joint");
}

// if_else of a constant is no branch, and a plain one is one select, not two.
TEST(Function, IfElseIsOneSelect) {
  FunctionModel model;
  const Json f = small({{"input", 0, 0, 0},
                        {"const", 1, 0.5},
                        {"lt", 1, 0, 1},
                        {"input", 2, 0, 1},
                        {"if_else_zero", 3, 1, 2},
                        {"not", 1, 1},
                        {"input", 4, 1, 0},
                        {"if_else_zero", 1, 1, 4},
                        {"add", 3, 3, 1},
                        {"output", 0, 0, 2},
                        {"output", 0, 1, 3}});
  told(f, "", model);
  EXPECT_FALSE(model.is_smooth);
  const std::string text = write_function_model(model).text;
  expect_in(text, "select(x.q_rad < S(0.5), x.v_rad_s, u.u_Nm)");
  EXPECT_EQ(text.find("select("), text.rfind("select("));
}

TEST(Function, TheRobotFileHasWhatIsKnown) {
  FunctionModel known, vague;
  told(function(), details(), known);
  const std::string file = write_function_robot(known, "function.hpp");
  expect_in(file, "period_s = 0.01\n");
  expect_in(file, "gains_1 = 0.25\n");
  expect_in(file, "pull_N = { low = -1, high = 2, safe = 0 }\n");
  expect_in(file, "[posterior]\nenabled = false\nparticles = 16\nmoves_per_tick = 8\n");
  expect_in(file, "kind = \"hybrid\"");  // it has branches
  EXPECT_EQ(file.find("\na_rad_s = { sd"), std::string::npos) << "velocities are not measured";
  ASSERT_EQ(refusal(function(), details(), vague, {"k_N"}), "");
  const std::string unsure = write_function_robot(vague, "function.hpp");
  expect_in(unsure, "k_N = { log_normal = [1.5, 0.25] }\n");
  expect_in(unsure, "draw = true");
}

// What a file holds decides, not its name; a Python source is not run.
TEST(Function, TheFormatIsToldByTheContent) {
  const std::string stem = ::testing::TempDir() + "function_test_format";
  std::ofstream(stem + ".x") << "jhpnnagiieahaaaadaaaaaaaaaaaaaaaaafaegaa";
  std::ofstream(stem + ".y") << function().dump();
  std::ofstream(stem + ".z") << "<robot name=\"r\"/>";
  EXPECT_TRUE(is_function(stem + ".x"));
  EXPECT_TRUE(is_function(stem + ".y"));
  EXPECT_FALSE(is_function(stem + ".z"));
  EXPECT_FALSE(is_function(stem + ".none"));
  FunctionText text;
  Words errors;
  EXPECT_FALSE(read_function(stem + ".y", stem + ".none", text, errors));
  expect_in(errors.back(), "there is no such file; --details names");
  ASSERT_EQ(setenv("TILLER_PYTHON", "false", 1), 0);
  EXPECT_FALSE(read_function(stem + ".x", "", text, errors));
  expect_in(errors.back(), stem + ".x: ");
}

}  // namespace
}  // namespace tiller::tools
