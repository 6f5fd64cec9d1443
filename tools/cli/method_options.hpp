#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/identify/method.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What a command says about its methods.
struct MethodOptionsText {
  Words methods;                            ///< that it takes, the default first
  std::string what = "how to learn";        ///< --method
  std::string iterations = "(default 10)";  ///< behind --iterations
  std::string kl = "(default 1)";           ///< behind --kl
};

/// --method and the options of the methods that the command takes; options that only others read are left out.
void add_method_options(CLI::App& command, const MethodOptionsText& text, std::string& method, MethodOptions& how);

/// A sentence about the first option given that `method`, one of `methods`, does not read, or that two options set the
/// same; else empty.
std::string misplaced_option(const CLI::App& command, const Words& methods, const std::string& method,
                             const MethodOptions& how);

}  // namespace tiller::tools
