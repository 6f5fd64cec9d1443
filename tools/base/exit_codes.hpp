#pragma once

namespace tiller::tools {

/// How every command ends; `tiller --help` tells them.
enum ExitCode : int {
  kExitOk = 0,
  kExitBadInput = 1,       ///< a wrong file, option or missing device: nothing was moved
  kExitLogIncomplete = 2,  ///< the run ended as it should, but not everything could be written
  kExitSafe = 3,           ///< the controller latched SAFE
  kExitDiffers = 4,        ///< `tiller replay`: a command is not what was recorded
  kExitInterrupted = 130   ///< Ctrl-C, as shells have it: what was done is kept
};

/// `tiller gap` answers by its exit code: 0 to 3 are verdicts (gap/outputs.hpp), the rest is what else may happen.
enum GapExitCode : int {
  kExitGapUsage = 4,      ///< a wrong option, robot file or folder: nothing was looked at
  kExitGapIncomplete = 5  ///< a result could not be written
};

}  // namespace tiller::tools
