#include "io/memory_transport.hpp"

namespace tiller {
namespace {

tiller_status_t memory_poll(void* self, tiller_measurement_t* measurement) {
  auto* transport = static_cast<MemoryTransport*>(self);
  const int fault = transport->fault.load(std::memory_order_acquire);
  if (fault != tiller_status_ok) return static_cast<tiller_status_t>(fault);
  std::uint64_t taken = 0;
  while (taken < MemoryTransport::kSlots && transport->measurements.take(*measurement)) ++taken;
  if (taken == 0) return tiller_status_no_new_measurement;
  transport->counters.received += taken;
  transport->counters.dropped_old += taken - 1;
  return tiller_status_ok;
}

tiller_status_t memory_send(void* self, const tiller_command_t* command) {
  auto* transport = static_cast<MemoryTransport*>(self);
  if (!transport->commands.put(*command)) {
    ++transport->counters.queue_full;
    return tiller_status_queue_full;
  }
  ++transport->counters.sent;
  return tiller_status_ok;
}

int memory_descriptor(void*) { return -1; }

void memory_counters(const void* self, tiller_transport_counters_t* counters) {
  *counters = static_cast<const MemoryTransport*>(self)->counters;
}

void memory_close(void* self) { memory_set_fault(static_cast<MemoryTransport*>(self), tiller_status_transport_closed); }

}  // namespace

const tiller_transport_t kMemoryTransport = {
    sizeof(tiller_transport_t), TILLER_TRANSPORT_VERSION, "memory",    memory_poll, memory_send,
    memory_descriptor,          memory_counters,          memory_close};

bool memory_put_measurement(MemoryTransport* transport, const tiller_measurement_t& measurement) {
  return transport->measurements.put(measurement);
}

bool memory_take_command(MemoryTransport* transport, tiller_command_t& command) {
  return transport->commands.take(command);
}

void memory_set_fault(MemoryTransport* transport, tiller_status_t fault) {
  transport->fault.store(fault, std::memory_order_release);
}

}  // namespace tiller
