// The one translation unit that holds toml++'s definitions.
#define TOML_IMPLEMENTATION
#include "tools/toml.hpp"
