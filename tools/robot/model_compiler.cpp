#include "tools/robot/model_compiler.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <thread>

#include "model_build_config.hpp"
#include "scalar/isa.hpp"
#include "tools/base/child_process.hpp"
#include "tools/base/file_lock.hpp"
#include "tools/base/wait_line.hpp"
#include "tools/robot/compiler_errors.hpp"

namespace tiller::tools {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::stringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);)
    if (!part.empty()) parts.push_back(part);
  return parts;
}

// The flags of TillerTargets.cmake are one CMake string with blanks or semicolons between them.
std::vector<std::string> split_flags(std::string text) {
  for (char& c : text)
    if (c == ';') c = ' ';
  return split(text, ' ');
}

std::string environment(const char* name, const std::string& otherwise) {
  const char* value = std::getenv(name);
  return value && *value ? value : otherwise;
}

std::string read_file(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

// FNV-1a, 64 bits: names a cache entry; it guards against staleness, not against an adversary, who could
// write into the user's cache folder only with the user's own rights.
std::uint64_t hash(const std::string& text) {
  std::uint64_t h = 0xcbf29ce484222325u;
  for (const unsigned char c : text) h = (h ^ c) * 0x100000001b3u;
  return h;
}

// A configured compiler may be absent where the install tree was copied to: then PATH's.
std::string compiler(bool cpp) {
  const std::string configured = cpp ? TILLER_MODEL_CXX : TILLER_MODEL_CC;
  const std::string fallback = cpp ? "c++" : "cc";
  return environment(cpp ? "TILLER_CXX" : "TILLER_CC", fs::exists(configured) ? configured : fallback);
}

// TILLER_INCLUDE, else the install tree that this program stands in, else the build tree.
std::vector<std::string> include_folders() {
  std::vector<std::string> folders = split(environment("TILLER_INCLUDE", ""), ':');
  if (folders.empty()) {
    std::error_code failed;
    const fs::path program = fs::read_symlink("/proc/self/exe", failed);
    const fs::path installed = program.parent_path().parent_path() / TILLER_MODEL_INSTALL_INCLUDEDIR;
    if (!failed && fs::exists(installed / "tiller/runtime/rollout/rollout.hpp"))
      folders = {(installed / "tiller/runtime").string(), installed.string()};
    else
      folders = split(TILLER_MODEL_BUILD_INCLUDES, ';');
  }
  for (const std::string& folder : split(TILLER_MODEL_PACKAGE_INCLUDES, ';')) folders.push_back(folder);
  return folders;
}

std::vector<std::string> isa_flags(Isa isa) {
  std::vector<std::string> flags;
  if (isa == Isa::sse2) flags = split_flags(TILLER_MODEL_FLAGS_sse2);
  if (isa == Isa::avx2) flags = split_flags(TILLER_MODEL_FLAGS_avx2);
  if (isa == Isa::avx512) flags = split_flags(TILLER_MODEL_FLAGS_avx512);
  const std::string name = isa_name(isa);
  flags.push_back("-DTILLER_COMPILE_ISA=" + name);
  flags.push_back("-DTILLER_COMPILE_ISA_" + name + "=1");
  return flags;
}

std::vector<std::string> command_line(bool cpp) {
  std::vector<std::string> argv = {compiler(cpp), "-shared", "-fPIC", "-Wall", "-Wextra", "-fmax-errors=20"};
  // Hidden, because copies of the same templates for other instruction sets live in the program.
  if (cpp) argv.insert(argv.end(), {"-fvisibility=hidden", "-fvisibility-inlines-hidden"});
  // What C lets pass with a warning and a robot cannot: a function of another signature in the table, an unknown
  // function, a number nobody wrote.
  if (!cpp)
    for (const char* what : {"incompatible-pointer-types", "implicit-function-declaration", "implicit-int",
                             "int-conversion", "return-type", "uninitialized"})
      argv.push_back(std::string("-Werror=") + what);
  for (const std::string& flag : model_flags(cpp)) argv.push_back(flag);
  for (const std::string& folder : include_folders()) argv.push_back("-I" + folder);
  return argv;
}

// Null unless the folder is ours alone: a stranger who could write into it could have us load his code.
fs::path cache_folder(std::string& error) {
  fs::path folder = environment("TILLER_CACHE", "");
  if (folder.empty()) {
    const std::string home = environment("HOME", "");
    const std::string base = environment("XDG_CACHE_HOME", home.empty() ? "" : home + "/.cache");
    folder = base.empty() ? fs::temp_directory_path() / ("tiller-" + std::to_string(getuid()))
                          : fs::path(base) / "tiller" / "models";
  }
  std::error_code failed;
  const bool fresh = fs::create_directories(folder, failed);
  if (fresh) fs::permissions(folder, fs::perms::owner_all, failed);
  struct stat info = {};
  if (stat(folder.c_str(), &info) != 0 || access(folder.c_str(), W_OK) != 0) {
    error =
        folder.string() + ": compiled models cannot be kept there; set TILLER_CACHE to a folder that can be written";
    return {};
  }
  if (info.st_uid != getuid() || (info.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
    error = folder.string() +
            ": others may write there, so compiled models in it are not to be trusted; set TILLER_CACHE to a "
            "folder of your own (mode 700)";
    return {};
  }
  return folder;
}

// The compiler's dependency file: "target: a b \<newline> c", blanks inside names escaped by a backslash.
std::vector<std::string> read_dependencies(const fs::path& path) {
  const std::string text = read_file(path);
  std::vector<std::string> files;
  std::string word;
  const auto colon = text.find(": ");
  for (std::size_t i = colon == std::string::npos ? text.size() : colon + 2; i < text.size(); ++i) {
    const char c = text[i];
    const char next = i + 1 < text.size() ? text[i + 1] : '\0';
    if ((c == '\\' && next == ' ') || (c == '$' && next == '$')) {
      word += text[++i];
    } else if (c == ' ' || c == '\n' || (c == '\\' && next == '\n')) {
      if (!word.empty()) files.push_back(word);
      word.clear();
    } else {
      word += c;
    }
  }
  return files;
}

// Everything that was included is older than the copy. Without a dependency file nothing is known: compile.
bool is_fresh(const fs::path& object, const fs::path& dependencies) {
  std::error_code failed;
  const auto built = fs::last_write_time(object, failed);
  if (failed) return false;
  const std::vector<std::string> files = read_dependencies(dependencies);
  for (const std::string& file : files) {
    const auto changed = fs::last_write_time(file, failed);
    if (failed || changed > built) return false;
  }
  return !files.empty();
}

// The C++ text around a user's header. Everything is hidden but the one entry. The kernel asks for the effects'
// metadata; the copy here keeps the object free of symbols that the loading program would have to export. Paths
// with quotes were refused before.
std::string wrapper_source(const std::string& path, const std::string& type, const std::string& cost_type) {
  return "#include \"rollout/export_model.hpp\"\n#include \"" + path + R"("
#if !defined(TILLER_KERNEL_PART) || TILLER_KERNEL_PART == 1
namespace tiller {
namespace {
constexpr EffectInfo kInfos[] = {
#define TILLER_EFFECT(name, Type, ...) Type<double>::info,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
constexpr Hook kHooksOfKinds[] = {
#define TILLER_EFFECT(name, Type, ...) Type<double>::hook,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
}  // namespace
const EffectInfo& effect_info(std::uint32_t kind) { return kInfos[kind]; }
Hook hook_of(std::uint32_t kind) { return kHooksOfKinds[kind]; }
}  // namespace tiller
#endif
extern "C" __attribute__((visibility("default"))) const tiller_model_t* tiller_model(void);
)" + export_macro(type, cost_type) +
         "\n";
}

/// Parts of a cache entry.
struct Entry {
  fs::path object;
  fs::path beside(const char* extension) const {
    fs::path path = object;
    return path.replace_extension(extension);
  }
  bool is_fresh() const { return tools::is_fresh(object, beside(".d")); }
};

/// Renamed when whole, and what it depends on first: a reader that comes in between finds a copy that is too old.
bool publish(const fs::path& partial, const fs::path& partial_dependencies, const Entry& entry, std::string& error) {
  std::error_code failed;
  fs::rename(partial_dependencies, entry.beside(".d"), failed);
  if (!failed) fs::rename(partial, entry.object, failed);
  if (failed) error = entry.object.string() + ": " + failed.message();
  return !failed;
}

std::string last_line(const std::string& text) {
  const std::vector<std::string> lines = split(text, '\n');
  for (auto line = lines.rbegin(); line != lines.rend(); ++line)
    if (!line->empty()) return *line;
  return "";
}

/// A kernel's two halves side by side (rollout/export_model.hpp), then linked. Words: the object, its dependency file,
/// the source, and the compiler with its flags.
constexpr char kTwoHalves[] = R"(
object=$1 dependencies=$2 source=$3
shift 3
trap 'rm -f "$object.1.o" "$object.2.o" "$object.2.txt"' EXIT
"$@" -c -DTILLER_KERNEL_PART=2 -o "$object.2.o" "$source" > "$object.2.txt" 2>&1 &
second=$!
"$@" -c -DTILLER_KERNEL_PART=1 -MMD -MF "$dependencies" -MT model -o "$object.1.o" "$source"
first=$?
wait "$second"
second=$?
[ "$first" -eq 0 ] || exit "$first"
cat "$object.2.txt"
[ "$second" -eq 0 ] || exit "$second"
"$@" -o "$object" "$object.1.o" "$object.2.o"
)";
constexpr int kNoSuchProgram = 127;  // a shell's exit code

/// The compiler's words for one source; of a template on more than one processor, a shell's for two halves at once.
std::vector<std::string> compiler_words(std::vector<std::string> argv, const fs::path& source, bool cpp,
                                        const fs::path& object, const fs::path& dependencies) {
  if (cpp && std::thread::hardware_concurrency() > 1) {
    const std::vector<std::string> shell = {"sh", "-c", kTwoHalves, "sh", object, dependencies, source};
    argv.insert(argv.begin(), shell.begin(), shell.end());
  } else {
    argv.insert(argv.end(), {source, "-MMD", "-MF", dependencies, "-MT", "model", "-o", object});
    if (!cpp) argv.emplace_back("-lm");
  }
  argv.insert(argv.begin(), {"env", "LC_ALL=C"});  // its messages are read
  return argv;
}

bool compile(const std::vector<std::string>& flags, const fs::path& source, bool cpp, const std::string& path,
             const Entry& entry, bool alone, std::string& error) {
  // the lock keeps others away; without one the process's number does
  const std::string suffix = alone ? ".partial" : "." + std::to_string(getpid());
  const fs::path partial = entry.object.string() + suffix;
  const fs::path dependencies = entry.beside(".d").string() + suffix;
  const std::vector<std::string> argv = compiler_words(flags, source, cpp, partial, dependencies);
  WaitLine line("compiling model " + path + " (once)");
  const CompiledSource told = {path, cpp ? source.string() : "", include_folders()};
  const std::string rules = "  with: " + flags[0] + " (the authoring rules are in docs/guide/own_model.md)";
  int took = 0;
  const ChildResult child = run_child(argv, [&](int seconds) { line.show(took = seconds); });
  line.end(child.started && child.exit_code == 0 ? "done" : "failed", took);
  std::error_code failed;
  if (!child.started || child.exit_code == kNoSuchProgram) {
    error = path + ": no compiler '" + flags[0] + "' on this machine (" + last_line(child.output) +
            "); install one (package build-essential) or set TILLER_CXX and TILLER_CC";
    return false;
  }
  if (child.exit_code != 0) {
    fs::remove(partial, failed);
    fs::remove(dependencies, failed);
    if (child.output.find("rollout/export_model.hpp: No such file") != std::string::npos) {
      error = path +
              ": tiller's headers are not on this machine; install the package libtiller-dev, or set "
              "TILLER_INCLUDE to their folder";
      return false;
    }
    error = path + ": the model does not compile:\n" + author_errors(child.output, told) + rules;
    return false;
  }
  if (const std::string left_out = left_out_fields(child.output, told); !left_out.empty()) {
    fs::remove(partial, failed);
    fs::remove(dependencies, failed);
    error = path + ": the model leaves fields out:\n" + left_out + rules;
    return false;
  }
  return publish(partial, dependencies, entry, error);
}

/// One process compiles an entry at a time; who waits for it says so.
void wait_for_turn(const std::string& path, const Entry& entry, FileLock& lock) {
  std::unique_ptr<WaitLine> line;
  int took = 0;
  lock.take(entry.beside(".lock").string(), [&](int seconds) {
    if (!line) line = std::make_unique<WaitLine>("waiting for another tiller that compiles model " + path);
    if (seconds > 0) line->show(seconds);
    took = seconds;
  });
  if (line) line->end(entry.is_fresh() ? "done" : "it was not finished there", took);
}

}  // namespace

std::vector<std::string> model_flags(bool cpp) {
  std::vector<std::string> flags = {"-std=c99", "-O2"};
  if (cpp) flags = {"-std=c++17", "-O3", "-fno-exceptions", "-fno-rtti"};
  if (cpp)
    for (const std::string& flag : isa_flags(best_isa())) flags.push_back(flag);
  if (std::strcmp(TILLER_MODEL_REPRODUCIBLE, "ON") == 0)
    for (const char* flag : {"-ffp-contract=off", "-DTILLER_REPRODUCIBLE=1"}) flags.emplace_back(flag);
  return flags;
}

std::string export_macro(const std::string& type, const std::string& cost_type) {
  return (cost_type.empty() ? "TILLER_EXPORT_MODEL(" + type
                            : "TILLER_EXPORT_MODEL_WITH_COST(" + type + ", " + cost_type) +
         ")";
}

std::string compile_model(const std::string& path, const std::string& type, const std::string& cost_type,
                          std::string& error) {
  const bool cpp = !type.empty();
  const fs::path folder = cache_folder(error);
  if (folder.empty()) return "";
  std::vector<std::string> argv = command_line(cpp);
  std::string key = std::string(TILLER_MODEL_VERSION_TEXT) + '\n' + path + '\n' + type + '\n' + read_file(path);
  if (cpp) key += wrapper_source(path, type, cost_type);
  for (const std::string& word : argv) key += '\n' + word;
  char name[40];
  std::snprintf(name, sizeof name, "%016llx", static_cast<unsigned long long>(hash(key)));
  const Entry entry = {folder / (fs::path(path).stem().string() + "-" + name + ".so")};
  if (entry.is_fresh()) return entry.object.string();
  FileLock lock;
  wait_for_turn(path, entry, lock);
  if (entry.is_fresh()) return entry.object.string();

  fs::path source = path;
  if (cpp) {
    source = entry.beside(".cpp");
    std::ofstream(source) << wrapper_source(path, type, cost_type);
  }
  return compile(argv, source, cpp, path, entry, lock.held(), error) ? entry.object.string() : "";
}

}  // namespace tiller::tools
