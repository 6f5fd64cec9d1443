#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/base/text.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {

// What the readers of logs share: which columns a robot needs, and what becomes a log of the values in them.

/// The messages of one file; a broken file would otherwise print a thousand.
class LogProblems {
 public:
  explicit LogProblems(std::string path) : path_(std::move(path)) {}
  void add(int line, const std::string& problem);
  /// Of the file as a whole.
  void add(const std::string& problem);
  bool none() const { return count_ == 0; }
  std::string text() const;

 private:
  std::string path_, text_;
  int count_ = 0;
};

/// One quantity: where the file has it, and what makes SI units of it.
struct LogColumn {
  enum class Kind { time, state, input, scale, sensor } kind = Kind::time;
  std::string field, column;  ///< "time", a state, an input or what a sensor reads; a name of the file's
  double factor = 1, zero = 0;
  std::size_t index = 0;  ///< of the state, the input or the sensor
  bool at_inputs() const { return kind == Kind::input || kind == Kind::scale; }
  double si(double value) const { return (value - zero) * factor; }
};

/// What is read of a log: the stamps unless [log] row_s is theirs, the measured states, other states where [log]
/// names a column for them, the sensors that [log] adds, and the inputs of a robot that is `driven`.
std::vector<LogColumn> log_columns(const LogMap& map, const tiller_model_t& model, const std::vector<int>& measured,
                                   bool driven);

/// Whether a log with these columns is of a robot that moves freely: [log] says so, or there are stamps and states
/// alone. A further column may be a command under another name, so it takes a word in the robot file then.
bool is_undriven(const LogMap& map, const tiller_model_t& model, const Words& names);

/// Leaves out the columns of further sensors that `has` does not find, with a note: who needs them asks for them.
void drop_missing_sensors(const std::function<bool(const std::string&)>& has, std::vector<LogColumn>& columns,
                          Log& log);

/// Where each column stands in `names`; `whose` has the names ("the header"). False with the reasons in `problems`.
bool find_columns(const Words& names, const char* whose, const std::vector<LogColumn>& columns,
                  std::vector<std::size_t>& at, LogProblems& problems);

/// An empty log of the robot's with room for the columns.
void begin_log(const std::string& path, const LogMap& map, const tiller_model_t& model, Log& log);

/// The vector that a column fills.
std::vector<double>& values_of(Log& log, const LogColumn& column);

/// How messages call what a log is made of.
struct LogWords {
  std::string stamps;         ///< "column 'time': " before what is wrong with them; may be empty
  const char* row = "line ";  ///< before a number
  const char* rows = "rows";  ///< what there are too few of
  const char* repeated = "";  ///< remedies
  const char* backwards = "";
  const char* repetitions = "identical rows";  ///< what counts once, in the note
};

/// Makes a log of rows as they were read, whose inputs may be missing (NaN) in any of them:
///   rows with the same stamp are one where they do not contradict each other (a message that came twice, or columns
///   that a logger writes one after the other); stamps that go backwards and contradictions are refused;
///   an input holds until its next value ([log] input = "mean": goes on to it in a straight line); what is before the
///   first value of every input is left out; [log] schedule multiplies it;
///   time begins at 0, and quaternions keep to one sign.
/// False with the reasons in `problems`: one of these, or fewer than 20 rows.
bool finish_log(const LogWords& words, const tiller_model_t& model, Log& log, LogProblems& problems);

/// Fills what is missing behind the first value: `hold`, or a straight line to the next one.
void fill_gaps(const std::vector<double>& time_s, bool hold, std::vector<double>& values);

void add_note(const std::string& text, Log& log);

}  // namespace tiller::tools
