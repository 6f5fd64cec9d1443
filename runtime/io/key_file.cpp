#include "io/key_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "io/message_seal.hpp"

namespace tiller {
namespace {

int digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

bool parse(const char* text, std::size_t size, std::uint8_t* key) {
  std::size_t digits = 0;
  for (std::size_t i = 0; i < size; ++i) {
    if (is_space(text[i]) && (digits == 0 || digits == 2 * MessageSeal::kKeyBytes)) continue;
    const int value = digit(text[i]);
    if (value < 0 || digits == 2 * MessageSeal::kKeyBytes) return false;
    std::uint8_t& byte = key[digits / 2];
    byte = static_cast<std::uint8_t>(digits % 2 == 0 ? value << 4 : byte | value);
    ++digits;
  }
  return digits == 2 * MessageSeal::kKeyBytes;
}

}  // namespace

tiller_status_t read_key_file(const char* path, std::uint8_t* key, OpenError* error) {
  const int file = ::open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0) {
    set_open_error(error, "key file '%.120s': %s. Make one: (umask 077; openssl rand -hex 32 > %.120s)", path,
                   std::strerror(errno), path);
    return tiller_status_io_error;
  }
  struct stat facts {};
  char text[256];
  const bool known = fstat(file, &facts) == 0;
  const ssize_t size = ::read(file, text, sizeof text);
  ::close(file);
  if (known && (facts.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    set_open_error(error, "key file '%.120s' is open to others than its owner: chmod 600 %.120s", path, path);
    return tiller_status_io_error;
  }
  const bool good = size >= 0 && parse(text, static_cast<std::size_t>(size), key);
  std::memset(text, 0, sizeof text);
  if (good) return tiller_status_ok;
  set_open_error(error, "key file '%.120s' does not hold 64 hexadecimal digits: openssl rand -hex 32", path);
  return tiller_status_bad_message;
}

}  // namespace tiller
