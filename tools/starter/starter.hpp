#pragma once

#include <string>

#include "tools/starter/answers.hpp"

namespace tiller::tools {

/// Mechanisms that come with a robot file of their own which needs no other file: "acrobot", "cart_pole", ...
Words starter_mechanisms();
/// Its text.
std::string starter_text(const std::string& mechanism);

/// A robot file with the answers in it: `text` is the one of the mechanism, `robot` what it says. What a period counts
/// (horizon, deadline, timeouts) goes with the period, and the simulated sensors are as good as the real ones are said
/// to be.
std::string with_answers(const std::string& text, const RobotFile& robot, const Answers& answers,
                         const std::string& name);

}  // namespace tiller::tools
