#include "tiller/tiller.h"

namespace {
struct Entry {
  int code;
  const char* name;
  const char* text;
};
constexpr Entry kEntries[] = {
#define TILLER_STATUS(code, name, band, text) {code, #name, text},
#include "tiller/status.def"
#undef TILLER_STATUS
};
const Entry* find(tiller_status_t status) {
  for (const Entry& entry : kEntries)
    if (entry.code == static_cast<int>(status)) return &entry;
  return nullptr;
}
}  // namespace

extern "C" const char* tiller_status_text(tiller_status_t status) {
  const Entry* entry = find(status);
  return entry ? entry->text : "not a status of tiller";
}
extern "C" const char* tiller_status_name(tiller_status_t status) {
  const Entry* entry = find(status);
  return entry ? entry->name : "unknown";
}
