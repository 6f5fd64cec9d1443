#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/base/file_errors.hpp"
#include "tools/base/text.hpp"
#include "tools/robot/figure.hpp"
#include "tools/robot/log_map.hpp"
#include "tools/robot/model_loader.hpp"
#include "tools/robot/substep_advice.hpp"

namespace tiller::tools {

/// [transport] motors: what an input's drive speaks and needs to be told; docs/guide/actuators.md.
struct DriveSection {
  std::string actuator = "odrive", command = "torque", resolution = "f32", reply = "plain";
  double watchdog_s = 0.1;
  double position_rad = 12.5, velocity_rad_s = 50, torque_Nm = 18, kp_max = 500, kd_max = 5;  ///< mit: ranges
  double kp_Nm_rad = 0, kd_Nms_rad = 0;                                                       ///< mit: gains
  std::uint32_t reply_id = 0;
};

/// [transport] of the kind ros2: topics, and where each measurement comes from; docs/guide/ros2.md.
struct Ros2Section {
  std::string joint_states = "joint_states", imu = "imu", odometry = "odom";
  std::string commands;  ///< empty: <robot's name>/commands
  Words sources;         ///< (ny) "position:elbow", "imu:angular_velocity.z", ...; empty: what the names say
  std::string goal_pose = "goal_pose";
  std::string goal_trajectory;                     ///< empty: <robot's name>/joint_trajectory
  std::map<std::string, std::string> goal_fields;  ///< of a PoseStamped, by state or output: "position.x", "yaw"
};

/// [transport]: how the robot is reached. `line` is 0 where the file has no such section.
struct TransportSection {
  int line = 0;
  std::string kind;  ///< a name of transports.def; empty: not given
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  std::string channel_prefix = "TILLER_";
  std::string key_file;  ///< path; empty: messages are not signed
  double replay_window_s = 2;
  bool liblcm = false;
  std::string interface = "can0";
  bool stamp_on_arrival = false;       ///< the plant has a clock of its own
  std::vector<std::uint32_t> nodes;    ///< (nu) node of each input's motor
  std::vector<double> wheel_radius_m;  ///< (nu)
  std::vector<DriveSection> drives;    ///< (nu)
  std::uint32_t sensor_node = 48;
  Words channels;  ///< (ny) "board:0", "position:force_N", ...; empty: the board's, in order
  double heartbeat_timeout_s = 0.5;
  Ros2Section ros2;
};

/// [realtime]: what a run by the wall clock asks of Linux. `line` is 0 where the file has no such section.
struct RealtimeSection {
  int line = 0;
  bool by_clock = false;  ///< ticks at absolute times, else after each measurement
  int priority = 80;
  bool lock_memory = true;
  std::uint64_t cpus = 0;  ///< bit i: processor i; 0: any
  std::uint32_t stack_kB = 1024;
};

struct SimEffect {
  std::string kind;
  std::string port;
  std::map<std::string, double> parameters;
};

/// [sim]: the simulated plant. `line` is 0 where the file has no such section.
struct SimSection {
  int line = 0;
  std::string plant;
  std::string file, frame;  ///< of the plant "urdf": the description (absolute), and the link that carries a payload
  std::map<std::string, double> hold, armature;
  bool draw = false;  ///< true parameters and effects from the priors
  std::map<std::string, double> parameters, state, sensor_sd, sensor_step;
  std::vector<SimEffect> effects;
  double process_noise_sd = 0;
  std::uint64_t noise_seed = 0;  ///< of the noise alone, for runs of one plant after another; 0: `seed`
  double measurement_latency_s = 0;
  double command_latency_s = 0;
  double watchdog_s = 0.1;
  double plan_timeout_s = 1.0;  ///< of the device: 0: plans are not watched
  double step_s = 0.0005;
  bool rates = false;
  std::uint64_t seed = 1;
};

struct JointPrior;

/// A distance that [cost.clearance] bounds: of two surfaces by `radii_m` less than the output.
struct ClearanceOutput {
  std::string output;
  double radii_m = 0.0, margin_m = 0.0;
};

/// The arrays that the configuration's cost points to, and what they stand for.
struct TaskRows {
  std::vector<double> reference, demonstration_mean, demonstration_root;
  std::vector<tiller_output_cost_t> outputs;
  std::vector<ClearanceOutput> clearance;
};

class LoadedNetwork;  // tools/robot/network_file.hpp
class LoadedPolicy;

/// The names of the model's parts and of what is measured.
struct RobotNames {
  Words states, inputs, measurements, outputs;
  Words params;  ///< (param_count) the model's, then each effect's as "<port>.<parameter>"
};

/// What the configuration points to; copies share it.
struct ConfigMemory {
  std::shared_ptr<const TaskRows> rows;          ///< of `cost`
  std::shared_ptr<const JointPrior> joint;       ///< of `prior_mixture`
  std::shared_ptr<const LoadedNetwork> network;  ///< of `network`
  std::shared_ptr<const LoadedPolicy> policy;    ///< of `policy`
};

/// How a robot is moved for learning alone (`tiller run --calibrate`).
struct CalibrationSection {
  double seconds = 5.0;
  std::vector<double> state_low, state_high;  ///< (nx) the box; -INFINITY, INFINITY where nothing is drawn
  std::vector<double> input_low, input_high;  ///< (nu) likewise
};

/// A robot file, read, checked and complete: the controller's configuration, and what the host's programs need beside.
struct RobotFile {
  std::string path, name;
  ModelRequest model_request;
  Config config{};
  ConfigMemory memory;
  RobotNames names;
  SubstepAdvice substeps;  ///< what the period needs; taken where the file does not say
  TransportSection transport;
  RealtimeSection realtime;
  SimSection sim;
  CalibrationSection calibration;
  LogMap log;
  FigureSection figure;
};

/// A robot file as it was written: read and checked, without what trial steps add (parse_robot_file() takes them).
struct RobotText {
  std::unique_ptr<RobotFile> robot;  ///< null: `errors` says why
  bool says_substeps = false, says_horizon = false;
};
RobotText parse_robot_text(const std::string& text, const std::string& path, std::string& errors);

/// Index of a name; -1 if it is not there.
int index_of(const Words& names, const std::string& name);

}  // namespace tiller::tools
