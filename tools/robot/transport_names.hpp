#pragma once

#include <string>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// The transports of transports.def, in its order.
Words transport_names();
/// Those and what else the command line may call them.
Words transport_words();
/// The name that a word of the command line stands for; the word itself where it is none.
std::string transport_named(const std::string& word);

}  // namespace tiller::tools
