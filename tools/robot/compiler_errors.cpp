// A template's typo is an error in every instantiation, and a chain of headers before each.
#include "tools/robot/compiler_errors.hpp"

#include <algorithm>
#include <set>
#include <sstream>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostPlaces = 4, kMostLetters = 400;

/// "file:line:column: error: text", and the lines that quote the place.
struct Message {
  std::string kind;         ///< "error", "note", "warning"
  std::string place, text;  ///< "file:line:column"
  std::vector<std::string> quoted;

  std::string line() const { return place.substr(0, place.rfind(':')); }
  std::string file() const { return line().substr(0, line().rfind(':')); }
};

bool contains(const std::string& text, const char* word) { return text.find(word) != std::string::npos; }

std::vector<Message> messages_of(const std::string& output) {
  std::vector<Message> all;
  std::istringstream stream(output);
  for (std::string line; std::getline(stream, line);) {
    std::size_t at = std::string::npos;
    std::string kind;
    for (const char* word : {"fatal error", "error", "warning", "note"})
      if (const std::size_t found = line.find(": " + std::string(word) + ": "); found < at) {
        at = found;
        kind = word;
      }
    if (at != std::string::npos) {
      const std::string place = line.substr(0, at);
      all.push_back({kind == "fatal error" ? "error" : kind, place, line.substr(at + kind.size() + 4), {}});
    } else if (!all.empty() && !line.empty() && line[0] == ' ' && trimmed(line).compare(0, 5, "from ") != 0) {
      all.back().quoted.push_back(line);
    }
  }
  return all;
}

class Reader {
 public:
  Reader(const std::string& output, const CompiledSource& source) : source_(source), messages_(messages_of(output)) {}

  bool is_author(const Message& m) const {
    const std::string file = m.file();
    if (file == source_.wrapper) return false;
    const auto in = [&](const std::string& folder) { return file.compare(0, folder.size() + 1, folder + "/") == 0; };
    return file == source_.path || (!in("/usr") && std::none_of(source_.folders.begin(), source_.folders.end(), in));
  }

  std::string author_errors() const {
    const Message* first = nullptr;
    std::vector<const Message*> places;
    std::set<std::string> lines;
    std::size_t count = 0;
    for (const Message& m : messages_) {
      if (m.kind != "error") continue;
      ++count;
      // of what did not compile the compiler then says what it cannot be converted to
      const bool follows = contains(m.text, "<expression error>") || contains(m.text, "could not convert '{");
      if (!is_author(m) || (follows && first) || !lines.insert(m.line()).second) continue;
      if (!first)
        first = &m;
      else
        places.push_back(&m);
    }
    if (!first) return header_errors();
    std::string text = quoted(*first);
    std::size_t shown = 1;
    for (; shown <= places.size() && shown < kMostPlaces; ++shown) text += "  | " + head(*places[shown - 1]) + "\n";
    if (count > shown) text += "  | (and " + std::to_string(count - shown) + " that follow from this or repeat it)\n";
    return text + advice(first->text);
  }

  std::string left_out_fields() const {
    std::set<std::string> places;
    std::string text;
    for (const Message& m : messages_) {
      const bool is_field = contains(m.text, "::State::") || contains(m.text, "::Output::");
      if (m.kind != "warning" || !is_author(m) || !is_field || !contains(m.text, "missing initializer for member"))
        continue;
      const std::string field = m.text.substr(m.text.rfind("::") + 2);
      const std::string name = field.substr(0, field.find('\''));
      if (!places.insert(m.line() + name).second) continue;
      Message told = m;
      told.kind = "error";
      told.text = "no value for " + name;
      text += quoted(told);
    }
    return text;
  }

 private:
  static std::string head(const Message& m) {
    std::string text = m.text;
    if (text.size() > kMostLetters) text = text.substr(0, kMostLetters) + "...";
    return m.place + ": " + m.kind + ": " + text;
  }
  static std::string quoted(const Message& m) {
    std::string text = "  | " + head(m) + "\n";
    for (const std::string& line : m.quoted) text += "  | " + line + "\n";
    return text;
  }
  /// What the rules of models say of an error whose words do not.
  static std::string advice(const std::string& text) {
    if (contains(text, "to 'bool'") || contains(text, "used where a 'bool' is expected"))
      return "  an if or ?: of a state cannot differ between lanes: write select(condition, a, b)\n";
    if (contains(text, "incompatible pointer type"))
      return "  the table's functions have the arguments that tiller/model.h declares, double throughout\n";
    for (const char* function :
         {"sin(", "cos(", "tan(", "exp(", "log(", "sqrt(", "tanh(", "abs(", "fabs(", "atan2(", "pow(", "min(", "max("})
      if (contains(text, ("no matching function for call to '" + std::string(function)).c_str()))
        return "  call it without std::, so that lanes and derivatives find theirs\n";
    return "";
  }

  /// No error is in the author's files: the type's name, or what tiller's headers look for in it.
  std::string header_errors() const {
    for (const Message& m : messages_) {
      if (m.kind != "error") continue;
      std::string text;
      if (m.file() == source_.wrapper) {
        text = "  | " + source_.path + ": error: " + m.text +
               "\n  [model] type or cost_type names no template of the file\n";
      } else if (contains(m.text, "is not a member of '") || contains(m.text, "no type named '")) {
        const std::size_t from = m.text.find('\'') + 1;
        text = "  | " + source_.path + ": error: the model has no " +
               m.text.substr(from, m.text.find('\'', from) - from) +
               "\n  a model needs name, State, Input and dynamics; with Force also joints, with Output also outputs\n";
      } else {
        text = "  | " + head(m) + "\n";
      }
      for (const Message& note : messages_)
        if (note.kind == "note" && is_author(note) && contains(note.text, "candidate")) {
          text += quoted(note);
          break;
        }
      return text;
    }
    return "";
  }

  const CompiledSource& source_;
  const std::vector<Message> messages_;
};

}  // namespace

std::string author_errors(const std::string& output, const CompiledSource& source) {
  const std::string text = Reader(output, source).author_errors();
  return text.empty() ? "  | " + output : text;
}

std::string left_out_fields(const std::string& output, const CompiledSource& source) {
  return Reader(output, source).left_out_fields();
}

}  // namespace tiller::tools
