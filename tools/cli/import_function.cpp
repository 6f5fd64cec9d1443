#include "tools/cli/import_function.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/command/commands.hpp"
#include "tools/import/function_model.hpp"

namespace tiller::tools {
namespace {

int complain_all(const Words& errors) {
  for (const std::string& error : errors) (void)complain(error);
  return kExitBadInput;
}

/// The words of --value as details: they are kept with the function.
bool take_values(const Words& values, FunctionText& function, Words& errors) {
  std::string rows;
  for (const std::string& word : values) {
    const std::size_t equals = word.find('=');
    char* end = nullptr;
    const double value = equals == std::string::npos ? NAN : std::strtod(word.c_str() + equals + 1, &end);
    if (equals == 0 || !std::isfinite(value) || end == word.c_str() + equals + 1 || *end != '\0' ||
        word.find_first_of("\"\\") != std::string::npos)
      errors.push_back("--value " + word + ": write PARAMETER=NUMBER");
    else
      rows += (rows.empty() ? "\"" : ", \"") + word.substr(0, equals) + "\": " + number_text(value);
  }
  if (!errors.empty() || rows.empty()) return errors.empty();
  return read_function_details("{\"parameters\": {" + rows + "}}", "--value", function, errors);
}

bool within_limits(const FunctionModel& m, Words& errors) {
  const auto over = [&](const char* what, std::size_t count, int most) {
    if (count > static_cast<std::size_t>(most))
      errors.push_back(m.path + ": " + std::to_string(count) + " " + what + " where a model may have " +
                       std::to_string(most));
  };
  over("states", m.states.size(), TILLER_MAX_STATES);
  over("inputs", m.inputs.size(), TILLER_MAX_INPUTS);
  over("parameters that matter", m.parameters.size(), TILLER_MAX_PARAMS);
  over("forces", m.forces.size(), TILLER_MAX_JOINTS);
  over("outputs", m.outputs.size(), TILLER_MAX_OUTPUTS);
  return errors.empty();
}

int write_files(const ImportFunction& o, const FunctionText& function, FunctionModel& model) {
  const WrittenFunction written = write_function_model(model);
  const std::string header = model.name + ".hpp", robot = o.folder + "/robot.toml";
  const std::string path = o.folder + "/" + header, kept = o.folder + "/" + model.name + ".json";
  for (const std::string& file : {robot, path})
    if (!o.force && std::filesystem::exists(file))
      return complain(file + " is there already; write it anew with --force");
  make_folders_for(robot);
  std::string error;
  for (const auto& [file, text] : {std::pair{path, written.text}, std::pair{kept, function.compiled},
                                   std::pair{robot, write_function_robot(model, header)}})
    if (!replace_file(file, text, error)) return complain(error);
  for (const std::string& text : model.notes) std::printf("note: %s\n", text.c_str());
  std::printf("%s: %zu states, %zu inputs, %zu joints, %zu parameters, %zu outputs; %d operations for the derivatives",
              model.name.c_str(), model.states.size(), model.inputs.size(), model.joints.size(),
              model.parameters.size(), model.outputs.size(), written.operations);
  if (!model.told.empty()) std::printf(", %d for the outputs", written.output_operations);
  std::printf("\n  %s\n  %s\n  %s, which can be imported without CasADi\n", path.c_str(), robot.c_str(), kept.c_str());
  std::printf("next:\n  tiller check %s\n  tiller run %s --sim --seconds 5 --report %s/run.html\n", robot.c_str(),
              robot.c_str(), o.folder.c_str());
  return kExitOk;
}

}  // namespace

int import_function(ImportFunction o) {
  Words errors;
  FunctionText function;
  FunctionModel model;
  if (!read_function(o.file, o.details, function, errors) || !take_values(o.values, function, errors) ||
      !build_function_model(function, o.unknown, model, errors) || !within_limits(model, errors))
    return complain_all(errors);
  if (o.folder.empty()) o.folder = model.name;
  while (o.folder.size() > 1 && o.folder.back() == '/') o.folder.pop_back();
  return write_files(o, function, model);
}

}  // namespace tiller::tools
