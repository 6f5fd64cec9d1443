#include "fake_kernel.hpp"

#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstring>

namespace fake_kernel {
namespace {

Kernel the_kernel;
std::set<int> can_sockets;

template <class F>
F real(const char* name) {
  return reinterpret_cast<F>(dlsym(RTLD_NEXT, name));
}

bool refuses(const std::string& call) {
  Kernel& k = the_kernel;
  const bool counted = k.refuse_after >= 0 && k.refuse_after-- == 0;
  if (!counted && k.only != call) return false;
  k.refused.insert(call);
  errno = k.error;
  return true;
}

bool is_can(int socket) { return can_sockets.count(socket) > 0; }

void add_note(msghdr* message, std::size_t& used, int level, int type, const void* data, std::size_t size) {
  auto* note = reinterpret_cast<cmsghdr*>(static_cast<char*>(message->msg_control) + used);
  note->cmsg_level = level, note->cmsg_type = type, note->cmsg_len = CMSG_LEN(size);
  std::memcpy(CMSG_DATA(note), data, size);
  used += CMSG_SPACE(size);
}

ssize_t read_can(msghdr* message) {
  Kernel& k = the_kernel;
  if (k.arrivals.empty()) {
    errno = EAGAIN;
    return -1;
  }
  const Arrival arrival = k.arrivals.front();
  k.arrivals.pop_front();
  if (arrival.error != 0) {
    errno = arrival.error;
    return -1;
  }
  std::memcpy(message->msg_iov[0].iov_base, &arrival.frame, sizeof arrival.frame);
  message->msg_flags = arrival.own ? MSG_CONFIRM : 0;
  std::size_t used = 0;
  std::memset(message->msg_control, 0, message->msg_controllen);
  if (arrival.foreign_level != 0)
    add_note(message, used, arrival.foreign_level, SO_TIMESTAMP, &arrival.size, sizeof arrival.size);
  if (arrival.stamp_ns != 0) {
    const timespec times[3] = {{arrival.stamp_ns / 1000000000, arrival.stamp_ns % 1000000000}, {}, {}};
    add_note(message, used, SOL_SOCKET, SO_TIMESTAMPING, times, sizeof times);
  }
  const auto drops = static_cast<std::uint32_t>(arrival.drops);
  if (arrival.drops >= 0) add_note(message, used, SOL_SOCKET, SO_RXQ_OVFL, &drops, sizeof drops);
  message->msg_controllen = used;
  return static_cast<ssize_t>(arrival.size);
}

}  // namespace

Kernel& kernel() { return the_kernel; }

void reset() { the_kernel = Kernel(); }

int open_descriptors() {
  int count = 0;
  DIR* folder = opendir("/proc/self/fd");
  while (folder != nullptr && readdir(folder) != nullptr) ++count;
  if (folder != nullptr) closedir(folder);
  return count;
}

}  // namespace fake_kernel

using namespace fake_kernel;

