#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "tools/commands.hpp"
#include "tools/record_file.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string robot, record;
};

struct FreeBlock {
  void operator()(void* block) const { std::free(block); }
};

bool same_command(const tiller_command_t& a, const tiller_command_t& b, std::uint32_t inputs) {
  return a.state == b.state && std::memcmp(a.value, b.value, inputs * sizeof(double)) == 0;
}

/// What the host did to the controller before the tick, in its order. False: more than the record keeps.
bool repeat_calls(tiller_t* controller, const RecordEntry& entry) {
  for (std::uint32_t calls = entry.record.calls; calls != 0; calls >>= 4) {
    switch (calls & 15u) {
      case tiller_call_arm: (void)tiller_arm(controller); break;
      case tiller_call_disarm: (void)tiller_disarm(controller); break;
      case tiller_call_stop: (void)tiller_stop(controller, static_cast<tiller_status_t>(entry.stop_status)); break;
      case tiller_call_reset: (void)tiller_reset(controller); break;
      case tiller_call_prepare: (void)tiller_prepare(controller); break;
      default: return false;
    }
  }
  return true;
}

/// What the record's configuration points to is not in the record: it is taken from the robot file. False where that
/// is another task.
bool take_pointers(const RobotFile& robot, tiller_config_t& config) {
  const tiller_cost_config_t& from = robot.config.cost;
  tiller_cost_config_t& to = config.cost;
  config.model = robot.model;
  if (to.reference_steps != from.reference_steps || to.demonstration_steps != from.demonstration_steps) return false;
  to.reference = from.reference;
  to.demonstration_mean = from.demonstration_mean;
  to.demonstration_root = from.demonstration_root;
  to.own = from.own;
  return true;
}

/// Feeds the recorded inputs to a fresh controller; the number of ticks whose command differs in any bit.
int replay(tiller_t* controller, const std::vector<RecordEntry>& entries, std::uint32_t inputs) {
  int different = 0;
  for (const RecordEntry& entry : entries) {
    const tiller_record_t& r = entry.record;
    if (!repeat_calls(controller, entry)) {
      std::printf("tick %llu: more than eight calls came before it, and the record kept eight\n",
                  static_cast<unsigned long long>(r.tick));
    }
    (void)tiller_force_iterations(controller, r.planner_iterations);
    tiller_command_t command;
    (void)tiller_tick(controller, r.now_us, r.has_measurement ? &r.measurement : nullptr, &command);
    if (same_command(command, r.command, inputs)) continue;
    if (++different == 1) {
      std::printf("first difference in tick %llu: recorded %.17g, replayed %.17g\n",
                  static_cast<unsigned long long>(r.tick), r.command.value[0], command.value[0]);
    }
  }
  return different;
}

int replay_command(const Arguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  tiller_config_t config;
  std::vector<RecordEntry> entries;
  std::string error;
  std::shared_ptr<const JointPrior> joint;
  if (!read_record_file(a.record, config, joint, entries, error)) return complain(error);
  if (!take_pointers(*robot, config)) {
    return complain(a.record + ": the reference or the demonstration of " + a.robot + " has another length by now");
  }
  const std::size_t size = tiller_size(&config);
  if (size == 0) return complain(a.record + ": its configuration does not fit the model of " + a.robot);
  std::unique_ptr<void, FreeBlock> block(
      std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT));
  tiller_t* controller = nullptr;
  const tiller_status_t status = tiller_init(&controller, &config, nullptr, block.get(), size);
  if (status != tiller_status_ok) return complain(a.record + ": " + tiller_status_text(status));
  const int different = replay(controller, entries, robot->model->input_count);
  std::printf("%zu ticks replayed on %s, %d different\n", entries.size(), tiller_instruction_set(), different);
  return different == 0 ? kExitOk : kExitBadInput;
}

}  // namespace

void add_replay_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("replay", "run a record again and compare every command to the last bit");
  auto a = std::make_shared<Arguments>();
  command->add_option("RECORD", a->record, "written by tiller run --record")->required();
  command->add_option("ROBOT", a->robot, "the robot file of that run: the model is taken from it")->required();
  command->footer(
      "Bits are promised on the same instruction set and build.\n\n"
      "Examples:\n"
      "  tiller run robots/cart_pole.toml --sim --seconds 5 --record out/run.rec\n"
      "      make a record\n"
      "  tiller replay out/run.rec robots/cart_pole.toml\n"
      "      \"250 ticks replayed on avx512, 0 different\"");
  command->callback([a, &exit_code] { exit_code = replay_command(*a); });
}

}  // namespace tiller::tools
