#pragma once

#include <string>

#include "tools/learn/learn.hpp"

namespace tiller::tools::learn {

/// A robot file's text with the chosen candidate: `network_file` as [network] file, the effect, the noise that makes
/// its spread honest, and priors about the parameters that it stands on, as gap::write_robot() writes them. The old
/// text keeps its comments. False with sentences in `error`. The network's file need not exist yet.
bool learnt_robot_text(const RobotFile& robot, const std::string& old_text, const Learnt& learnt,
                       const std::string& network_file, std::string& text, std::string& error);

/// The summary for a terminal, a line for each candidate.
std::string learnt_text(const Learnt& learnt);

/// learn.json: what the page is drawn from. docs/guide/learn.md has its keys.
std::string learnt_json(const RobotFile& robot, const Learnt& learnt, const std::string& robot_file);

}  // namespace tiller::tools::learn
