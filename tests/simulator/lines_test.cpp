// The lines between tiller and a simulator: what is written, and what is refused.

#include "tools/simulator/simulator_lines.hpp"

#include <gtest/gtest.h>

namespace tiller::tools {
namespace {

SimulationRequest request() { return {{0.5, 2.0}, {1.0}, {3.0, 4.0}, 17, 2}; }

bool read(const std::string& line, SimulationAnswer& answer, std::string& error) {
  return read_answer(line, 7, request(), 1, answer, error);
}

TEST(SimulatorLines, AreWrittenAsTheGuideSays) {
  EXPECT_EQ(hello_line({{"friction"}, {"force_N"}, {"position_m"}, 0.02}),
            "{\"tiller_simulator\":1,\"parameters\":[\"friction\"],\"inputs\":[\"force_N\"],"
            "\"measurements\":[\"position_m\"],\"period_s\":0.02}\n");
  EXPECT_EQ(request_line(7, request()),
            "{\"id\":7,\"seed\":17,\"parameters\":[0.5,2.0],\"start\":[1.0],\"inputs\":[[3.0],[4.0]]}\n");
}

TEST(SimulatorLines, WithoutInputsHaveAnEmptyRowForEachPeriod) {
  SimulationRequest free = request();
  free.inputs.clear();
  EXPECT_NE(request_line(1, free).find("\"inputs\":[[],[]]"), std::string::npos);
}

TEST(SimulatorLines, ReadAnAnswer) {
  SimulationAnswer answer;
  std::string error;
  ASSERT_TRUE(read("{\"id\": 7, \"measured\": [[0.25], [1e-3]]}", answer, error)) << error;
  EXPECT_EQ(answer.measured, (std::vector<double>{0.25, 1e-3}));
  EXPECT_EQ(answer.failure, "");
}

TEST(SimulatorLines, TakeAnErrorAndWhatIsNotFiniteAsFailures) {
  SimulationAnswer answer;
  std::string error;
  ASSERT_TRUE(read("{\"id\": 7, \"error\": \"the mesh is torn\"}", answer, error));
  EXPECT_EQ(answer.failure, "the mesh is torn");
  for (const char* value : {"NaN", "null", "-Infinity"}) {
    ASSERT_TRUE(read(std::string("{\"id\": 7, \"measured\": [[0.0], [") + value + "]]}", answer, error)) << value;
    EXPECT_EQ(answer.failure, "not finite from period 2 on");
    EXPECT_TRUE(answer.measured.empty());
  }
}

TEST(SimulatorLines, RefuseWhatIsNoAnswer) {
  SimulationAnswer answer;
  const struct {
    const char *line, *told;
  } cases[] = {{"loading the world ...", "is no JSON object"},
               {"[1, 2]", "is no JSON object"},
               {"{\"id\": 8, \"measured\": [[0], [0]]}", "\"id\" is not 7"},
               {"{\"id\": 7}", "neither \"measured\" nor \"error\""},
               {"{\"id\": 7, \"measured\": [[0]]}", "has 1 rows, and 2 inputs were sent"},
               {"{\"id\": 7, \"measured\": 3}", "has 0 rows"},
               {"{\"id\": 7, \"measured\": [[0, 1], [0, 1]]}", "row 1 of \"measured\" is no list of 1 numbers"},
               {"{\"id\": 7, \"measured\": [[0], [\"a\"]]}", "row 2 of \"measured\" is no list of 1 numbers"}};
  for (const auto& c : cases) {
    std::string error;
    EXPECT_FALSE(read(c.line, answer, error)) << c.line;
    EXPECT_NE(error.find(c.told), std::string::npos) << error;
  }
}

TEST(SimulatorLines, RefuseAnotherVersion) {
  std::string error;
  EXPECT_TRUE(check_hello("{\"tiller_simulator\": 1, \"name\": \"mine\"}", error));
  EXPECT_FALSE(check_hello("{\"tiller_simulator\": 2}", error));
  EXPECT_NE(error.find("is not {\"tiller_simulator\": 1}"), std::string::npos);
  EXPECT_FALSE(check_hello("{}", error));
}

TEST(SimulatorLines, AreShownCutAndWithoutControls) {
  EXPECT_EQ(shown_line("a\x1b[31mb"), "'a?[31mb'");
  EXPECT_EQ(shown_line(std::string(500, 'x')).size(), 165u);
}

}  // namespace
}  // namespace tiller::tools
