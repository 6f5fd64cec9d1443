// ./dev bench learned dynamics: forces learnt where the catalogue has no entry for what is hidden. Every world's work
// logs are learnt from; its scoring runs, which nothing was fitted to, judge from their true states.
//
//   bench_learned_dynamics [--seeds N] [--tune] [--plants p,..] [--kinds k,..] [--form network|gaussian|auto]
//                          [--export FOLDER]   every case as a file for bench/peers/dynamics_peer.py

#include <CLI/CLI.hpp>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "bench/learned/dynamics_export.hpp"
#include "bench/table/bench_table.hpp"
#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/learn/learn.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;
using namespace tiller::tools;

struct Settings {
  std::uint32_t seeds = 2;
  bool tune = false, quick = false;
  std::vector<std::string> plants = {"pendulum", "cart_pole"}, kinds;
  std::string form = "auto", store = "build/bench_learned_dynamics.csv", export_folder;
};

struct Judged {
  double before = NAN, after = NAN, covered = NAN, spread = NAN, seconds = NAN;
  std::string chosen = "refused";
};

double median(std::vector<double> v) {
  if (v.empty()) return NAN;
  std::sort(v.begin(), v.end());
  return v.size() % 2 ? v[v.size() / 2] : 0.5 * (v[v.size() / 2 - 1] + v[v.size() / 2]);
}

std::vector<Grid> grids_of(const World& world, const RobotFile& robot, const std::vector<Series>& runs) {
  std::vector<Grid> grids;
  for (const Series& series : runs)
    for (Grid& grid : make_grids(as_log(world, series), robot.log, robot.config)) grids.push_back(std::move(grid));
  return grids;
}

/// True states at the scoring runs' points.
std::vector<Eigen::MatrixXd> true_states(const World& world, const std::vector<Grid>& grids) {
  std::vector<Eigen::MatrixXd> all;
  for (std::size_t g = 0; g < grids.size(); ++g) {
    const auto nx = static_cast<Eigen::Index>(world.states.size());
    Eigen::MatrixXd states = Eigen::MatrixXd::Constant(nx, static_cast<Eigen::Index>(grids[g].points()), NAN);
    for (Eigen::Index i = 0; g < world.score.size() && i < nx; ++i) {
      const std::vector<double>& row = world.score[g].truth[static_cast<std::size_t>(i)];
      for (std::size_t k = 0; k < std::min(row.size(), grids[g].points()); ++k)
        states(i, static_cast<Eigen::Index>(k)) = row[k];
    }
    all.push_back(std::move(states));
  }
  return all;
}

bool judge(const WorldCase& wanted, const Settings& settings, Judged& out, std::string& error) {
  const auto world = make_world(wanted, error);
  if (!world) return false;
  const auto robot = parse_robot_file(world->robot_toml, "robot.toml", error);
  if (!robot) return false;
  learn::LearnOptions options;
  if (settings.form != "auto") options.form = settings.form == "network" ? learn::Form::network : learn::Form::gaussian;
  const std::clock_t begin = std::clock();
  learn::Learnt learnt;
  if (!learn::learn(*robot, grids_of(*world, *robot, world->work), options, learnt, error)) return false;
  out.seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  const std::vector<Grid> score = grids_of(*world, *robot, world->score);
  const std::vector<Eigen::MatrixXd> states = true_states(*world, score);
  learn::Hypotheses who = {&robot->config, {learnt.params}, Eigen::VectorXd()};
  who.process_sd = learnt.before_process_sd;
  const learn::HeldOut before = learn::judge_rollouts(who, score, states);
  out.before = out.after = before.rms_sigma;
  out.covered = before.covered;
  if (learnt.chosen < 0) return true;
  const learn::Candidate& c = learnt.candidates[static_cast<std::size_t>(learnt.chosen)];
  const LoadedNetwork loaded(c.network);
  Config with;
  if (!learn::with_network(robot->config, loaded, with)) return false;
  who.config = &with;
  who.params.clear();
  for (std::uint32_t m = 0; m < c.network.members; ++m) {
    who.params.push_back(learnt.base);
    who.params.back().push_back(m + 0.5);
  }
  who.process_sd = c.process_sd;
  const learn::HeldOut after = learn::judge_rollouts(who, score, states);
  out.after = after.rms_sigma;
  out.covered = after.covered;
  out.spread = c.spread_ratio;
  out.chosen = c.name;
  return true;
}

/// The cases again, which cost little to make, for learners that share no code with these.
bool export_case(const WorldCase& wanted, const std::string& key, const Judged& judged, const Settings& settings,
                 std::string& error) {
  const auto world = make_world(wanted, error);
  if (!world) return false;
  const auto robot = parse_robot_file(world->robot_toml, "robot.toml", error);
  if (!robot) return false;
  std::string name = key;
  std::replace(name.begin(), name.end(), '/', '-');
  const std::filesystem::path folder = settings.export_folder;
  std::filesystem::create_directories(folder);
  return export_world(*world, robot->config.period_s, judged.before, (folder / (name + ".json")).string(), error);
}

