#pragma once

namespace tiller::tools {

/// How every command ends; `tiller --help` tells them.
enum ExitCode : int {
  kExitOk = 0,
  kExitBadInput = 1,       ///< a wrong file, option or missing device: nothing was moved
  kExitLogIncomplete = 2,  ///< the run ended as it should, but not everything could be written
  kExitSafe = 3            ///< the controller latched SAFE
};

}  // namespace tiller::tools
