#include "tools/command/command_list.hpp"

/// The demo alone: `./dev demo` waits for one robot's kernel and the closed loop, not for the whole command.
int main(int argc, char** argv) {
  using namespace tiller::tools;
  return run_command_line(argc, argv, {add_demo_command});
}
