#include "harness/gap_loop/gap_loop.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "core/rng.hpp"
#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/run/run_loop.hpp"

namespace tiller::bench {
namespace {

namespace fs = std::filesystem;
using tools::RobotFile;

constexpr double kPeriod_s = 0.02;

/// Hanging pole: the cart is to follow two sines without swinging it up, which is what a crane does. Engineering
/// priors: pole mass and length within a tenth or so; the cart's own friction is taken for none.
std::string robot_text(const std::string& reference) {
  return R"([robot]
name = "crane"
[model]
name = "cart_pole"
period_s = 0.02
substeps = 2
[parameters]
cart_mass_kg = { normal = [1.0, 0.03], low = 0.5 }
pole_mass_kg = { normal = [0.1, 0.01], low = 0.02 }
half_length_m = 0.5
[measurement]
position_m = { sd = 0.0005 }
angle_rad = { sd = 0.002 }
[noise]
process_sd = { velocity_m_s = 0.01, rate_rad_s = 0.02 }
[start]
state = { angle_rad = 3.141592653589793 }
sd = { position_m = 0.001, angle_rad = 0.01, velocity_m_s = 0.01, rate_rad_s = 0.01 }
[posterior]
particles = 128
window = 64
moves_per_tick = 16
[planner]
kind = "cem"
horizon = 40
knots = 10
rollouts = 128
particles = 4
iterations = 3
noise_sd = { force_N = 3 }
[cost]
reference = ")" +
         reference +
         R"("
state_weight = { position_m = 100.0, angle_rad = 0.1, velocity_m_s = 0.5 }
input_weight = { force_N = 0.0001 }
[limits]
force_N = { low = -20, high = 20, safe = 0 }
[safety]
sensor_timeout_s = 0.2
frozen_ticks = 0
[sim]
plant = "cart_pole"
sensors.position_m = { sd = 0.0005 }
sensors.angle_rad = { sd = 0.002 }
step_s = 0.0005
)";
}

/// Two sines with stops between them: slow reversals, where friction sticks, and quick ones, where a delay shows.
void write_reference(const std::string& path) {
  std::ofstream file(path);
  file << "time_s,position_m,angle_rad,velocity_m_s,rate_rad_s\n";
  for (int k = 0; k < 1500; ++k) {
    const double t = kPeriod_s * k, slow = 2 * M_PI * 0.15, quick = 2 * M_PI * 0.6;
    const double x = 0.30 * (1 - std::cos(slow * t)) / 2 + 0.06 * std::sin(quick * t);
    const double v = 0.15 * slow * std::sin(slow * t) + 0.06 * quick * std::cos(quick * t);
    file << tools::format("%.4f,%.6f,%.9f,%.6f,0\n", t, x, M_PI, v);
  }
}

std::string hidden_text(HiddenEffect hidden, double strength) {
  const bool friction = hidden == HiddenEffect::dry_friction;
  return std::string("[[sim.effects]]\nkind = \"") + (friction ? "coulomb_friction" : "input_delay") + "\"\nport = \"" +
         (friction ? "cart" : "force_N") + "\"\n" + (friction ? "friction_SI" : "delay_s") + " = " +
         tools::number_text(strength) + "\n";
}

/// The effects that were found, each with a normal prior about its estimate.
std::string effects_text(const tools::gap::Explanation& best, const tiller_model_t& model, std::size_t own) {
  std::string text;
  std::size_t next = own;
  for (const tools::gap::EffectAt& e : best.effects) {
    const EffectInfo& info = effect_info(e.kind);
    text += std::string("[[effects]]\nkind = \"") + info.name + "\"\nport = \"" + port_name(info.port, model, e.port) +
            "\"\n";
    for (int i = 0; i < info.param_count; ++i, ++next) {
      const tools::gap::Estimate& p = best.params[next];
      text += std::string(info.params[i].name) + " = { normal = [" + tools::number_text(p.mean) + ", " +
              tools::number_text(std::max(p.sd, 0.05 * std::fabs(p.mean) + 1e-6)) + "]";
      if (std::isfinite(info.params[i].low)) text += ", low = " + tools::number_text(info.params[i].low);
      const bool delay = has_role(e.kind, kDelay | kLate);
      const double high = delay ? std::min(16 * kPeriod_s, 2 * p.mean + kPeriod_s) : info.params[i].high;
      if (std::isfinite(high)) text += ", high = " + tools::number_text(high);
      text += " }\n";
    }
  }
  return text;
}

/// A folder that goes with the object.
class Folder {
 public:
  Folder() : path_((fs::temp_directory_path() / "tiller-loop-XXXXXX").string()) { good_ = mkdtemp(path_.data()); }
  ~Folder() {
    std::error_code code;
    fs::remove_all(path_, code);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  bool good() const { return good_; }
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
  bool good_ = false;
};

struct World {
  double cart_kg = 1, pole_kg = 0.1, strength = 0;
};

World draw(const LoopCase& which) {
  Rng rng(which.seed, kRngPrior, 77);
  World w;
  w.cart_kg = 1.0 + 0.03 * rng.normal();
  w.pole_kg = 0.1 + 0.01 * rng.normal();
  w.strength = which.hidden == HiddenEffect::dry_friction ? 0.8 + 1.2 * rng.uniform() : 0.03 + 0.04 * rng.uniform();
  return w;
}

/// One run of `robot` on the plant; infinite where it failed.
double run_once(const RobotFile& robot, std::uint64_t seed, double seconds, const std::string& log) {
  RobotFile now = robot;
  now.config.seed = seed;
  now.sim.seed = seed;
  std::string error;
  const auto plant = tools::make_sim_plant(now, error);
  if (!plant) return INFINITY;
  const auto link = tools::make_sim_link(now, *plant, false);
  tools::RunOptions options;
  options.seconds = seconds;
  options.quiet = true;
  options.files.log = log;
  const tools::RunResult result = tools::run_robot(now, *link, options);
  return result.exit_code == 0 ? result.cost : INFINITY;
}

}  // namespace

const char* hidden_name(HiddenEffect hidden) {
  return hidden == HiddenEffect::dry_friction ? "coulomb_friction" : "input_delay";
}

LoopOutcome close_loop(const LoopCase& which) {
  LoopOutcome out;
  const World world = draw(which);
  out.truth = world.strength;
  const Folder folder;
  if (!folder.good()) return out.failed = true, out.error = "no folder for temporary files", out;
  write_reference(folder / "reference.csv");
  const std::string old_text = robot_text("reference.csv") +
                               "parameters = { cart_mass_kg = " + tools::number_text(world.cart_kg) +
                               ", pole_mass_kg = " + tools::number_text(world.pole_kg) + ", half_length_m = 0.5 }\n" +
                               hidden_text(which.hidden, world.strength);
  const auto before = tools::parse_robot_file(old_text, folder / "old.toml", out.error);
  if (!before) return out.failed = true, out;

  tools::gap::Options options;
  for (std::uint32_t i = 0; i < which.logs; ++i) {
    options.logs.push_back(folder / tools::format("log%u.csv", i));
    (void)run_once(*before, 1000 * which.seed + 10 + i, which.log_s, options.logs.back());
  }
  const tools::gap::Result found = tools::gap::find_gap(*before, options);
  out.verdict = found.verdict;
  for (const std::string& reason : found.reasons) out.error += reason + "\n";
  std::string new_text = old_text;
  if (!found.ranking.empty()) {
    const tools::gap::Explanation& best = found.ranking[0];
    tools::Words names;
    for (const tools::gap::EffectAt& e : best.effects) names.emplace_back(effect_info(e.kind).name);
    out.named = tools::join(names, " + ");
    if (names.empty()) out.named.clear();
    out.right = names.size() == 1 && names[0] == hidden_name(which.hidden);
    new_text += effects_text(best, *before->config.model, before->config.param_count);
  }
  if (!found.horizons.empty()) {
    out.gap_before = found.horizons.back().before_sigma;
    out.gap_after = found.horizons.back().after_sigma;
  }
  const auto after = tools::parse_robot_file(new_text, folder / "new.toml", out.error);
  if (!after) return out.failed = true, out;
  const std::uint64_t evaluated = 1000 * which.seed + 1;  // neither file has seen this noise
  out.before = run_once(*before, evaluated, which.evaluated_s, "");
  out.after = run_once(*after, evaluated, which.evaluated_s, "");
  out.failed = !std::isfinite(out.before) || !std::isfinite(out.after);
  return out;
}

}  // namespace tiller::bench
