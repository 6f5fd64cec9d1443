// What `tiller import` reads: a URDF (an input that begins with '<'), what MuJoCo's compiler says of an MJCF and what
// CasADi says of a function, both as JSON, and the function's details: text before a zero byte. What the readers take
// becomes a mechanism or equations.
#include "fuzz.hpp"
#include "memory_file.hpp"
#include "tools/description/description.hpp"
#include "tools/description/function.hpp"
#include "tools/import/function_model.hpp"
#include "tools/import/mechanism.hpp"

namespace {

using tiller::tools::Words;

void build(const tiller::tools::Description& description) {
  Words errors;
  tiller::tools::Mechanism mechanism;
  const bool good = tiller::tools::build_mechanism(description, {}, mechanism, errors);
  fuzz::require(good == errors.empty(), "a mechanism is refused with a reason, and built without one");
  if (!good) return;
  for (std::size_t i = 0; i < mechanism.bodies.size(); ++i)
    fuzz::require(mechanism.bodies[i].parent < static_cast<int>(i), "parents stand first");
}

void read_xml(const std::string& text) {
  static fuzz::MemoryFile file;
  file.write(text);
  tiller::tools::Description description;
  Words errors;
  const bool good = tiller::tools::read_urdf(file.path(), description, errors);
  fuzz::require(good == errors.empty(), "a URDF is refused with a reason, and taken without one");
  if (good) build(description);
}

void read_function(const std::string& json, const std::string& details) {
  tiller::tools::FunctionText function;
  Words errors;
  const bool good = tiller::tools::read_compiled_function(json, "fuzz.casadi", function, errors) &&
                    (details.empty() || tiller::tools::read_function_details(details, "fuzz.toml", function, errors));
  fuzz::require(good == errors.empty(), "a function is refused with a reason, and taken without one");
  tiller::tools::FunctionModel model;
  if (!good) return;
  const bool built = tiller::tools::build_function_model(function, {}, model, errors);
  fuzz::require(built == errors.empty(), "equations are refused with a reason, and built without one");
}

void read_json(const std::string& text, const std::string& details) {
  if (text.find("\"instructions\"") != std::string::npos) return read_function(text, details);
  tiller::tools::Description description;
  Words errors;
  const bool good = tiller::tools::read_compiled_mjcf(text, "fuzz.xml", description, errors);
  fuzz::require(good == errors.empty(), "an MJCF is refused with a reason, and taken without one");
  if (good) build(description);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  if (text.empty() || text[0] == '<') {
    read_xml(text);
    return 0;
  }
  const std::size_t zero = text.find('\0');
  read_json(zero == std::string::npos ? text : text.substr(zero + 1),
            zero == std::string::npos ? "" : text.substr(0, zero));
  return 0;
}