extern "C" {

int socket(int domain, int type, int protocol) {
  if (refuses("socket")) return -1;
  if (domain != PF_CAN) return real<int (*)(int, int, int)>("socket")(domain, type, protocol);
  const int descriptor = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  can_sockets.insert(descriptor);
  return descriptor;
}

int close(int descriptor) {
  can_sockets.erase(descriptor);
  return real<int (*)(int)>("close")(descriptor);
}

int bind(int socket, const sockaddr* address, socklen_t size) {
  if (refuses("bind")) return -1;
  if (is_can(socket)) return the_kernel.bound = true, 0;
  return real<int (*)(int, const sockaddr*, socklen_t)>("bind")(socket, address, size);
}

int connect(int socket, const sockaddr* address, socklen_t size) {
  if (refuses("connect")) return -1;
  return real<int (*)(int, const sockaddr*, socklen_t)>("connect")(socket, address, size);
}

int setsockopt(int socket, int level, int name, const void* value, socklen_t size) {
  if (refuses("setsockopt " + std::to_string(level) + " " + std::to_string(name))) return -1;
  if (the_kernel.no_stamps && level == SOL_SOCKET && (name == SO_TIMESTAMPING || name == SO_TIMESTAMPNS))
    return errno = the_kernel.error, -1;
  if (!is_can(socket))
    return real<int (*)(int, int, int, const void*, socklen_t)>("setsockopt")(socket, level, name, value, size);
  if (!the_kernel.foreign_options) return 0;
  errno = ENOPROTOOPT;
  return -1;
}

int getsockname(int socket, sockaddr* address, socklen_t* size) {
  if (refuses("getsockname")) return -1;
  if (!is_can(socket)) return real<int (*)(int, sockaddr*, socklen_t*)>("getsockname")(socket, address, size);
  sockaddr_can own{};
  own.can_family = AF_CAN;
  own.can_ifindex = the_kernel.bound ? 7 : 0;
  std::memcpy(address, &own, sizeof own);
  return 0;
}

int fcntl(int descriptor, int command, ...) {
  va_list arguments;
  va_start(arguments, command);
  const long value = va_arg(arguments, long);
  va_end(arguments);
  if (refuses("fcntl " + std::to_string(command))) return -1;
  return real<int (*)(int, int, long)>("fcntl")(descriptor, command, value);
}

int ioctl(int descriptor, unsigned long request, ...) {
  va_list arguments;
  va_start(arguments, request);
  auto* data = va_arg(arguments, ifreq*);
  va_end(arguments);
  Kernel& k = the_kernel;
  const char* const name = request == SIOCGIFNAME    ? "ioctl SIOCGIFNAME"
                           : request == SIOCGIFINDEX ? "ioctl SIOCGIFINDEX"
                           : request == SIOCGIFFLAGS ? "ioctl SIOCGIFFLAGS"
                           : request == SIOCGIFMTU   ? "ioctl SIOCGIFMTU"
                                                     : nullptr;
  if (name == nullptr || !is_can(descriptor))
    return real<int (*)(int, unsigned long, void*)>("ioctl")(descriptor, request, data);
  if (refuses(name)) return -1;
  if (request == SIOCGIFNAME) std::strcpy(data->ifr_name, "can7");
  if (request == SIOCGIFINDEX) data->ifr_ifindex = 7;
  if (request == SIOCGIFFLAGS) data->ifr_flags = static_cast<short>(k.up ? IFF_UP : 0);
  if (request == SIOCGIFMTU) data->ifr_mtu = k.fd ? CANFD_MTU : CAN_MTU;
  if (request == SIOCGIFINDEX && !k.exists) return errno = ENODEV, -1;
  return 0;
}

ssize_t recvmsg(int socket, msghdr* message, int flags) {
  if (is_can(socket)) return read_can(message);
  const int error = the_kernel.datagram_error;
  the_kernel.datagram_error = 0;
  if (error != 0) return errno = error, -1;
  return real<ssize_t (*)(int, msghdr*, int)>("recvmsg")(socket, message, flags);
}

ssize_t send(int socket, const void* data, std::size_t size, int flags) {
  if (!is_can(socket)) return real<ssize_t (*)(int, const void*, std::size_t, int)>("send")(socket, data, size, flags);
  if (the_kernel.send_error != 0) return errno = the_kernel.send_error, -1;
  canfd_frame frame;
  std::memcpy(&frame, data, sizeof frame);
  the_kernel.sent.push_back(frame);
  return static_cast<ssize_t>(size);
}

ssize_t sendto(int socket, const void* data, std::size_t size, int flags, const sockaddr* to, socklen_t length) {
  const int error = the_kernel.datagram_error;
  the_kernel.datagram_error = 0;
  if (error != 0) return errno = error, -1;
  return real<ssize_t (*)(int, const void*, std::size_t, int, const sockaddr*, socklen_t)>("sendto")(socket, data, size,
                                                                                                     flags, to, length);
}

int getifaddrs(ifaddrs** list) {
  if (refuses("getifaddrs")) return -1;
  if (the_kernel.made_up_addresses > 0) {
    static ifaddrs entries[200];
    static sockaddr_in address;
    address.sin_family = AF_INET;
    for (int i = 0; i < the_kernel.made_up_addresses; ++i) {
      entries[i] = ifaddrs{};
      entries[i].ifa_next = i + 1 < the_kernel.made_up_addresses ? &entries[i + 1] : nullptr;
      entries[i].ifa_addr = i > 0 ? reinterpret_cast<sockaddr*>(&address) : nullptr;
    }
    *list = entries;
    return 0;
  }
  return real<int (*)(ifaddrs**)>("getifaddrs")(list);
}

void freeifaddrs(ifaddrs* list) {
  if (the_kernel.made_up_addresses == 0) real<void (*)(ifaddrs*)>("freeifaddrs")(list);
}

int getrlimit(__rlimit_resource_t resource, rlimit* limit) {
  if (refuses("getrlimit")) return -1;
  const int result = real<int (*)(__rlimit_resource_t, rlimit*)>("getrlimit")(resource, limit);
  if (resource == RLIMIT_MEMLOCK && the_kernel.memory_lock != 0) limit->rlim_cur = the_kernel.memory_lock;
  return result;
}

int mlockall(int flags) {
  if (refuses("mlockall")) return -1;
  return real<int (*)(int)>("mlockall")(flags);
}

int pthread_getattr_np(pthread_t thread, pthread_attr_t* attributes) {
  if (refuses("pthread_getattr_np")) return ENOMEM;
  return real<int (*)(pthread_t, pthread_attr_t*)>("pthread_getattr_np")(thread, attributes);
}

ssize_t getrandom(void* bytes, std::size_t size, unsigned flags) {
  if (refuses("getrandom")) return the_kernel.error == 0 ? 0 : -1;
  return syscall(SYS_getrandom, bytes, size, flags);
}

int fstat(int descriptor, struct stat* facts) {
  if (refuses("fstat")) return -1;
  return real<int (*)(int, struct stat*)>("fstat")(descriptor, facts);
}

ssize_t read(int descriptor, void* bytes, std::size_t size) {
  if (refuses("read")) return -1;
  return real<ssize_t (*)(int, void*, std::size_t)>("read")(descriptor, bytes, size);
}

int clock_gettime(clockid_t clock, timespec* now) {
  const int result = static_cast<int>(syscall(SYS_clock_gettime, clock, now));
  if (clock == CLOCK_MONOTONIC && the_kernel.monotonic_step_ns != 0) {
    const std::int64_t ns =
        now->tv_sec * 1000000000 + now->tv_nsec + (the_kernel.passed_ns += the_kernel.monotonic_step_ns);
    *now = {ns / 1000000000, ns % 1000000000};
  }
  if (clock != CLOCK_REALTIME || the_kernel.realtime_step_ns == 0) return result;
  const std::int64_t ns = now->tv_sec * 1000000000 + now->tv_nsec + the_kernel.realtime_step_ns;
  *now = {ns / 1000000000, ns % 1000000000};
  return result;
}

}  // extern "C"
