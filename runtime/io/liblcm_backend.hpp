#pragma once

#include <cstdint>

#include "io/lcm_transport.hpp"

namespace tiller {

/// The transport through liblcm: every provider it has. A build without it (TILLER_LIBLCM=OFF) has these too; open then
/// says so.
tiller_status_t liblcm_open(LcmTransport* transport, const char* url, OpenError* error);
/// Hands what has arrived to lcm_take_measurement; at most `max_messages`.
tiller_status_t liblcm_poll(LcmTransport* transport, int max_messages);
tiller_status_t liblcm_publish(LcmTransport* transport, const char* channel, const std::uint8_t* bytes,
                               std::uint32_t size);
int liblcm_descriptor(LcmTransport* transport);
void liblcm_close(LcmTransport* transport);

}  // namespace tiller
