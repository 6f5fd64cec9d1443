// Accepted logs, and the errors for all others: file, line, column, remedy.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {
namespace {

const tiller_model_t& pendulum() { return *tiller_find_model("pendulum"); }

LogMap dfki_map() {
  LogMap map;
  map.time = "time";
  map.columns = {{"angle_rad", "position"}, {"rate_rad_s", "velocity"}, {"torque_Nm", "torque"}};
  return map;
}

std::string write_file(const std::string& name, const std::string& text) {
  const std::string path = (std::filesystem::path(testing::TempDir()) / name).string();
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

// A swing of 0.5 rad at 1 Hz, 100 Hz rows; `change` may spoil a row's text.
std::string swing(int rows, double time_factor = 1, double angle_factor = 1, double rate_factor = 1) {
  std::string text = "time,position,velocity,torque\n";
  for (int i = 0; i < rows; ++i) {
    const double t = 0.01 * i, w = 6.283185307179586;
    char row[128];
    std::snprintf(row, sizeof row, "%.6f,%.6f,%.6f,%.6f\n", t * time_factor, angle_factor * 0.5 * std::sin(w * t),
                  rate_factor * 0.5 * w * std::cos(w * t), 0.1 * std::cos(3 * t));
    text += row;
  }
  return text;
}

// Replaces line `line` (1-based) of a text.
std::string with_line(const std::string& text, int line, const std::string& replacement) {
  std::string result;
  std::size_t from = 0;
  for (int i = 1; from < text.size(); ++i) {
    const std::size_t end = text.find('\n', from) + 1;
    result += i == line ? replacement : text.substr(from, end - from);
    from = end;
  }
  return result;
}

struct Outcome {
  bool read = false, good = false;
  std::string error;
  std::vector<std::string> warnings;
  Log log;
};

Outcome read(const std::string& path, const LogMap& map = dfki_map(), double period_s = 0.01) {
  Outcome outcome;
  outcome.read = read_log(path, map, pendulum(), {0, 1}, outcome.log, outcome.error);
  if (outcome.read) outcome.good = check_log(outcome.log, map, pendulum(), period_s, outcome.warnings, outcome.error);
  return outcome;
}

TEST(Log, ReadsWhatIsRight) {
  const Outcome outcome = read(write_file("good.csv", swing(300)));
  ASSERT_TRUE(outcome.good) << outcome.error;
  EXPECT_TRUE(outcome.warnings.empty()) << outcome.warnings[0];
  ASSERT_EQ(outcome.log.rows(), 300u);
  EXPECT_NEAR(median_step_s(outcome.log), 0.01, 1e-9);
  EXPECT_NEAR(outcome.log.state[0][25], 0.5, 1e-6);  // a quarter of the swing's second
  EXPECT_NEAR(outcome.log.input[0][0], 0.1, 1e-6);
}

TEST(Log, ReadsItsOwnNamesWithoutAMap) {
  std::string text = swing(300);
  text = "time_s,angle_rad,rate_rad_s,torque_Nm" + text.substr(text.find('\n'));
  EXPECT_TRUE(read(write_file("own.csv", text), LogMap()).good);
}

TEST(Log, ReadsWindowsLineEndsBlanksAndQuotes) {
  std::string text = with_line(swing(300), 1, "\"time\", position,velocity ,torque\r\n");
  text = with_line(text, 5, "0.03, 0.094 ,3.08,0.09\r\n\r\n");
  const Outcome outcome = read(write_file("crlf.csv", text));
  ASSERT_TRUE(outcome.good) << outcome.error;
  EXPECT_NEAR(outcome.log.state[0][3], 0.094, 1e-9);
}

TEST(Log, ConvertsUnits) {
  LogMap map = dfki_map();
  map.units = {{"time", "ms"}, {"angle_rad", "deg"}, {"rate_rad_s", "deg/s"}};
  const Outcome outcome = read(write_file("units.csv", swing(300, 1e3, 57.29577951, 57.29577951)), map);
  ASSERT_TRUE(outcome.good) << outcome.error;
  EXPECT_NEAR(outcome.log.state[0][25], 0.5, 1e-5);
  EXPECT_NEAR(outcome.log.time_s[100], 1.0, 1e-9);
}

TEST(Log, MissingMeasurementIsNaN) {
  const Outcome outcome = read(write_file("missing.csv", with_line(swing(300), 12, "0.1,,2.5,0.1\n")));
  ASSERT_TRUE(outcome.good) << outcome.error;
  EXPECT_TRUE(std::isnan(outcome.log.state[0][10]));
}

// ---- as programs write them ----

TEST(Log, ReadsDialectsAndNotesThem) {
  const std::string good = swing(100);
  const auto with = [&](char separator, bool comma) {
    std::string text = good;
    for (char& c : text) c = c == ',' ? separator : c == '.' && comma ? ',' : c;
    return text;
  };
  std::string commented = good;
  commented.insert(0, "# a logger of ours\n# ");
  const struct {
    const char* name;
    std::string text;
    const char* note;
  } dialects[] = {{"plain", good, ""},
                  {"semicolons", with(';', false), "read with semicolons"},
                  {"decimal_commas", with(';', true), "read with semicolons, decimal commas"},
                  {"tabs", with('\t', false), "read with tabs"},
                  {"tabs_commas", with('\t', true), "read with tabs, decimal commas"},
                  {"mark", "\xEF\xBB\xBF" + good, "read with a byte order mark"},
                  {"numpy", commented, "read with a header behind '#'"},
                  {"comments", "# made by hand\n\n" + good, ""}};
  const Outcome plain = read(write_file("plain.csv", good));
  ASSERT_TRUE(plain.good) << plain.error;
  for (const auto& d : dialects) {
    const Outcome outcome = read(write_file(std::string("dialect_") + d.name + ".csv", d.text));
    ASSERT_TRUE(outcome.good) << d.name << ": " << outcome.error;
    EXPECT_EQ(outcome.log.note, d.note) << d.name;
    EXPECT_EQ(outcome.warnings.size(), *d.note == '\0' ? 0u : 1u) << d.name;
    EXPECT_EQ(outcome.log.time_s, plain.log.time_s) << d.name;
    EXPECT_EQ(outcome.log.state, plain.log.state) << d.name;
    EXPECT_EQ(outcome.log.input, plain.log.input) << d.name;
  }
}

TEST(Log, QuotedNamesMayHoldTheSeparator) {
  LogMap map = dfki_map();
  map.columns["angle_rad"] = "position, \"measured\"";
  std::string text = swing(100);
  text = "time,\"position, \"\"measured\"\"\",velocity,torque" + text.substr(text.find('\n'));
  const Outcome outcome = read(write_file("quoted.csv", text), map);
  ASSERT_TRUE(outcome.good) << outcome.error;
  EXPECT_NEAR(outcome.log.state[0][25], 0.5, 1e-6);
}

TEST(Log, WordsForMissingValuesAreMissing) {
  std::string text = with_line(swing(300), 12, "0.1,nan,NaN,0.1\n");
  text = with_line(text, 13, "0.11,null,N/A,0.1\n");
  const Outcome outcome = read(write_file("words.csv", text));
  ASSERT_TRUE(outcome.good) << outcome.error;
  for (const std::size_t row : {10u, 11u})
    for (const std::size_t state : {0u, 1u}) EXPECT_TRUE(std::isnan(outcome.log.state[state][row])) << row;
  EXPECT_EQ(outcome.log.note, "read with words as 'nan' for missing values");
}

tiller::Config pendulum_config(double period_s) {
  tiller::Config config;
  tiller_config_default(&config, &pendulum());
  config.period_s = period_s;
  config.measurement_count = 2;
  config.measured_state[0] = 0;
  config.measured_state[1] = 1;
  config.measurement_sd[0] = 0.001;
  config.measurement_sd[1] = 0.05;
  return config;
}

// ---- columns at other rates ----

// 100 Hz; the torque 0, 5, 10, ... has a value in every fifth row, from the third row on.
std::string slow_torque() {
  std::string text = "time_s,angle_rad,torque_Nm\n";
  for (int i = 0; i < 100; ++i)
    text += std::to_string(0.01 * i) + "," + std::to_string(0.5 * std::sin(0.1 * i)) + "," +
            (i % 5 == 2 ? std::to_string(i - 2) : "") + "\n";
  return text;
}

Log read_angle(const std::string& name, const std::string& text, const LogMap& map = LogMap()) {
  Log log;
  std::string error;
  EXPECT_TRUE(read_log(write_file(name, text), map, pendulum(), {0}, log, error)) << error;
  return log;
}

TEST(Rates, AnInputHoldsWhereItsCellIsEmpty) {
  const Log log = read_angle("slow.csv", slow_torque());
  ASSERT_EQ(log.rows(), 98u) << "nobody knows what acted before the first command";
  EXPECT_EQ(log.line[0], 4);
  for (std::size_t row = 0; row < log.rows(); ++row)
    EXPECT_EQ(log.input[0][row], static_cast<double>(row / 5 * 5)) << row;
  EXPECT_EQ(log.note,
            "column 'torque_Nm' has a value in 20 of 100 rows and holds in between; 2 rows before the first "
            "input are left out");
}

TEST(Rates, AMeasuredInputGoesOnInAStraightLine) {
  LogMap map;
  map.input = "mean";
  const Log log = read_angle("slow_mean.csv", slow_torque(), map);
  for (std::size_t row = 0; row < 96; ++row) EXPECT_NEAR(log.input[0][row], static_cast<double>(row), 1e-9) << row;
  EXPECT_EQ(log.input[0][97], 95.0) << "nothing comes after it";
}

// The supply is read every tenth row and falls from 12 V by 0.1 V a reading: the torque that acts falls with it, in a
// straight line between readings.
TEST(Schedule, AnInputActsInProportionToItsColumn) {
  const auto text = [](const char* first) {
    std::string rows = "time_s,angle_rad,torque_Nm,volts\n";
    for (int i = 0; i < 100; ++i)
      rows += std::to_string(0.01 * i) + "," + std::to_string(0.1 * i) + ",2," +
              (i % 10 != 5 ? ""
               : i == 5    ? first
                           : std::to_string(12 - 0.01 * (i - 5))) +
              "\n";
    return rows;
  };
  LogMap map;
  map.schedule["torque_Nm"] = {"volts", 12};
  const Log log = read_angle("supply.csv", text("12"), map);
  EXPECT_NEAR(log.input[0][0], 2, 1e-9) << "as at the first reading";
  for (int row = 5; row < 96; ++row)
    EXPECT_NEAR(log.input[0][static_cast<std::size_t>(row)], 2 * (12 - 0.01 * (row - 5)) / 12, 1e-9) << row;
  EXPECT_NEAR(log.input[0][99], 2 * (12 - 0.9) / 12, 1e-9) << "as at the last";
  EXPECT_NE(log.note.find("torque_Nm is taken 0.925 to 1 times, by column 'volts'"), std::string::npos) << log.note;

  const auto refused = [&](const std::string& rows) {
    Log none;
    std::string error;
    EXPECT_FALSE(read_log(write_file("supply_bad.csv", rows), map, pendulum(), {0}, none, error));
    return error;
  };
  EXPECT_NE(refused(text("-3")).find("column 'volts' reads -3"), std::string::npos);
  EXPECT_NE(refused(slow_torque()).find("no column 'volts'"), std::string::npos);
  EXPECT_NE(refused(text("inf")).find("'inf'"), std::string::npos);
}

TEST(Rates, RowsOfOneStampAreOneWhereTheyAgree) {
  std::string text = "time_s,angle_rad,torque_Nm\n";
  for (int i = 0; i < 40; ++i) {
    const std::string t = std::to_string(0.01 * i), angle = std::to_string(0.1 * i), torque = std::to_string(i);
    text += t + "," + angle + ",\n" + t + ",," + torque + "\n";      // a logger with a row for each channel
    if (i % 10 == 0) text += t + "," + angle + "," + torque + "\n";  // and a message that came twice
  }
  const Log log = read_angle("long.csv", text);
  ASSERT_EQ(log.rows(), 40u);
  EXPECT_NEAR(log.state[0][39], 3.9, 1e-9);
  EXPECT_EQ(log.input[0][39], 39.0);
  EXPECT_EQ(log.note, "4 identical rows count once");
}

// Two sensors of 100 Hz, 2 ms apart, for a robot of 50 Hz: no sample is lost to the other's rows, grids go through
// both.
TEST(Rates, SensorsWithRowsOfTheirOwnAreBothUsed) {
  std::string text = "time_s,angle_rad,rate_rad_s,torque_Nm\n";
  const auto number = [](double v) { return std::to_string(v); };
  for (int i = 0; i < 200; ++i) {
    const double t = 0.01 * i, later = t + 0.002;
    text += number(t) + "," + number(0.1 * t) + ",," + number(i % 7) + "\n" + number(later) + ",," +
            number(0.3 * later) + ",\n";
  }
  Log log;
  std::string error;
  ASSERT_TRUE(read_log(write_file("two.csv", text), LogMap(), pendulum(), {0, 1}, log, error)) << error;
  EXPECT_NEAR(median_step_s(log), 0.01, 1e-9);
  EXPECT_EQ(split_at_gaps(log).size(), 1u);
  const tiller::Config config = pendulum_config(0.02);
  const std::vector<Stretch> stretches = make_stretches(log, LogMap(), config);
  ASSERT_EQ(stretches.size(), 1u);
  int angles = 0, rates = 0;
  double length = 0;
  for (const Transition& step : stretches[0].steps) {
    angles += std::isfinite(step.measured[0]) ? 1 : 0;
    rates += std::isfinite(step.measured[1]) ? 1 : 0;
    length += step.period_s;
  }
  EXPECT_NEAR(angles, 99, 1);  // 2 s at 50 Hz of each
  EXPECT_NEAR(rates, 100, 1);
  EXPECT_NEAR(length, log.time_s.back(), 0.011);
  const std::vector<Grid> grids = make_grids(log, LogMap(), config);
  ASSERT_EQ(grids.size(), 1u);
  for (std::size_t p = 1; p + 1 < grids[0].points(); ++p) {
    EXPECT_NEAR(grids[0].state[0][p], 0.1 * 0.02 * static_cast<double>(p), 1e-6);
    EXPECT_NEAR(grids[0].state[1][p], 0.3 * 0.02 * static_cast<double>(p), 1e-6);
  }
}

TEST(Rates, AnAngleGoesTheShortWayBetweenSamples) {
  std::string text = "time_s,angle_rad,torque_Nm\n";
  for (int i = 0; i < 100; ++i)
    text += std::to_string(0.01 * i) + "," + std::to_string(std::remainder(3.0 + 0.1 * i, 6.283185307179586)) + "," +
            std::to_string(i % 3) + "\n";
  const Log log = read_angle("wrap.csv", text);
  const tiller::Config config = pendulum_config(0.015);
  for (const Grid& grid : make_grids(log, LogMap(), config))
    for (std::size_t p = 0; p < grid.points(); ++p)
      EXPECT_NEAR(std::remainder(grid.state[0][p] - 3.0 - 10 * 0.015 * static_cast<double>(p), 6.283185307179586), 0,
                  1e-5);
}

TEST(Rates, ALongLogTakesTheMemoryOfItsColumns) {
  std::string text = "time_s,angle_rad,torque_Nm\n";
  for (int i = 0; i < 1000; ++i) text += std::to_string(0.001 * i) + ",0." + std::to_string(i) + ",1\n";
  const Log log = read_angle("columns.csv", text);
  EXPECT_LE(log.time_s.capacity(), 2 * log.rows());
  EXPECT_LE(log.state[0].capacity(), 2 * log.rows());
  EXPECT_EQ(log.state[1].capacity(), 0u);
  EXPECT_TRUE(log.input_time_s.empty());
}

struct Bad {
  const char* name;
  std::string text;
  std::vector<std::string> said;  // each must stand in the message
};

std::vector<Bad> bad_logs() {
  const std::string good = swing(300);
  std::string no_torque = "time,position,velocity,torque\n";
  for (int i = 0; i < 30; ++i) no_torque += std::to_string(0.01 * i) + ",0.1,3,\n";
  return {
      {"empty", "", {"empty", "header"}},
      {"only_header", "time,position,velocity,torque\n", {"0 rows are too few"}},
      {"short", swing(5), {"5 rows are too few"}},
      {"sixteen_bits", std::string("\xFF\xFEt\0i\0", 6), {"UTF-16", "save it as UTF-8"}},
      {"no_column",
       with_line(good, 1, "time,pos,velocity,torque\n"),
       {":1:", "'position'", "angle_rad", "time, pos, velocity, torque", "[log] columns"}},
      {"typing_error", with_line(good, 1, "time,positon,velocity,torque\n"), {"did you mean 'positon'"}},
      {"twice", with_line(good, 1, "time,position,position,torque\n"), {":1:", "'position' appears twice"}},
      {"infinite", with_line(good, 10, "0.08,-inf,3,0.1\n"), {":10:", "'position' is '-inf'", "leave the cell"}},
      {"infinite_input", with_line(good, 11, "0.09,0.1,3,inf\n"), {":11:", "'torque' is 'inf'", "leave the cell"}},
      {"no_stamp", with_line(good, 11, ",0.1,3,0.1\n"), {":11:", "'time' is empty", "delete the row"}},
      {"no_input", no_torque, {"'torque': every cell is empty"}},
      {"thousands", with_line(good, 7, "0.05,\"1.234,5\",3,0.1\n"), {":7:", "'1.234,5' is not a number"}},
      {"words", with_line(good, 7, "0.05,left,3,0.1\n"), {":7:", "'left' is not a number"}},
      {"ragged", with_line(good, 20, "0.18,0.1,3\n"), {":20:", "3 values where the header names 4"}},
      {"cut_off", good + "3.0,0.1", {":302:", "cut off"}},
      {"repeated_stamp", with_line(good, 50, "0.47,0.1,3,0.1\n"), {":50:", "repeats that of line 49", "other values"}},
      {"backwards", with_line(good, 50, "0.2,0.1,3,0.1\n"), {":50:", "time goes backwards by", "two files"}},
      {"milliseconds", swing(300, 1e3), {"'time'", "a row every 10 s", "ms"}},
      {"degrees", swing(300, 1, 57.29577951, 1), {"'velocity' is", "the position is in degrees", "[log] units"}},
      {"rate_in_degrees", swing(300, 1, 1, 57.29577951), {"the rate is in deg/s"}},
      {"rpm", swing(300, 1, 1, 9.549297), {"the rate is in rpm"}},
      {"reversed_rate", swing(300, 1, 1, -1), {"sign reversed"}},
      {"stuck", swing(300, 1, 0, 0), {"'position' is 0 in every row", "stuck sensor"}},
  };
}

TEST(Log, SaysWhatIsWrongWithEveryBadOne) {
  for (const Bad& bad : bad_logs()) {
    const std::string path = write_file(std::string("bad_") + bad.name + ".csv", bad.text);
    const Outcome outcome = read(path);
    EXPECT_FALSE(outcome.good) << bad.name;
    EXPECT_NE(outcome.error.find(path), std::string::npos) << bad.name << ": " << outcome.error;
    for (const std::string& word : bad.said)
      EXPECT_NE(outcome.error.find(word), std::string::npos)
          << bad.name << " lacks '" << word << "': " << outcome.error;
    std::printf("%s\n", outcome.error.c_str());
  }
}

TEST(Log, MissingFileAndFolder) {
  EXPECT_NE(read("/nonexistent/run.csv").error.find("No such file"), std::string::npos);
  EXPECT_NE(read(testing::TempDir()).error.find("folder"), std::string::npos);
}

TEST(Log, AThousandErrorsAreNotAThousandLines) {
  std::string text = "time,position,velocity,torque\n";
  for (int i = 0; i < 1000; ++i) text += "x,x,x,x\n";
  const Outcome outcome = read(write_file("thousand.csv", text));
  EXPECT_LT(std::count(outcome.error.begin(), outcome.error.end(), '\n'), 12);
  EXPECT_NE(outcome.error.find("and 3992 more"), std::string::npos) << outcome.error;
}

TEST(Log, GapsSplitAndManyTurnsWarn) {
  std::string text = "time_s,angle_rad,torque_Nm\n";
  for (int i = 0; i < 200; ++i)
    text += std::to_string(0.01 * i + (i >= 80 ? 3.0 : 0.0)) + "," + std::to_string(0.5 * i) + "," +
            std::to_string(i % 7) + "\n";
  Log log;
  std::string error;
  std::vector<std::string> warnings;
  ASSERT_TRUE(read_log(write_file("gap.csv", text), LogMap(), pendulum(), {0}, log, error)) << error;
  ASSERT_TRUE(check_log(log, LogMap(), pendulum(), 0.01, warnings, error)) << error;
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_NE(warnings[0].find("deg"), std::string::npos) << warnings[0];
  EXPECT_NE(warnings[1].find("1 gap"), std::string::npos) << warnings[1];
  const std::vector<Segment> segments = split_at_gaps(log);
  ASSERT_EQ(segments.size(), 2u);
  EXPECT_EQ(segments[0].last, 80u);
}

// ---- from rows to transitions ----

TEST(Stretch, MergesRowsAndKeepsTheInputsArea) {
  const Outcome outcome = read(write_file("merge.csv", swing(301)));
  const tiller::Config config = pendulum_config(0.04);
  for (const char* input : {"hold", "mean"}) {
    LogMap map = dfki_map();
    map.input = input;
    const std::vector<Stretch> stretches = make_stretches(outcome.log, map, config);
    ASSERT_EQ(stretches.size(), 1u);
    ASSERT_EQ(stretches[0].steps.size(), 75u);
    double area = 0, length = 0;
    for (const Transition& step : stretches[0].steps) {
      area += step.period_s * step.input[0];
      length += step.period_s;
    }
    EXPECT_NEAR(length, 3.0, 1e-9);
    // 0.1 cos 3t over 3 s is 0.1 sin(9) / 3 = 0.013737; the trapezoid misses it by h^2/12 times the change of the
    // slope, 3e-6; holding the left value by half a step of the change, 1e-3
    EXPECT_NEAR(area, 0.1 * std::sin(9.0) / 3, map.input == "mean" ? 3e-6 : 1.2e-3);
    EXPECT_NEAR(stretches[0].steps[0].measured[0], outcome.log.state[0][4], 0);
  }
}

TEST(Stretch, KeepsStepsOfACoarserLog) {
  const Outcome outcome = read(write_file("coarse.csv", swing(300)));
  const std::vector<Stretch> stretches = make_stretches(outcome.log, dfki_map(), pendulum_config(0.002));
  ASSERT_EQ(stretches[0].steps.size(), 299u);
  EXPECT_NEAR(stretches[0].steps[7].period_s, 0.01, 1e-9);
}

TEST(Grid, StartStateComesFromTheLogAlone) {
  const Outcome outcome = read(write_file("grid.csv", swing(300)));
  const tiller::Config config = pendulum_config(0.01);
  const std::vector<Grid> grids = make_grids(outcome.log, dfki_map(), config);
  ASSERT_EQ(grids.size(), 1u);
  double state[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
  EXPECT_FALSE(estimate_state(grids[0], config, 0, 0.03, state, sd)) << "nothing before the first point";
  ASSERT_TRUE(estimate_state(grids[0], config, 110, 0.03, state, sd));
  const double w = 6.283185307179586;
  // a parabola over +-30 ms of a swing at 1 Hz: its cubic rest is below w^3 0.5 h^3 / 6 = 6e-4 rad and, for the
  // slope, below w^3 0.5 h^2 / 6 = 0.02 rad/s
  EXPECT_NEAR(state[0], 0.5 * std::sin(w * 1.1), 6e-4);
  EXPECT_NEAR(state[1], 0.5 * w * std::cos(w * 1.1), 0.02);
}

// Least squares on seven even points at spacing h, angle alone: slope sd = s / (h sqrt(28)), middle of the parabola
// s sqrt(1/7 + (sum t^2)^2 / 7^2 / (sum t^4 - (sum t^2)^2 / 7)) = s sqrt(1/7 + 16/84).
TEST(Grid, DoubtOfTheStartStateIsThatOfLeastSquares) {
  const Outcome outcome = read(write_file("doubt.csv", swing(300)));
  tiller::Config config = pendulum_config(0.01);
  config.measurement_count = 1;
  config.measured_state[0] = 0;
  config.measurement_sd[0] = 0.002;
  const std::vector<Grid> grids = make_grids(outcome.log, dfki_map(), config);
  double state[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
  ASSERT_TRUE(estimate_state(grids[0], config, 110, 0.03, state, sd));
  EXPECT_NEAR(sd[0], 0.002 * std::sqrt(1.0 / 7 + 16.0 / 84), 1e-8);
  EXPECT_NEAR(sd[1], 0.002 / (0.01 * std::sqrt(28.0)), 1e-8);
}

}  // namespace
}  // namespace tiller::tools
