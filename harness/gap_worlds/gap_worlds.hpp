#pragma once

// Data in which an effect is hidden, for `tiller gap`: a robot file as an honest engineer would write it, logs of an
// ODE plant that does more than the file says, and the answer under seal. docs/evidence/hidden_effects.md tells how
// they are drawn. Everything follows from the case alone: same case, same bits.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/mechanisms/options.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::bench {

enum class Excitation {
  open_loop,    ///< sums of sines and steps
  pd_tracking,  ///< a PD controller follows a sum of sines; joints with a motor
  planner       ///< tiller's own planner with the nominal model moves to targets
};
const char* excitation_name(Excitation excitation);  ///< "open_loop", "pd_tracking", "planner"
bool find_excitation(const std::string& name, Excitation& excitation);

/// Everything that a world is made from.
struct WorldCase {
  std::string plant = "pendulum";
  std::vector<sim::HiddenEffect> effects;  ///< empty: a null run
  double noise_sd = 2e-3;                  ///< of every encoder: rad, m
  Excitation excitation = Excitation::open_loop;
  double encoder_step = 0;  ///< 0: no quantisation
  double process_sd = 0;    ///< random force on the actuated joint, held for 1 ms each: N, N m
  std::uint64_t seed = 1;
};

/// One run, sampled at the control period.
struct Series {
  std::string name;                           ///< "log_1"
  std::vector<double> time_s;                 ///< (rows)
  std::vector<std::vector<double>> measured;  ///< (ny) of (rows)
  std::vector<std::vector<double>> input;     ///< (nu) of (rows): in force from its row to the next
  std::vector<std::vector<double>> truth;     ///< (nx) of (rows): for judges, in no log
  std::vector<std::vector<double>> clean;     ///< (ny) of (rows): what the sensors show, less noise and rounding
};

/// The truth, which the workflow must not see.
struct Sealed {
  WorldCase world;
  std::vector<std::string> names;  ///< of the plant's parameters ...
  std::vector<double> values;      ///< ... and their true values
  double r = 0;  ///< rollouts over 1 s without the effects, from the true states: RMS error in sensor deviations
  std::vector<double> r_by_channel;  ///< (ny)
};

struct World {
  std::string robot_toml;
  std::vector<std::string> states, measured, inputs;  ///< names of the columns
  double sensor_sd = 0;                               ///< quantisation included
  std::vector<Series> work, score;                    ///< six and four runs of 8 s
  Sealed answer;
};

/// How much is recorded; the default is what is scored.
struct WorldSize {
  std::size_t work = 6, score = 4;
  double seconds = 8.0;
};

/// Null: `error` says why.
std::unique_ptr<World> make_world(const WorldCase& world, std::string& error, const WorldSize& size = {});

/// A run of the case's plant under given inputs, (rows x nu) at its control period; start and noise go by `name`.
bool play(const WorldCase& world, const std::string& name, const std::vector<double>& input, std::size_t rows,
          Series& series, std::string& error);

/// A run as read_log() would give it from its file: columns in the model's order, rates NaN-free but absent.
tools::Log as_log(const World& world, const Series& series);

/// robot.toml, log_1.csv .., score_1.csv .. and sealed/<name>.json in `folder`, which is made. False with a sentence.
bool write_world(const World& world, const std::string& folder, const std::string& name, std::string& error);
std::string series_csv(const World& world, const Series& series);
std::string sealed_json(const Sealed& answer, const std::string& name);

/// Request for a case; the seed draws the rest.
struct CaseWanted {
  std::string plant = "pendulum";
  std::vector<std::string> kinds;  ///< of effects, a port may stand behind "@"; empty: a null run
  double noise_sd = 2e-3;
  Excitation excitation = Excitation::open_loop;
  double encoder_step = 0, process_sd = 0;
  double least_r = 0.5, most_r = 50;  ///< of each effect by itself
  std::uint64_t seed = 1;
};

/// Draws ports, shapes and strengths: for each effect r is drawn evenly in the logarithm, and the strength sought that
/// gives it on the first run, within what is physical for the plant. Null cases draw nothing.
bool draw_case(const CaseWanted& wanted, WorldCase& world, std::string& error);

/// Kinds that can be hidden in a plant: those with a catalogue entry of the same name, or those without.
std::vector<std::string> hidden_kinds(const std::string& plant, bool in_catalogue);
/// Plants with worlds: pendulum, cart_pole, ...
std::vector<std::string> world_plants();

}  // namespace tiller::bench
