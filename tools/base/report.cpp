#include "tools/base/report.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "python_config.hpp"
#include "tools/base/child_process.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

std::string interpreter() {
  if (const char* named = std::getenv("TILLER_PYTHON"); named && *named) return named;
  std::error_code ignored;
  return fs::exists(TILLER_PYTHON_CONFIGURED, ignored) ? TILLER_PYTHON_CONFIGURED : "python3";
}

/// TILLER_TOOLS, else the source tree's package, or the one that was installed beside the program.
std::string package_folder() {
  if (const char* named = std::getenv("TILLER_TOOLS"); named && *named) return named;
  std::error_code code;
  if (fs::exists(fs::path(TILLER_PYTHON_SOURCE) / "tiller_tools", code)) return TILLER_PYTHON_SOURCE;
  const fs::path self = fs::read_symlink("/proc/self/exe", code);
  return (self.parent_path().parent_path() / TILLER_PYTHON_INSTALLED).string();
}

/// Of the tools, and in a build folder of the package `tiller` too; what is installed is found where Python looks.
std::string python_path() {
  std::error_code ignored;
  const bool is_built = fs::exists(fs::path(TILLER_PYTHON_PACKAGE) / "tiller", ignored);
  return package_folder() + (is_built ? ":" TILLER_PYTHON_PACKAGE : "");
}

std::string last_lines(const std::string& text, std::size_t count) {
  std::size_t from = text.size();
  for (std::size_t found = 0; from > 0; --from) {
    if (text[from - 1] == '\n' && from != text.size() && ++found == count) break;
  }
  return text.substr(from);
}

/// No interpreter (what `env` says by 127), or one without a package: not a page that cannot be written or data that
/// are wrong.
bool lacks_packages(const ChildResult& child) {
  return child.exit_code == 127 || child.output.find("No module named") != std::string::npos;
}

}  // namespace

std::vector<std::string> python_command(const std::string& module, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {"env", "PYTHONPATH=" + python_path(), "PYTHONDONTWRITEBYTECODE=1", interpreter(),
                                      "-m",  "tiller_tools." + module};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

void become_python_tool(const std::string& module, const std::vector<std::string>& arguments, std::string& error) {
  std::vector<std::string> command = python_command(module, arguments);
  std::vector<char*> argv;
  for (std::string& word : command) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::fflush(nullptr);
  execvp(argv[0], argv.data());
  error = command[0] + " cannot be started: " + std::strerror(errno);
}

bool run_python_tool(const std::string& module, const std::vector<std::string>& arguments, std::string& error) {
  const ChildResult child = run_child(python_command(module, arguments));
  if (child.started && child.exit_code == 0) return true;
  error = interpreter() + " -m tiller_tools." + module + " failed: " + last_lines(child.output, 3);
  if (lacks_packages(child))
    error +=
        "  it needs Python with numpy, matplotlib and what else tools/dev/requirements.txt names: run ./dev setup, or "
        "install python3-numpy and python3-matplotlib, or set TILLER_PYTHON to an interpreter that has them";
  return false;
}

bool draw_page(const std::string& module, const std::string& from, const std::string& page, std::string& error) {
  return can_write_file(page, error) && run_python_tool(module, {from, "-o", page}, error);
}

bool write_report(const std::string& log, const std::string& page, std::string& error) {
  return draw_page("report", log, page, error);
}

}  // namespace tiller::tools
