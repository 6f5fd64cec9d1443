#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace tiller::tools {

/// The memory of a shared object that was loaded from outside, read without trusting a pointer in it.
class ObjectMemory {
 public:
  /// Of the object that `inside` lies in. The sizes of its variables come from the symbol table of its file.
  explicit ObjectMemory(const void* inside);
  ~ObjectMemory();
  ObjectMemory(const ObjectMemory&) = delete;
  ObjectMemory& operator=(const ObjectMemory&) = delete;

  /// Copies bytes; false, and no fault, where this process may not read them all.
  bool copy(const void* from, std::size_t bytes, void* to) const;
  /// The text that ends with a zero within 256 bytes.
  bool text(const char* from, std::string& out) const;
  /// Bytes from `from` to the end of the variable that it lies in; SIZE_MAX: the symbol table does not know it (an
  /// object without one, or memory from elsewhere).
  std::size_t room(const void* from) const;

 private:
  struct Variable {
    std::size_t begin, end;
  };
  std::vector<Variable> variables_;
  int read_ = -1, write_ = -1;  // a pipe
};

}  // namespace tiller::tools
