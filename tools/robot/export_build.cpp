#include "tools/robot/export_build.hpp"

#include <filesystem>

#include "model_build_config.hpp"
#include "tools/robot/model_compiler.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

std::string object_of(const std::string& source) { return fs::path(source).stem().string() + ".o"; }

/// Link options of the model; its lines, if it is not built in, are added to `text`.
std::string model_object(const ModelRequest& request, const std::string& indent, std::string& text) {
  if (request.file.empty()) return "";
  const fs::path file = request.file;
  const std::string flags = " $(pkg-config --cflags tiller) -c ";
  if (file.extension() == ".so") return file.has_parent_path() ? file.string() + " " : "./" + file.string() + " ";
  if (file.extension() == ".c") {
    text += indent + "cc " + join(model_flags(false), " ") + flags + file.string() + "\n";
    return object_of(file.string()) + " ";
  }
  const std::string source = file.stem().string() + "_model.cpp";
  text += indent + "printf '%s\\n' '#include \"rollout/export_model.hpp\"' '#include \"" + file.string() + "\"' \\\n" +
          indent + "  '" + export_macro(request.type, request.cost_type) + "' > " + source + "\n" + indent + "c++ " +
          join(model_flags(true), " ") + " \\\n" + indent + " " + flags + source + "\n";
  return object_of(source) + " ";
}

}  // namespace

std::string build_commands(const RobotFile& robot, const std::string& config_file, const std::string& indent) {
  std::string text = indent + "PREFIX=/opt/tiller\n" + indent + "export PKG_CONFIG_PATH=$PREFIX/" +
                     TILLER_MODEL_INSTALL_LIBDIR + "/pkgconfig\n" + indent +
                     "cc -std=c99 -O2 $(pkg-config --cflags tiller) -c " + config_file + "\n";
  const std::string model = model_object(robot.model_request, indent, text);
  return text + indent + "cc main.o " + object_of(config_file) + " " + model + "$(pkg-config --libs tiller) -o main\n";
}

}  // namespace tiller::tools
