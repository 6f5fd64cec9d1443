#pragma once

#include <string>

namespace tiller::tools {

/// Every limit of the library with the constant or key that sets it, as text and as the table of
/// docs/reference/limits.md. The numbers are the headers' and the schema's own.
std::string limits_help();
std::string limits_markdown();

}  // namespace tiller::tools
