#pragma once

#include "tools/identify/method.hpp"

namespace tiller::tools {

#define TILLER_METHOD(name, help, citation, caveat) \
  bool run_##name(const MethodProblem& problem, MethodResult& result, std::string& error);
#include "tools/identify/methods.def"
#undef TILLER_METHOD

}  // namespace tiller::tools