/// A line for each case that is done: a run that was cut goes on behind them.
class Store {
 public:
  explicit Store(const std::string& path) : path_(path) {
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    std::ifstream in(path);
    for (std::string line; std::getline(in, line);) {
      std::stringstream words(line);
      std::string key, chosen;
      Judged j;
      words >> key >> j.before >> j.after >> j.covered >> j.spread >> j.seconds >> chosen;
      j.chosen = chosen;
      if (words || !chosen.empty()) done_[key] = j;
    }
  }
  const Judged* find(const std::string& key) const {
    const auto found = done_.find(key);
    return found == done_.end() ? nullptr : &found->second;
  }
  void add(const std::string& key, const Judged& j) {
    std::ofstream out(path_, std::ios::app);
    out << key << ' ' << j.before << ' ' << j.after << ' ' << j.covered << ' '
        << (std::isfinite(j.spread) ? j.spread : 0.0) << ' ' << j.seconds << ' ' << j.chosen << '\n';
    done_[key] = j;
  }

 private:
  std::string path_;
  std::map<std::string, Judged> done_;
};

struct Summary {
  std::vector<double> ratios, spreads, seconds;
  double covered = 0;
  int refused = 0, failed = 0;

  void add(const Judged& j) {
    ratios.push_back(j.after / j.before);
    seconds.push_back(j.seconds);
    covered += j.covered;
    if (j.chosen == "refused")
      ++refused;
    else
      spreads.push_back(j.spread);
  }
  void print(Table& table) const {
    table.heading("all kinds");
    table.row("held-out rollouts of 1 s, after / before, median", median(ratios), "", at_most(0.35));
    table.row("the worst of them", *std::max_element(ratios.begin(), ratios.end()), "", at_most(1.0));
    table.row("central 90 % of the particles' rollouts hold", covered / static_cast<double>(ratios.size()), "",
              at_least(0.85));
    table.row("members' spread beyond the data over inside, median", median(spreads), "", at_least(1.5));
    table.row("refused, of all", refused / static_cast<double>(ratios.size()), "");
    table.row("CPU time of learning, median", median(seconds), "s");
    table.row("nothing learnt for an error", failed, "cases", at_most(0));
  }
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Learned forces on physics outside of the catalogue", "bench_learned_dynamics");
  Settings settings;
  app.add_option("--seeds", settings.seeds, "of each plant and kind");
  app.add_flag("--tune", settings.tune, "seeds from 100001 on");
  app.add_flag("--quick", settings.quick, "one seed, the pendulum");
  app.add_option("--plants", settings.plants)->delimiter(',');
  app.add_option("--kinds", settings.kinds)->delimiter(',');
  app.add_option("--form", settings.form, "network, gaussian or auto");
  app.add_option("--store", settings.store, "a line for each case; a run that was cut goes on from there");
  app.add_option("--export", settings.export_folder, "folder: every case as JSON, for other learners");
  CLI11_PARSE(app, argc, argv);
  if (settings.quick) {
    settings.seeds = 1;
    settings.plants = {"pendulum"};
  }
  Table table;
  Summary all;
  Store store(settings.store);
  for (const std::string& plant : settings.plants)
    for (const std::string& kind : hidden_kinds(plant, false)) {
      if (!settings.kinds.empty() &&
          std::find(settings.kinds.begin(), settings.kinds.end(), kind) == settings.kinds.end())
        continue;
      std::vector<double> of_kind;
      for (std::uint32_t k = 0; k < settings.seeds; ++k) {
        constexpr double kNoises[] = {3e-4, 2e-3, 1e-2};
        CaseWanted wanted;
        wanted.plant = plant;
        wanted.kinds = {kind};
        wanted.seed = (settings.tune ? 100001 : 1) + k;
        wanted.noise_sd = kNoises[wanted.seed % 3];
        wanted.least_r = 3;
        const std::string key = settings.form + "/" + plant + "/" + kind + "/" + std::to_string(wanted.seed);
        Judged judged;
        std::string error;
        if (const Judged* known = store.find(key)) {
          judged = *known;
        } else {
          WorldCase drawn;
          if (!draw_case(wanted, drawn, error) || !judge(drawn, settings, judged, error)) {
            std::fprintf(stderr, "%s: %s\n", key.c_str(), error.c_str());
            ++all.failed;
            continue;
          }
          store.add(key, judged);
        }
        if (!settings.export_folder.empty()) {
          WorldCase drawn;
          if (!draw_case(wanted, drawn, error) || !export_case(drawn, key, judged, settings, error))
            std::fprintf(stderr, "%s: not exported: %s\n", key.c_str(), error.c_str());
        }
        std::fprintf(stderr, "%s: %.3g -> %.3g sigma (%.2f), 90 %% hold %.2f, spread x%.3g, %.1f s, %s\n", key.c_str(),
                     judged.before, judged.after, judged.after / judged.before, judged.covered, judged.spread,
                     judged.seconds, judged.chosen.c_str());
        all.add(judged);
        of_kind.push_back(all.ratios.back());
      }
      if (of_kind.empty()) continue;
      table.heading(plant + ", " + kind);
      table.row("held-out rollouts of 1 s, after / before, median", median(of_kind), "");
    }
  if (!all.ratios.empty()) all.print(table);
  return table.finish();
}
