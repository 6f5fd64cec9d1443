#include "io/random_secret.hpp"

#include <sys/random.h>

#include <cerrno>
#include <cstring>

namespace tiller {

tiller_status_t read_random(std::uint8_t* bytes, std::size_t size, OpenError* error) {
  for (std::size_t done = 0; done < size;) {
    const ssize_t got = getrandom(bytes + done, size - done, 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      set_open_error(error, "the kernel gives no random numbers, which signed messages need: %s", std::strerror(errno));
      return tiller_status_io_error;
    }
    done += static_cast<std::size_t>(got);
  }
  return tiller_status_ok;
}

}  // namespace tiller
