// What a table from outside points to, without a fault where it points nowhere.
#include "tools/robot/object_memory.hpp"

#include <dlfcn.h>
#include <elf.h>
#include <fcntl.h>
#include <link.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>

namespace tiller::tools {
namespace {

/// A record of an ELF file; false where the file ends before it.
template <class T>
bool record(const std::string& file, std::size_t at, T& out) {
  if (at > file.size() || file.size() - at < sizeof(T)) return false;
  std::memcpy(&out, file.data() + at, sizeof(T));
  return true;
}

}  // namespace

ObjectMemory::ObjectMemory(const void* inside) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) == 0) {
    read_ = ends[0];
    write_ = ends[1];
  }
  Dl_info info;
  link_map* map = nullptr;
  if (dladdr1(inside, &info, reinterpret_cast<void**>(&map), RTLD_DL_LINKMAP) == 0 || !map) return;
  std::ifstream stream(map->l_name, std::ios::binary);
  const std::string file{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  ElfW(Ehdr) head;
  if (!record(file, 0, head) || std::memcmp(head.e_ident, ELFMAG, SELFMAG) != 0) return;
  for (std::size_t i = 0; i < head.e_shnum; ++i) {
    ElfW(Shdr) section;
    if (!record(file, head.e_shoff + i * head.e_shentsize, section)) return;
    if (section.sh_type != SHT_SYMTAB && section.sh_type != SHT_DYNSYM) continue;
    ElfW(Sym) symbol;
    for (std::size_t at = 0; at + sizeof symbol <= section.sh_size; at += sizeof symbol) {
      if (!record(file, section.sh_offset + at, symbol)) return;
      if (ELF64_ST_TYPE(symbol.st_info) != STT_OBJECT || symbol.st_size == 0 || symbol.st_shndx == SHN_UNDEF) continue;
      const std::size_t begin = map->l_addr + symbol.st_value;
      variables_.push_back({begin, begin + symbol.st_size});
    }
  }
}

ObjectMemory::~ObjectMemory() {
  if (read_ >= 0) close(read_);
  if (write_ >= 0) close(write_);
}

// The kernel reads for a pipe, and answers EFAULT where nothing is mapped. A pipe takes 4096 bytes without waiting.
bool ObjectMemory::copy(const void* from, std::size_t bytes, void* to) const {
  constexpr std::size_t kMost = 4096;
  if (write_ < 0) return false;
  for (std::size_t at = 0; at < bytes;) {
    const ssize_t written = write(write_, static_cast<const char*>(from) + at, std::min(bytes - at, kMost));
    if (written <= 0 || read(read_, static_cast<char*>(to) + at, static_cast<std::size_t>(written)) != written)
      return false;
    at += static_cast<std::size_t>(written);
  }
  return true;
}

bool ObjectMemory::text(const char* from, std::string& out) const {
  constexpr std::size_t kMost = 256;
  out.clear();
  for (char c = 0; out.size() < kMost; out += c) {
    if (!copy(from + out.size(), 1, &c)) return false;
    if (c == '\0') return true;
  }
  return false;
}

std::size_t ObjectMemory::room(const void* from) const {
  const auto at = reinterpret_cast<std::size_t>(from);
  for (const Variable& v : variables_)
    if (at >= v.begin && at < v.end) return v.end - at;
  return SIZE_MAX;
}

}  // namespace tiller::tools
