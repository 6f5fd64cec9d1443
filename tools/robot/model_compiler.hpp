#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

/// The flags with which a model in C++ or C is compiled for this machine: language, optimisation, instruction set.
std::vector<std::string> model_flags(bool cpp);

/// "TILLER_EXPORT_MODEL(Type)", or with a cost where `cost_type` is not empty: what makes a template a model.
std::string export_macro(const std::string& type, const std::string& cost_type);

/// Compiles a model source into a shared object that exports `tiller_model`, or finds it in the cache.
/// `path` is absolute and exists; `type` is the struct's name for ".hpp" and "" for ".c", `cost_type` the cost
/// template's or "". Returns the shared
/// object's path, or "" with `error` set. Says on stderr that it compiles, or waits for another process that compiles
/// the same model, with the seconds so far.
std::string compile_model(const std::string& path, const std::string& type, const std::string& cost_type,
                          std::string& error);

}  // namespace tiller::tools
