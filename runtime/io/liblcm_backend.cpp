#include "io/liblcm_backend.hpp"

#if TILLER_WITH_LIBLCM

#include <lcm/lcm.h>
#include <sys/time.h>

#include <cerrno>

#include "io/udp_multicast.hpp"

namespace tiller {
namespace {

// liblcm stamps arrivals with the wall clock. Should that be set back meanwhile, the wait comes out negative
// and the message passes: the sequence gate still stands.
std::int64_t waited_us(std::int64_t arrival_wall_us) {
  timeval now;
  gettimeofday(&now, nullptr);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000 + now.tv_usec - arrival_wall_us;
}

void on_measurement(const lcm_recv_buf_t* buffer, const char*, void* user) {
  lcm_take_measurement(static_cast<LcmTransport*>(user), buffer->data, buffer->data_size,
                       waited_us(buffer->recv_utime));
}

}  // namespace

tiller_status_t liblcm_open(LcmTransport* transport, const char* url, OpenError* error) {
  // asked first: liblcm answers with a banner on stderr
  if (!has_multicast_route(url, error)) return tiller_status_io_error;
  transport->lcm = lcm_create(url);
  if (transport->lcm == nullptr) {
    set_open_error(error,
                   "lcm: cannot open '%.120s'; is it a URL of one of liblcm's providers (udpm://, tcpq://, ...)?", url);
    return tiller_status_io_error;
  }
  if (lcm_subscribe(transport->lcm, transport->measurement_channel, on_measurement, transport) == nullptr) {
    set_open_error(error,
                   "lcm: cannot receive on '%.120s': multicast does not reach this process. Give loopback a "
                   "multicast route: ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo",
                   url);
    liblcm_close(transport);
    return tiller_status_io_error;
  }
  return tiller_status_ok;
}

tiller_status_t liblcm_poll(LcmTransport* transport, int max_messages) {
  for (int handled = 0; handled < max_messages; ++handled) {
    const int result = lcm_handle_timeout(transport->lcm, 0);
    if (result < 0) return tiller_status_io_error;
    if (result == 0) break;
  }
  return tiller_status_ok;
}

tiller_status_t liblcm_publish(LcmTransport* transport, const char* channel, const std::uint8_t* bytes,
                               std::uint32_t size) {
  if (lcm_publish(transport->lcm, channel, bytes, size) == 0) return tiller_status_ok;
  return errno == ENOBUFS || errno == EAGAIN ? tiller_status_queue_full : tiller_status_io_error;
}

int liblcm_descriptor(LcmTransport* transport) { return lcm_get_fileno(transport->lcm); }

void liblcm_close(LcmTransport* transport) {
  if (transport->lcm != nullptr) lcm_destroy(transport->lcm);
  transport->lcm = nullptr;
}

}  // namespace tiller

#else

namespace tiller {

tiller_status_t liblcm_open(LcmTransport*, const char* url, OpenError* error) {
  set_open_error(error, "lcm: cannot open '%.120s': this build is without liblcm and speaks udpm:// alone", url);
  return tiller_status_io_error;
}
tiller_status_t liblcm_poll(LcmTransport*, int) { return tiller_status_transport_closed; }
tiller_status_t liblcm_publish(LcmTransport*, const char*, const std::uint8_t*, std::uint32_t) {
  return tiller_status_transport_closed;
}
int liblcm_descriptor(LcmTransport*) { return -1; }
void liblcm_close(LcmTransport*) {}

}  // namespace tiller

#endif
