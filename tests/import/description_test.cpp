// What an import refuses, and what it says; the frames and equations behind it on small cases.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>

#include "tools/import/expression.hpp"
#include "tools/import/model_writer.hpp"
#include "tools/import/robot_writer.hpp"

namespace tiller::tools {
namespace {

std::string path_of(const std::string& text) {
  const std::string path = ::testing::TempDir() + "description_test.urdf";
  std::ofstream(path) << text;
  return path;
}

/// Line 1 is <robot>, a link `base` at line 2, a joint `turn` at lines 3 to 7, and a link `arm` at 8 and 9.
std::string robot(const std::string& joint = "", const std::string& inertial = "", const std::string& more = "") {
  return "<robot name=\"r\">\n<link name=\"base\"/>\n"
         "<joint name=\"turn\" type=\"revolute\">\n<parent link=\"base\"/>\n<child link=\"arm\"/>\n<axis xyz=\"0 0 1\"/>\n" +
         (joint.empty() ? std::string("<limit lower=\"-1\" upper=\"1\" effort=\"3\" velocity=\"2\"/>") : joint) +
         "</joint>\n<link name=\"arm\">\n" +
         (inertial.empty() ? std::string("<inertial><origin xyz=\"0.1 0 0\"/><mass value=\"1\"/>"
                                         "<inertia ixx=\"0.01\" iyy=\"0.01\" izz=\"0.01\"/></inertial>")
                           : inertial) +
         "\n</link>\n" + more + "</robot>\n";
}

std::string imported(const std::string& text, Mechanism& mechanism, const MechanismOptions& options = {}) {
  Description description;
  std::vector<std::string> errors;
  if (read_urdf(path_of(text), description, errors)) (void)build_mechanism(description, options, mechanism, errors);
  std::string all;
  for (const std::string& error : errors) all += error + "\n";
  return all;
}
std::string refusal(const std::string& text, const MechanismOptions& options = {}) {
  Mechanism mechanism;
  return imported(text, mechanism, options);
}

TEST(Description, AGoodOneIsTaken) { EXPECT_EQ(refusal(robot()), ""); }

TEST(Description, MistakesAreToldByLineAndWithARemedy) {
  const struct {
    std::string text;
    const char* line;  // as in "file:LINE:"
    const char* says;
  } cases[] = {
      {"", "", "is empty"},
      {"<robot name=\"r\">\n<link name=\"base\">\n</robot>", ":2:", "no XML"},
      {"<mujoco/>", ":1:", "an MJCF"},
      {"<robot xmlns:xacro=\"x\">\n<xacro:include filename=\"a\"/>\n</robot>", ":2:", "run `xacro "},
      {robot("<limit lower=\"1\" upper=\"-1\"/>"), ":7:", "lower above upper"},
      {robot("<limit lower=\"one\"/>"), ":7:", "lower=\"one\" is no finite number"},
      {robot("<limit lower=\"nan\"/>"), ":7:", "no finite number"},
      {robot("<limit lower=\"1 2\"/>"), ":7:", "no finite number"},
      {robot("<dynamics damping=\"-1\"/>"), ":7:", "negative"},
      {robot("<mimic joint=\"turm\"/>"), ":3:", "mimics 'turm'"},
      {robot("<mimic joint=\"turn\"/>"), ":3:", "mimics itself"},
      {robot("", "<inertial><mass value=\"1\"/></inertial>"), ":9:", "lacks <inertia"},
      {robot("", "<inertial><mass value=\"-1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial>"),
       ":9:", "negative mass"},
      {robot("", "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"-1\"/></inertial>"),
       ":9:", "--any-inertia"},
      {robot("", "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"5\"/></inertial>"),
       ":9:", "--any-inertia"},
      {robot("", "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\"/></inertial>"), ":9:", "lacks izz"},
      {robot("", "<visual/>"), ":3:", "moves nothing that has inertia about its axis: link 'arm' at line 8"},
      {robot("", "", "<link name=\"arm\"/>\n"), ":11:", "a second link 'arm'"},
      {robot("", "", "<link name=\"lost\"/>\n"), "", "2 links hang on nothing (base, lost)"},
      {robot("", "", "<joint name=\"w\" type=\"welded\"/>\n"), ":11:", "none of fixed, revolute"},
      {robot("", "", "<joint name=\"w\" type=\"fixed\"><parent link=\"amr\"/><child link=\"arm\"/></joint>\n"),
       ":11:", "is 'arm' meant?"},
      {robot("", "", "<joint name=\"back\" type=\"fixed\"><parent link=\"base\"/><child link=\"arm\"/></joint>\n"),
       ":11:", "hangs on two joints"},
      {robot("", "", "<joint name=\"back\" type=\"fixed\"><parent link=\"arm\"/><child link=\"base\"/></joint>\n"), "",
       "go in a circle"},
      {"<robot name=\"r\">\n<link name=\"w\"/><link name=\"b\"/>\n<joint name=\"f\" type=\"floating\"><parent link=\"w\"/>"
       "<child link=\"b\"/></joint></robot>",
       ":3:", "--base free"},
  };
  for (const auto& c : cases) {
    const std::string said = refusal(c.text);
    EXPECT_NE(said.find(c.says), std::string::npos) << c.says << "\n" << said;
    EXPECT_NE(said.find(c.line), std::string::npos) << c.line << "\n" << said;
  }
  EXPECT_NE(refusal(robot("", "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"5\"/></inertial>")), "");
  MechanismOptions any;
  any.any_inertia = true;
  EXPECT_EQ(refusal(robot("", "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"5\"/></inertial>"), any),
            "");
  MechanismOptions held;
  held.held = {{"tunr", 0.0}};
  EXPECT_NE(refusal(robot(), held).find("is 'turn' meant?"), std::string::npos);
}

// What hangs on a joint that is refused is connected all the same; and only what carries the whole robot is a base.
TEST(Description, AFloatingJointInsideIsOneSentence) {
  const std::string ball =
      "<joint name=\"loose\" type=\"floating\"><parent link=\"arm\"/><child link=\"ball\"/></joint>\n"
      "<link name=\"ball\"/>\n<joint name=\"on\" type=\"fixed\"><parent link=\"ball\"/><child link=\"tip\"/></joint>\n"
      "<link name=\"tip\"/>\n";
  const std::string remedy =
      ", which only the joint that carries the whole robot may be; write it as prismatic and revolute joints, or hold it: "
      "--hold loose\n";
  EXPECT_EQ(refusal(robot("", "", ball)),
            ::testing::TempDir() + "description_test.urdf:11: joint 'loose' is floating" + remedy);
  std::string beside = ball;
  beside.replace(beside.find("\"arm\""), 5, "\"base\"");
  EXPECT_EQ(refusal(robot("", "", beside)),
            ::testing::TempDir() + "description_test.urdf:11: joint 'loose' is floating" + remedy)
      << "a free base would carry the arm too";
  MechanismOptions held;
  held.held = {{"loose", 0.0}};
  EXPECT_EQ(refusal(robot("", "", ball), held), "");
}

// Joints by a pattern, and joints of a base that moves.
TEST(Description, JointsAreHeldByPatternsAndByTheBase) {
  Description description;
  std::vector<std::string> errors;
  std::string more;
  for (const char* leg : {"FL", "FR", "RL", "RR"}) {
    std::string above = "base";
    for (const char* joint : {"hip", "thigh", "calf"}) {
      const std::string name = std::string(leg) + "_" + joint;
      more += "<joint name=\"" + name + "_joint\" type=\"continuous\"><parent link=\"" + above + "\"/><child link=\"" +
              name + "\"/><axis xyz=\"0 1 0\"/></joint><link name=\"" + name +
              "\"><inertial><mass value=\"1\"/><inertia ixx=\"0.01\" iyy=\"0.01\" izz=\"0.01\"/></inertial></link>\n";
      above = name;
    }
  }
  ASSERT_TRUE(read_urdf(path_of(robot("", "", more)), description, errors));
  const auto joints_with = [&](const MechanismOptions& given) {
    MechanismOptions options = given;
    Mechanism mechanism;
    errors.clear();
    (void)(expand_held(description, options, errors) && build_mechanism(description, options, mechanism, errors));
    EXPECT_TRUE(errors.empty()) << errors[0];
    return name_model(mechanism).joints;
  };
  MechanismOptions options;
  options.base = BaseKind::free;
  EXPECT_EQ(joints_with(options).size(), 19u);
  options.held = {{"base_y", 0.0}, {"base_yaw", 0.5}, {"base_roll", 0.0}, {"*_hip_joint", 0.1}, {"turn", 0.0}};
  const std::vector<std::string> left = joints_with(options);
  EXPECT_EQ(left.size(), 11u);
  EXPECT_EQ((std::vector<std::string>{left.begin(), left.begin() + 3}),
            (std::vector<std::string>{"base_x", "base_z", "base_pitch"}));
  options.held = {{"*_knee", 0.0}};
  EXPECT_FALSE(expand_held(description, options, errors));
  EXPECT_NE(errors[0].find("--hold *_knee: "), std::string::npos);
  EXPECT_NE(errors[0].find("FL_hip_joint"), std::string::npos);

  EXPECT_EQ(pattern_of({"FL_hip_joint", "FR_hip_joint", "FL_calf_joint", "FR_calf_joint", "waist"}, 2),
            "'*_hip_joint' (2 joints)");
  EXPECT_EQ(pattern_of({"FL_hip", "FL_calf", "FR_hip", "FR_calf", "RL_hip", "RL_calf"}, 2), "'*_hip' (3 joints)")
      << "not the two of a leg";
  EXPECT_EQ(pattern_of({"a", "b_c", "d"}, 1), "") << "no pattern tells two and leaves one";
}

// Rotor inertia from the command line, and a note where it is missing: 3 Nm on 1e-4 kgm2 are 30,000 rad/s2.
TEST(Description, AJointWithoutARotorIsTold) {
  const std::string light =
      robot("", "<inertial><mass value=\"0.01\"/><inertia ixx=\"1e-4\" iyy=\"1e-4\" izz=\"1e-4\"/></inertial>");
  Mechanism mechanism;
  ASSERT_EQ(imported(light, mechanism), "");
  ASSERT_EQ(mechanism.notes.size(), 1u);
  EXPECT_NE(mechanism.notes[0].find("30000 rad/s2"), std::string::npos) << mechanism.notes[0];
  EXPECT_NE(mechanism.notes[0].find("--armature turn=KGM2"), std::string::npos) << mechanism.notes[0];
  MechanismOptions options;
  options.armature = {{"*", 0.0099}};
  ASSERT_EQ(imported(light, mechanism, options), "");
  EXPECT_TRUE(mechanism.notes.empty());
  EXPECT_NEAR(mobility(mechanism, {0.3})[0], 100.0, 1e-9);
  options.armature = {{"tunr", 0.1}};
  EXPECT_NE(imported(light, mechanism, options).find("is 'turn' meant?"), std::string::npos);
}

// A robot file takes no bound of 1e16, and what turns for ever is told apart from what has two ends.
TEST(Description, EndsOf1e16AreNone) {
  Mechanism mechanism;
  ASSERT_EQ(imported(robot("<limit lower=\"-1e+16\" upper=\"1e+16\" effort=\"1e9\" velocity=\"1e16\"/>"), mechanism),
            "");
  ASSERT_EQ(mechanism.bodies.size(), 1u);
  const MovingBody& turns = mechanism.bodies[0];
  EXPECT_EQ(turns.low, -INFINITY);
  EXPECT_EQ(turns.high, INFINITY);
  EXPECT_EQ(turns.effort, INFINITY);
  EXPECT_EQ(turns.speed, INFINITY);
  EXPECT_TRUE(turns.wraps);
  ASSERT_EQ(imported(robot("<limit lower=\"-1\" upper=\"1e+16\" effort=\"3\" velocity=\"2\"/>"), mechanism), "");
  EXPECT_EQ(mechanism.bodies[0].low, -1.0);
  EXPECT_EQ(mechanism.bodies[0].high, INFINITY);
  EXPECT_FALSE(mechanism.bodies[0].wraps);
}

TEST(Description, AMissingFileIsTold) {
  Description description;
  std::vector<std::string> errors;
  EXPECT_FALSE(read_urdf("/no/such/file.urdf", description, errors));
  ASSERT_EQ(errors.size(), 1u);
  EXPECT_NE(errors[0].find("/no/such/file.urdf"), std::string::npos);
}

// A pendulum by hand: q'' = (tau - m g l sin q ...) about a horizontal axis; here gravity along -z, the axis along y.
TEST(Equations, OfAPendulumAreOneFraction) {
  Mechanism mechanism;
  const std::string text = robot("<axis xyz=\"0 1 0\"/><dynamics armature=\"0.5\"/>");
  std::string turned = text;
  turned.erase(turned.find("<axis xyz=\"0 0 1\"/>"), 19);
  ASSERT_EQ(imported(turned, mechanism), "");
  const WrittenModel model = write_model(mechanism, {}, -1, {});
  EXPECT_LT(model.operations, 20) << model.text;
  EXPECT_EQ(model.response_operations, 0) << "one over a constant\n" << model.text;
}

TEST(Equations, ABaseThatMovesHasJointsOfItsOwn) {
  Mechanism mechanism;
  MechanismOptions options;
  options.base = BaseKind::planar;
  ASSERT_EQ(imported("<robot name=\"r\"><link name=\"b\"><inertial><mass value=\"2\"/>"
                     "<inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial></link></robot>",
                     mechanism, options),
            "");
  const ModelNames names = name_model(mechanism);
  EXPECT_EQ(names.positions, (std::vector<std::string>{"base_x_m", "base_y_m", "base_yaw_rad"}));
  EXPECT_TRUE(names.inputs.empty()) << "nothing drives them";
}

TEST(Expression, KnowsWhatIsNothing) {
  ExpressionGraph graph;
  const Expression x = graph.symbol("x"), y = graph.symbol("y");
  EXPECT_TRUE((x * 0.0).is(0.0));
  EXPECT_TRUE((x - x).is(0.0));
  EXPECT_TRUE((Expression(2.0) * Expression(3.0)).is(6.0));
  EXPECT_EQ((x * 1.0).node(), x.node());
  EXPECT_EQ((-(-x)).node(), x.node());
  EXPECT_EQ((x * y).node(), (y * x).node()) << "either order";
  EXPECT_EQ((x - -y).node(), (x + y).node());
  EXPECT_EQ(cos(-x).node(), cos(x).node());
  EXPECT_EQ((sin(-x) + sin(x)).constant(), 0.0);
}

TEST(Expression, CodeComputesWhatIsSharedOnce) {
  ExpressionGraph graph;
  const Expression x = graph.symbol("x"), y = graph.symbol("y");
  const Expression shared = x * y + 1.0, sine = sin(x), cosine = cos(x);
  std::vector<std::string> values;
  int operations = 0;
  const std::string code = emit_code(graph, {shared / x, y - (shared - x), sine * cosine}, "", values, &operations);
  EXPECT_EQ(code, "const S t1 = x * y + S(1.0);\nS s2, c2;\nsincos(x, s2, c2);\n");
  EXPECT_EQ(values, (std::vector<std::string>{"t1 / x", "y - (t1 - x)", "s2 * c2"}));
  EXPECT_EQ(operations, 8);
}

TEST(Unknowns, WordsThatNameNothingAreTold) {
  Mechanism mechanism;
  ASSERT_EQ(imported(robot(), mechanism), "");
  const auto said = [&](const std::string& word) {
    Unknowns unknowns;
    std::vector<std::string> errors;
    return read_unknowns({word}, mechanism, unknowns, errors) ? "" : errors[0];
  };
  EXPECT_EQ(said("payload"), "");
  EXPECT_EQ(said("mass:arm"), "");
  EXPECT_NE(said("mass:amr").find("is 'arm' meant?"), std::string::npos);
  EXPECT_NE(said("mass:base").find("no link that moves"), std::string::npos);
  EXPECT_NE(said("frction:turn").find("is 'friction' meant?"), std::string::npos);
  EXPECT_NE(said("friction").find("friction:*"), std::string::npos);
  EXPECT_NE(said("payload=heavy").find("no mass"), std::string::npos);
  EXPECT_NE(said("payload=-1").find("no mass"), std::string::npos);
}

}  // namespace
}  // namespace tiller::tools
