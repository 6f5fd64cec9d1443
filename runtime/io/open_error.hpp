#pragma once

namespace tiller {

/// Why a transport could not be opened and what to do about it. Written by the open functions alone: nothing
/// is formatted once a transport runs.
struct OpenError {
  char text[400] = "";
};

/// printf into `error`, which may be null.
__attribute__((format(printf, 2, 3))) void set_open_error(OpenError* error, const char* format, ...);

}  // namespace tiller
