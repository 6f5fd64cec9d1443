#include "tools/robot/model_loader.hpp"

#include <dlfcn.h>

#include <cctype>
#include <filesystem>

#include "tools/robot/model_compiler.hpp"

namespace tiller::tools {
namespace fs = std::filesystem;
namespace {

std::string known_models() {
  std::string names;
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i)
    names += std::string(i ? ", " : "") + model->name;
  return names;
}

/// How a model that is not built in is named: `name` itself where it looks like a file.
std::string how_to_give_a_file(const std::string& name) {
  const fs::path path = name;
  if (!path.has_extension() && !path.has_parent_path())
    return "a model of your own: [model] file = \"my_model.hpp\", type = \"MyModel\"";
  const bool cpp = path.extension() != ".c" && path.extension() != ".so";
  return "a file stands under another key: [model] file = \"" + name + "\"" +
         (cpp ? ", type = the name of the struct in it" : "");
}

const tiller_model_t* find_builtin(const std::string& name, std::string& error) {
  const tiller_model_t* model = tiller_find_model(name.c_str());
  if (!model)
    error = "no built-in model '" + name + "'; there are: " + known_models() + "; " + how_to_give_a_file(name);
  return model;
}

// "A::B": what may stand inside TILLER_EXPORT_MODEL without being more than a name.
bool is_type_name(const std::string& type) {
  bool start = true;
  for (std::size_t i = 0; i < type.size(); ++i) {
    const char c = type[i];
    if (c == ':') {
      if (start || i + 2 >= type.size() || type[i + 1] != ':') return false;
      ++i;
      start = true;
      continue;
    }
    const bool letter = std::isalpha(static_cast<unsigned char>(c)) || c == '_';
    if (!letter && (start || !std::isdigit(static_cast<unsigned char>(c)))) return false;
    start = false;
  }
  return !type.empty() && !start;
}

// The wrapper quotes the path in an #include, where these characters have no escape.
bool is_quotable(const std::string& path) { return path.find_first_of("\"\\\n\r") == std::string::npos; }

/// The cost beside the model; null without one, with `error` set where it cannot be used.
const tiller_own_cost_t* find_own_cost(void* handle, const std::string& shown, std::string& error) {
  using Entry = const tiller_own_cost_t* (*)(void);
  const auto entry = reinterpret_cast<Entry>(dlsym(handle, "tiller_cost"));
  if (!entry) return nullptr;
  const tiller_own_cost_t* cost = entry();
  if (!cost || !cost->stage) {
    error = shown + ": tiller_cost() returned " + (cost ? "a cost without stage" : "null") +
            "; see docs/guide/own_model.md";
  } else if (cost->size != sizeof(tiller_own_cost_t) || cost->version != TILLER_CONFIG_VERSION) {
    error = shown +
            ": the size or version of tiller_cost() is not this tiller's; set size = sizeof(tiller_own_cost_t) "
            "and version = TILLER_CONFIG_VERSION, and compile against these headers";
  }
  return error.empty() ? cost : nullptr;
}

const tiller_model_t* open_object(const std::string& object, const std::string& shown, std::string& error,
                                  const tiller_own_cost_t** own) {
  void* handle = dlopen(object.c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: the table stays in use
  if (!handle) {
    error = shown + ": the compiled model cannot be loaded: " + dlerror();
    return nullptr;
  }
  using Entry = const tiller_model_t* (*)(void);
  const auto entry = reinterpret_cast<Entry>(dlsym(handle, "tiller_model"));
  if (!entry) {
    error =
        shown + ": the file has no function `const tiller_model_t* tiller_model(void)`; see docs/guide/own_model.md";
    return nullptr;
  }
  const tiller_model_t* model = entry();
  const std::string problem = check_model_table(model);
  if (!problem.empty()) {
    error = shown + ": " + problem;
    return nullptr;
  }
  const tiller_own_cost_t* cost = find_own_cost(handle, shown, error);
  if (own) *own = cost;
  return error.empty() ? model : nullptr;
}

const tiller_model_t* load_file(const ModelRequest& request, std::string& error, const tiller_own_cost_t** own) {
  std::error_code failed;
  const std::string path = model_path(request);
  if (!fs::is_regular_file(path, failed)) {
    error = path + ": no such model file (key [model] file; relative names start at the robot file's folder)";
    const std::string stem = fs::path(path).stem().string();
    if (tiller_find_model(stem.c_str())) error += "; a model of that name is built in: [model] name = \"" + stem + "\"";
    return nullptr;
  }
  const std::string kind = fs::path(path).extension().string();
  if (kind == ".so") return open_object(path, path, error, own);
  const bool cpp = kind == ".hpp" || kind == ".h" || kind == ".hxx";
  if (!cpp && kind != ".c") {
    error = path + ": a model is a .hpp (C++ template), a .c (C table) or a .so (compiled); this is '" + kind + "'";
    return nullptr;
  }
  if (cpp && !is_type_name(request.type)) {
    error = path + ": [model] type must name the struct in it, e.g. type = \"MyModel\"" +
            (request.type.empty() ? "; it is missing" : "; it is '" + request.type + "'");
    return nullptr;
  }
  if (!cpp && !request.type.empty()) {
    error = path + ": [model] type is for .hpp files; a C file exports tiller_model() and has no type";
    return nullptr;
  }
  if (!request.cost_type.empty() && (!cpp || !is_type_name(request.cost_type))) {
    error =
        path + ": [model] cost_type " +
        (cpp ? "must name a cost template in the header, e.g. cost_type = \"MyCost\"; it is '" + request.cost_type + "'"
             : std::string("is for .hpp files; a C file exports tiller_cost() instead"));
    return nullptr;
  }
  if (!is_quotable(path)) {
    error = path + ": quotes, backslashes and line ends in a model's path cannot be compiled; rename it";
    return nullptr;
  }
  const std::string object = compile_model(path, cpp ? request.type : "", request.cost_type, error);
  return object.empty() ? nullptr : open_object(object, path, error, own);
}

}  // namespace

std::string model_path(const ModelRequest& request) {
  if (request.file.empty()) return "";
  const fs::path file(request.file);
  const fs::path base = request.robot_dir.empty() ? fs::path(".") : fs::path(request.robot_dir);
  return fs::absolute(file.is_absolute() ? file : base / file).lexically_normal().string();
}

const tiller_model_t* load_model(const ModelRequest& request, std::string& error, const tiller_own_cost_t** own) {
  if (own) *own = nullptr;
  if (!request.name.empty() && !request.file.empty()) {
    error = "[model] has both name and file; keep one";
    return nullptr;
  }
  if (!request.name.empty() && !request.cost_type.empty()) {
    error = "[model] cost_type is for a header of your own; a built-in model has none";
    return nullptr;
  }
  if (!request.name.empty()) return find_builtin(request.name, error);
  if (!request.file.empty()) return load_file(request, error, own);
  error = "[model] needs name (one of: " + known_models() + ") or file";
  return nullptr;
}

}  // namespace tiller::tools
