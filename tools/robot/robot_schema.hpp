#pragma once

#include <cstdint>
#include <string>

#include "tiller/tiller.h"
#include "tools/base/text.hpp"

namespace tiller::tools {

/// The type of a value of the robot file.
enum class KeyKind {
  text,
  flag,           // true or false
  count,          // whole number
  number,         // finite number
  choice,         // one of a list of names
  state_numbers,  // table: state name = number
  input_numbers,  // table: input name = number
  prior,          // number (fixed) or table, see the section "prior"
  other           // a table or list with a reader of its own
};

/// One key of the robot file. Those with an offset are the lines of tiller/config.def: read, checked and stored from
/// this entry alone; their default is what tiller_config_default() leaves there.
struct KeySpec {
  const char* section;  ///< "planner"; "measurement.*" for the tables below one with free names
  const char* key;
  KeyKind kind;
  const char* unit;      ///< "" where it has none; "SI" is the unit of the state, input or port
  const char* fallback;  ///< default as text; null: from tiller_config_default()
  double low, high;      ///< closed range of numbers; for numbers below a name, of each
  bool low_open;         ///< `low` itself is refused
  int offset;            ///< bytes into tiller_config_t; -1: read by hand
  Words (*choices)();    ///< names of a choice in the order of their values; else null
  const char* help;
  const char* readers = nullptr;  ///< of [planner]: the planners that read it, "mppi, cem"; null: all
  double least = 0;               ///< magnitudes below this are refused, but for 0 itself where the range holds it
  std::uint32_t multiple = 1;     ///< of a count
  /// Of a setting of config.def: its path in tiller_config_t ("planner.knots"), and of a choice what tiller.h calls the
  /// values (tiller_<enum_prefix>_<name>); else null.
  const char* field = nullptr;
  const char* enum_prefix = nullptr;
};

constexpr const char* kRequired = "required";

/// Sections in the order in which the documentation shows them.
struct SectionSpec {
  const char* name;    ///< "planner", "measurement.*", "effects[]"
  const char* header;  ///< as written: "[planner]", "[[effects]]", or a description of a table below a name
  const char* help;
};

const std::vector<SectionSpec>& robot_sections();
const std::vector<KeySpec>& robot_keys();

/// The keys of a section, in order.
Words keys_of(const std::string& section);
/// The entry; null if the section has no such key.
const KeySpec* find_key(const std::string& section, const std::string& key);

/// The present name of a key of earlier versions; null: it was never one.
const char* renamed_key(const std::string& section, const std::string& key);
/// Why a key of earlier versions is gone; null: it never was one.
const char* removed_key(const std::string& section, const std::string& key);

/// Whether the planner reads the key of [planner].
bool planner_reads(const KeySpec& key, const std::string& planner);

Words planner_names();
Words integrator_names();
Words posterior_names();
Words risk_names();
Words interpolation_names();
Words hypotheses_names();
Words divergence_names();
Words shooting_names();
Words qp_names();
Words terminal_names();
Words input_reference_names();
Words contact_names();
Words effect_names();
Words builtin_model_names();
Words figure_view_names();

}  // namespace tiller::tools
