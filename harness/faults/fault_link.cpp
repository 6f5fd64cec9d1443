#include "harness/faults/fault_link.hpp"

#include <cmath>

namespace tiller::faults {
namespace {

class MemoryLink final : public Link {
 public:
  MemoryLink(const Setup& setup, Device& device) : device_(device), inputs_(setup.config.model->input_count) {}

  bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
             tiller_measurement_t& measurement) override {
    measurement = genuine;
    return fault == nullptr || fault->measure == nullptr || fault->measure(world, measurement);
  }
  void send(World&, const Fault*, const tiller_command_t& command) override {
    device_.apply(plant_command(command, inputs_));
  }

 private:
  Device& device_;
  std::uint32_t inputs_;
};

}  // namespace

Device::Device(sim::Plant& plant, double plan_timeout_s) : plant_(plant), watch_(std::llround(plan_timeout_s * 1e6)) {}

void Device::apply(const sim::PlantCommand& command) {
  watch_.note(command, plant_.time_us());
  if (command.has_value && !watch_.hung(plant_.time_us())) plant_.apply(command.value.data());
}

sim::PlantCommand plant_command(const tiller_command_t& command, std::uint32_t count) {
  sim::PlantCommand c;
  c.sequence = command.sequence;
  c.value.assign(command.value, command.value + count);
  c.state = static_cast<std::int32_t>(command.state);
  c.plan = command.plan_sequence;
  return c;
}

std::unique_ptr<Link> make_memory_link(const Setup& setup, Device& device) {
  return std::make_unique<MemoryLink>(setup, device);
}

}  // namespace tiller::faults
