#pragma once

// toml++ is large: it is compiled once, in toml.cpp, and everybody else sees declarations only.
#define TOML_HEADER_ONLY 0
#include <toml++/toml.h>
