#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/learn/held_out.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools::learn {

/// What forces are learnt from, what judges them, and how the logs are smoothed.
struct Course {
  std::vector<Grid> train, judge;
  double seconds = 0, judged_s = 0;
};

/// The last `share` of every grid judges; where that is too short for rollouts of one second, whole grids do, the last
/// ones first. False with a sentence in `error` where there is too little of both.
bool split(const std::vector<Grid>& grids, double share, Course& course, std::string& error);

/// A model beside which forces are learnt: a robot file's text, whose priors' centres are its parameters.
struct Ground {
  std::string text, origin;      ///< of the robot file; "" or what was found for it
  std::vector<double> params;    ///< (np) the robot's own fitted alone, which `before` has
  double sensor_factor = 1;      ///< of the sensors' deviations in the filters
  Eigen::VectorXd typical;       ///< (nf) force that moves each joint as the logs show
  Eigen::VectorXd force_sd;      ///< (nf) intensity of the force that is left
  Eigen::VectorXd acceleration;  ///< (nf) root mean square of each joint
  SmoothedForces forces;         ///< that the model lacks in the part to learn from
  HeldOut before;                ///< the model alone on the part that judges
  Eigen::VectorXd process_sd;    ///< (nx) noise that makes its spread honest
  HeldOut residual;              ///< the nine local weights at one joint
  std::string residual_joint;    ///< where; "": none was fitted
};

/// Fits the parameters, alone and beside nine local weights at the joint that wants them most, of the same; smooths;
/// judges. The model has joints, and no quaternions. False with a sentence in `error`.
bool lay_ground(const RobotFile& robot, const std::string& text, const Course& course, Ground& ground,
                std::string& error);

/// The effects of the catalogue that bring rollouts over the part to learn from nearest to it, as a ground of its own.
/// Judged from the states that `plain` begins in; with effects of sensors from those that they read. `hash` (of the logs) goes into a
/// comment of the robot file. False with a sentence in `error` where none helps. Cost: that of `tiller gap` with two
/// effects at most, six seconds for 48 s of a pendulum at 100 Hz.
bool find_catalogue(const RobotFile& robot, const std::string& text, const Course& course, const Ground& plain,
                    unsigned threads, const std::string& hash, Ground& ground, std::string& error);

/// The forces that are left beside a network, and what rollouts with it come to.
struct Beside {
  SmoothedForces forces;
  Eigen::VectorXd force_sd, process_sd;
  HeldOut held_out;
};
/// `force_sd` (nf): where the intensity is sought, that of the time before. `states_of`: whose filter the rollouts
/// begin in. Without `judged` there is no judgement.
bool smooth_beside(const RobotFile& robot, const Ground& ground, const Ground& states_of, const LoadedNetwork& network,
                   const Course& course, const Eigen::VectorXd& force_sd, bool judged, Beside& out, std::string& error);

/// Rollouts of one second of a robot file, and of its members where it has learnt forces, in `grids` from `states`.
HeldOut judge_robot(const RobotFile& robot, const std::vector<Grid>& grids, const std::vector<Eigen::MatrixXd>& states);

/// JSON of it for the laboratory (python/tiller/labs/forces/data.py), and back, less the forces and judgements.
std::string ground_json(const RobotFile& robot, const Course& course, const Ground& ground);
std::string beside_json(const Beside& beside);
std::string held_out_json(const HeldOut& held_out);
bool read_ground(const std::string& json, Ground& ground, std::string& error);

}  // namespace tiller::tools::learn
