#pragma once

#include <string>

namespace tiller::tools {

/// Every key of the robot file, from the schema, with the library's own defaults: for a terminal.
std::string robot_file_help();

/// The same as Markdown tables: the second half of docs/reference/robot_file.md, which a test compares.
std::string robot_file_markdown();

}  // namespace tiller::tools
