#pragma once

// Readers of the sections of a robot file that are more than keys with a place in the configuration.
// Each reports what is wrong and goes on, so that one run finds every error.

#include <array>

#include "tools/robot/robot_file.hpp"
#include "tools/robot/section_reader.hpp"

namespace tiller::tools {

/// A number or a prior table. A range must lie within the hard bounds; the tails of other priors are cut there.
void read_prior(FileErrors& errors, const toml::node& node, const std::string& path, double hard_low, double hard_high,
                tiller_prior_t& out);

void read_parameters(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_effects(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_measurements(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_limits(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_hold_gain(SectionReader& safety, RobotFile& robot);
/// [[safety.cones]]; after the limits, which have to fit.
void read_cones(FileErrors& errors, const toml::table& root, RobotFile& robot);
void choose_discrepancy(SectionReader& posterior, RobotFile& robot);
void read_forgetting(SectionReader& posterior, RobotFile& robot);
void read_drift(SectionReader& posterior, RobotFile& robot);
void read_probe(SectionReader& probe, RobotFile& robot);
/// After the parameters and effects, whose priors it goes before.
void read_prior_file(SectionReader& posterior, RobotFile& robot);
/// Bounds, terms of the catalogue, trajectories and the own cost of [cost]; after the keys that are bound to fields.
void read_cost_terms(FileErrors& errors, const toml::table& root, RobotFile& robot);
/// Its outputs, frames and clearance.
void read_outputs(SectionReader& cost, RobotFile& robot, TaskRows& rows);
/// [cost.clearance]: bounds of the distances that the model tells, which are returned.
std::vector<ClearanceOutput> read_clearance(SectionReader& cost, const RobotFile& robot,
                                            std::vector<tiller_output_cost_t>& costs);
/// Three finite numbers; false after an error.
bool read_triple(SectionReader& section, const std::string& key, std::array<double, 3>& out);
/// With a wrong [measurement], names of measurements are not known: saying so twice would hide the cause.
bool knows_measurements(const FileErrors& errors);
void read_transport(FileErrors& errors, const toml::table& root, RobotFile& robot);
/// [transport] actuator and drives; after nodes, levers and [limits].
void read_drives(SectionReader& section, const RobotFile& robot, TransportSection& transport);
/// [transport] of the kind ros2.
void read_ros2(SectionReader& section, const RobotFile& robot, Ros2Section& ros2);
void read_realtime(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_sim(FileErrors& errors, const toml::table& root, RobotFile& robot);
void read_log_map(FileErrors& errors, const toml::table& root, RobotFile& robot);
/// After the parameters and effects: it may name them.
void read_figure(FileErrors& errors, const toml::table& root, RobotFile& robot);

/// Errors that only the library's own check sees: multiples, and combinations of values.
void check_whole(FileErrors& errors, const toml::table& root, const RobotFile& robot);

/// A key of a table with its value.
struct Entry {
  std::string name;
  const toml::node* node;
};
/// The entries in the order in which they stand in the file (toml++ sorts them by name).
std::vector<Entry> in_file_order(const toml::table& table);

/// The table of a section; null if it is missing; an error if it is no table.
const toml::table* section_table(FileErrors& errors, const toml::table& root, const std::string& name);

}  // namespace tiller::tools
