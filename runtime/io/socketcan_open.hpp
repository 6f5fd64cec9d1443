#pragma once

namespace tiller {

struct SocketCanTransport;

/// True if the socket's interface was removed, as an adapter on USB that was unplugged, and one of its name is there
/// again: the socket is bound to that, options and filters as they were. Up to four system calls, of which bind may
/// wait for whoever sets up interfaces: for a link that is down.
[[nodiscard]] bool socketcan_bind_again(SocketCanTransport* transport);

}  // namespace tiller
