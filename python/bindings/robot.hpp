#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::python {

namespace nb = nanobind;

/// A robot file that was read and checked. Constant; copies share it.
struct Robot {
  std::shared_ptr<const tools::RobotFile> file;

  const tools::RobotFile& operator*() const { return *file; }
  const tools::RobotFile* operator->() const { return file.get(); }
};

/// The argument `robot`.
const Robot& read_robot(nb::handle from, const char* function);

void bind_robot(nb::module_& m);
void bind_controller(nb::module_& m);
void bind_plant(nb::module_& m);
void bind_rollout(nb::module_& m);
void bind_training(nb::module_& m);
void bind_jax(nb::module_& m);  // where XLA's headers are: TILLER_XLA_FFI

}  // namespace tiller::python
