#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

/// The words that start one of the Python tools (tiller_tools.<module>) with these arguments.
std::vector<std::string> python_command(const std::string& module, const std::vector<std::string>& arguments);

/// Runs one of the Python tools (tiller_tools.<module>) with arguments. The interpreter is TILLER_PYTHON, else
/// the one that the build was configured with. False with a message in `error`.
bool run_python_tool(const std::string& module, const std::vector<std::string>& arguments, std::string& error);

/// Becomes one of the Python tools, with this terminal, its signals and its exit code. Returns only where Python cannot
/// be started, with a message in `error`.
void become_python_tool(const std::string& module, const std::vector<std::string>& arguments, std::string& error);

/// A page that a tool draws from a file. One that cannot be written is told so, before Python is asked.
bool draw_page(const std::string& module, const std::string& from, const std::string& page, std::string& error);

/// The one-file HTML page of a run's CSV; facts beside the log (see write_run_facts) are taken in.
bool write_report(const std::string& log, const std::string& page, std::string& error);

}  // namespace tiller::tools
